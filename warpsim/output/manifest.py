"""Versions of programs, for manifests."""

from __future__ import annotations

import sys
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from warpsim.version import __version__

PACKAGES = ("numpy", "warp-lang", "astropy", "skyfield", "sgp4", "OpenImageIO", "pydantic")
"""What warpsim always stands on."""


def made_with(*more: str) -> dict[str, Any]:
    """Versions of warpsim, of the packages it stands on, of `more`, and of Python."""
    return {"warpsim": __version__, "packages": package_versions(*more), "python": python_version()}


def package_versions(*more: str) -> dict[str, str | None]:
    """Versions of the packages that warpsim stands on, and of `more`; None where one is missing."""
    return {name: _installed(name) for name in (*PACKAGES, *more)}


def python_version() -> str:
    """Version of Python, as in 3.12.1."""
    return sys.version.split()[0]


def _installed(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
