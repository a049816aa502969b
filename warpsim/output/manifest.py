"""Parts of manifests: versions of programs, responses of bands."""

from __future__ import annotations

import contextlib
import math
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from warpsim.radiometry.band import Band
from warpsim.scene.scenario import Scenario

PACKAGES = ("numpy", "warp-lang", "astropy", "skyfield", "sgp4", "OpenImageIO", "pydantic")
"""What warpsim always stands on."""


def package_versions(*more: str) -> dict[str, str | None]:
    """Versions of the packages that warpsim stands on, and of `more`; None where one is missing."""
    found: dict[str, str | None] = dict.fromkeys((*PACKAGES, *more))
    for name in found:
        with contextlib.suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


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
