"""Parts of manifests: versions of programs, responses of bands."""

from __future__ import annotations

import math
import sys
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from warpsim.radiometry.band import Band
from warpsim.scene.scenario import Scenario
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


def response_facts(band: Band) -> dict[str, Any]:
    """Return all numbers of a band as plain values: nodes, wavelengths, and the zero points that are known."""
    names = ("isophotal_um", "zero_mag_jy", "zero_mag_w_cm2", "w_cm2_per_jy")
    return {
        "half_power_um": list(band.half_power_um),
        **{name: value for name in names if not math.isnan(value := getattr(band, name))},
        "per_photon": band.per_photon,
        "wavelength_um": band.wavelength_um.tolist(),
        "response": band.response.tolist(),
    }


def left_out_rows(scenario: Scenario) -> list[dict[str, Any]]:
    """Return the element sets that a scene does without (`Scenario.left_out`) as plain values."""
    table = scenario.left_out
    return [dict(zip(table.colnames, row.as_void().item(), strict=True)) for row in table]
