"""warpsim: what space-based infrared sensors see, rendered by GPU kernels.

Public names are those of `__init__.pyi`. They are imported on first use, so that `import warpsim` stays fast.
"""

import importlib
from typing import Any

from warpsim.version import __version__ as __version__


def _homes() -> dict[str, str]:
    """Modules of the public names, by the stub's lines `from MODULE import NAME as NAME`."""
    stub = __loader__.get_data(f"{__path__[0]}/__init__.pyi").decode()  # type: ignore[name-defined]
    lines = (line.split() for line in stub.splitlines() if line.startswith("from "))
    return {words[3]: words[1] for words in lines}


_HOME = _homes()

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    home = _HOME.get(name)
    if home is None:
        raise AttributeError(f"module 'warpsim' has no attribute {name!r}")
    if home == "warpsim":
        return importlib.import_module(f"warpsim.{name}")
    value = getattr(importlib.import_module(home), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
