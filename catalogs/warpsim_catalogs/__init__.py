"""Star tables and spectral responses that ship with warpsim; recipes and sources: catalogs/README.md."""

from __future__ import annotations

from importlib.resources import files
from importlib.resources.abc import Traversable

_DATA = (".csv", ".npz", ".toml")


def path(name: str) -> Traversable:
    """Return a shipped file, such as "hip_gaia_ir_v1.npz"; `.open("rb")` reads it, from a zipped install too.

    Raises:
        FileNotFoundError: There is no such file.
    """
    resource = files(__name__).joinpath(name)
    if not resource.is_file():
        known = sorted(entry.name for entry in files(__name__).iterdir() if entry.name.endswith(_DATA))
        raise FileNotFoundError(f"warpsim_catalogs has no file {name!r}; it has {', '.join(known)}")
    return resource
