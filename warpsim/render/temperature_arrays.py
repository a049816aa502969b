"""Temperatures of targets on a device: their rows, and the radiance of bands between the extremes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.emission import RadianceTable
from warpsim_kernels.temperature import TemperatureTables

from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import as_band, band_radiance_w_m2_sr
from warpsim.target.surface import Graybody
from warpsim.target.temperature import TemperatureRows

LN_TEMPERATURE_STEP = 0.005
"""Node spacing of the radiance table in ln(T): the cubic Hermite error is below 1e-9 at 300 K and above."""

DARKEST_W_M2_SR = 1e-300
"""Stands for less in the radiance table: a body of some kelvin has no light in a short band, which has no logarithm."""


_NO_TARGET_K = 300.0  # of a scene without targets, whose radiances nobody asks for


@dataclass(frozen=True)
class TemperatureArrays:
    """Temperatures on the device, and where each target's lie."""

    tables: Any
    first: list[int]
    """First row of each target."""
    count: list[int]
    """Rows of each target."""
    span_k: tuple[float, float]
    """Lowest and highest temperature of all."""


def make_temperatures(temperatures: Sequence[TemperatureRows], device: wp.Device) -> TemperatureArrays:
    """Put the temperatures of all targets on a device, each once however many targets share it."""
    first_row: dict[int, int] = {}
    distinct: list[TemperatureRows] = []
    n_row = 0
    for rows in temperatures:
        if id(rows) not in first_row:
            first_row[id(rows)] = n_row
            distinct.append(rows)
            n_row += len(rows.time_s)
    time_s = np.concatenate([np.zeros(0), *(rows.time_s for rows in distinct)])
    kelvin = np.concatenate([np.zeros(0), *(rows.temperature_k for rows in distinct)])
    tables: Any = TemperatureTables()
    tables.time_s = wp.array(time_s, dtype=wp.float64, device=device)
    tables.temperature_k = wp.array(kelvin, dtype=wp.float64, device=device)
    return TemperatureArrays(
        tables,
        [first_row[id(rows)] for rows in temperatures],
        [len(rows.time_s) for rows in temperatures],
        (float(kelvin.min()), float(kelvin.max())) if distinct else (_NO_TARGET_K, _NO_TARGET_K),
    )


def make_radiance(
    bands: Sequence[Band | str], span_k: tuple[float, float], device: wp.Device, surfaces: Sequence[Graybody] = ()
) -> Any:
    """Put ln(radiance) and its scaled slope at nodes of ln(T) on a device, each (n_row, n_node).

    Args:
        bands: Bands; the first rows are those of blackbodies in them.
        span_k: Lowest and highest temperature that the nodes span [K].
        device: Where they are put.
        surfaces: Surfaces by wavelength; rows of the radiance that each emits in the bands follow.
    """
    start = float(np.log(span_k[0])) - LN_TEMPERATURE_STEP
    n_node = int(np.ceil((np.log(span_k[1]) - start) / LN_TEMPERATURE_STEP)) + 2
    ln_temperature = start + LN_TEMPERATURE_STEP * np.arange(n_node)
    chosen = [as_band(band) for band in bands]

    def ln_radiance(shift: float) -> npt.NDArray[np.float64]:
        kelvin = np.exp(ln_temperature + shift)
        black = [band_radiance_w_m2_sr(kelvin, band) for band in chosen]
        own = [surface.emitted_w_m2_sr(kelvin, band) for surface in surfaces for band in chosen]
        return np.asarray(np.log(np.maximum(np.stack([*black, *own]), DARKEST_W_M2_SR)))

    h = 1e-3  # fourth-order difference: its error stays below the table's own
    slope = (8 * (ln_radiance(h) - ln_radiance(-h)) - (ln_radiance(2 * h) - ln_radiance(-2 * h))) / (12 * h)
    table: Any = RadianceTable()
    table.ln_temperature_start, table.ln_temperature_step = start, LN_TEMPERATURE_STEP
    table.ln_radiance = wp.array(ln_radiance(0.0), dtype=wp.float64, device=device)
    table.slope = wp.array(slope * LN_TEMPERATURE_STEP, dtype=wp.float64, device=device)
    return table
