"""Summaries of runs and data sets: parts of their manifests, and tables of several sensors joined to one."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.radiometry.band import Band
from warpsim.scene.scenario import Scenario

if TYPE_CHECKING:
    from astropy.table import Table

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


def joined_tables(parts: Sequence[Table]) -> Table:
    """Return the rows of tables, one behind the other.

    The metadata are those that all have alike: what differs from part to part, as a seed, is no word of the whole.
    Columns with a value per band have those of all tables, in the order of BANDS in the metadata, NaN for bands that a
    sensor does not have.
    """
    from astropy.table import vstack

    if len(parts) == 1:
        return parts[0]
    bands = list(dict.fromkeys(band for part in parts for band in _bands(part)))
    table = vstack([_spread(part, bands) for part in parts], metadata_conflicts="silent")
    alike = [name for name in parts[0].meta if all(part.meta.get(name) == parts[0].meta[name] for part in parts)]
    table.meta = {name: parts[0].meta[name] for name in alike}
    if bands:
        table.meta["BANDS"] = ",".join(bands)
        table.meta["CATALOG"] = ", ".join(dict.fromkeys(str(part.meta["CATALOG"]) for part in parts))
    return table


def _bands(table: Table) -> list[str]:
    return str(table.meta["BANDS"]).split(",") if "BANDS" in table.meta else []


def _spread(table: Table, bands: list[str]) -> Table:
    own = _bands(table)
    if own == bands:
        return table
    spread, numbers = table.copy(), [bands.index(band) for band in own]
    for name in table.colnames:
        if table[name].ndim == 2:
            values = np.full((len(table), len(bands)), np.nan)
            values[:, numbers] = table[name]
            spread[name] = values
            spread[name].unit = table[name].unit
    return spread
