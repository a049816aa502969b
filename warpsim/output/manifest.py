"""What every manifest says of the programs that made the files."""

from __future__ import annotations

import sys
from importlib.metadata import PackageNotFoundError, version
from typing import Any

PACKAGES = ("numpy", "warp-lang", "astropy", "skyfield", "sgp4", "OpenImageIO", "pydantic")


def made_with() -> dict[str, Any]:
    """Versions of warpsim, of the packages it stands on, and of Python."""
    import warpsim

    packages = {name: _installed(name) for name in PACKAGES}
    return {"warpsim": warpsim.__version__, "packages": packages, "python": sys.version.split()[0]}


def _installed(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
