"""Magnitudes, irradiances and dynamic ranges of stars, in two presets: the physics, and the source paper's arithmetic.

The presets agree on Eq. 4 (magnitude from flux density) and on the zero-magnitude flux densities. They differ in the
in-band irradiance of magnitude 0 and in the base of the magnitude scale; docs/physics.md sets them side by side.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from warpsim.arguments import plain_array
from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import BANDS

if TYPE_CHECKING:
    from astropy.table import Table

Physics = Literal["physical", "paper"]

NEI_W_CM2 = 1e-18
SEI_W_CM2 = 3e-15
"""Noise and saturation equivalent irradiance of the paper's sensor (Table 4) [W/cm2]."""

_PAPER_LIGHT_M_S = 3e8  # as the paper rounds it below Eq. 2


@dataclass(frozen=True)
class ZeroPoint:
    """A band, and the light of a star of magnitude 0 in it."""

    wavelength_um: float
    """Isophotal wavelength [um]."""

    edges_um: tuple[float, float]
    """Lower and upper edge, at half power [um]."""

    zero_mag_jy: float
    """Flux density [Jy]."""

    zero_mag_w_cm2: float
    """In-band irradiance [W/cm2]."""

    w_cm2_per_jy: float
    """In-band irradiance per flux density [W/cm2 per Jy]; with "paper" at magnitude 0."""

    @property
    def width_um(self) -> float:
        """Width that turns the flux density into the irradiance by Eq. 2, F * c / lambda^2 * width, c = 3e8 m/s [um].

        It says what the paper's irradiances were made with; of the physical ones it is the effective width.
        """
        zero_w_cm2_um = self.zero_mag_jy * 1e-26 * _PAPER_LIGHT_M_S / (self.wavelength_um * 1e-6) ** 2 * 1e-10
        return self.zero_mag_w_cm2 / zero_w_cm2_um


@dataclass(frozen=True)
class Radiometry:
    """Conversion of magnitudes into light: zero points of the bands, and the base of the magnitude scale."""

    name: Physics

    magnitude_base: float
    """Ratio of the irradiances of two stars one magnitude apart."""

    zero_points: Mapping[str, ZeroPoint]
    """By band, in the order of the paper's tables: A, B1, B2, C, D, E."""

    def band_name(self, band: Band | str) -> str:
        """Name of an MSX band, of a Band only if it is that of BANDS in all its numbers.

        Raises:
            InputError: The band is none of them.
        """
        name = band.name if isinstance(band, Band) else band
        if not isinstance(name, str) or name not in self.zero_points or (band != name and band != BANDS[name]):
            raise InputError(f"must be one of {', '.join(self.zero_points)}", "band", name)
        return name

    def zero_point(self, band: Band | str) -> ZeroPoint:
        """Zero point of an MSX band.

        Raises:
            InputError: The band is none of them.
        """
        return self.zero_points[self.band_name(band)]

    def magnitude(self, flux_jy: ArrayLike, band: Band | str) -> Any:
        """Magnitude of a flux density, Eq. 4: -2.5 log10(F / F0), the same in both presets.

        Args:
            flux_jy: Flux density [Jy], any shape, >= 0; 0 gives inf, NaN gives NaN.
            band: B1, B2, A, C, D or E.

        Returns:
            Magnitude, shape of flux_jy (a float for a single number).

        Raises:
            InputError: Negative flux, values that are not numbers, or an unknown band.
        """
        zero, flux = self.zero_point(band), _fluxes(flux_jy)
        with np.errstate(divide="ignore"):
            return _like(-2.5 * np.log10(flux / zero.zero_mag_jy))

    def irradiance_w_cm2(self, magnitude: ArrayLike, band: Band | str) -> Any:
        """In-band irradiance of a magnitude [W/cm2]: E0 * base^-m.

        Args:
            magnitude: Magnitude, any shape; NaN gives NaN, inf gives 0.
            band: B1, B2, A, C, D or E.

        Raises:
            InputError: Values that are not numbers, or an unknown band.
        """
        zero = self.zero_point(band)
        with np.errstate(over="ignore", under="ignore"):
            return _like(zero.zero_mag_w_cm2 * self.magnitude_base ** -plain_array(magnitude, "", "magnitude"))

    def flux_irradiance_w_cm2(self, flux_jy: ArrayLike, band: Band | str) -> Any:
        """In-band irradiance of a flux density [W/cm2].

        "physical": the flux density times the band's w_cm2_per_jy, as the calibration prints it (through rounding it
        differs from E0 / F0 by up to 0.4 %). "paper": the irradiance of the magnitude by Eq. 4.

        Args:
            flux_jy: Flux density [Jy], any shape, >= 0; NaN gives NaN.
            band: B1, B2, A, C, D or E.

        Raises:
            InputError: Negative flux, values that are not numbers, or an unknown band.
        """
        if self.name == "paper":
            return self.irradiance_w_cm2(self.magnitude(flux_jy, band), band)
        return _like(_fluxes(flux_jy) * self.zero_point(band).w_cm2_per_jy)

    def dynamic_range(
        self,
        magnitude: ArrayLike,
        band: Band | str,
        nei_w_cm2: float = NEI_W_CM2,
        sei_w_cm2: float = SEI_W_CM2,
    ) -> Any:
        """Signal of a star over the noise, no more than the sensor's range: Eq. 6, min(SEI, E) / NEI.

        Args:
            magnitude: Magnitude, any shape; NaN gives NaN.
            band: B1, B2, A, C, D or E.
            nei_w_cm2: Noise equivalent irradiance [W/cm2], > 0.
            sei_w_cm2: Saturation equivalent irradiance [W/cm2], > 0.

        Raises:
            InputError: NEI or SEI not finite and > 0, values that are not numbers, or an unknown band.
        """
        for key, value in (("nei_w_cm2", nei_w_cm2), ("sei_w_cm2", sei_w_cm2)):
            if not isinstance(value, int | float | np.number) or not (math.isfinite(value) and value > 0.0):
                raise InputError("must be finite and > 0", key, value)
        return _like(np.minimum(self.irradiance_w_cm2(magnitude, band) / nei_w_cm2, sei_w_cm2 / nei_w_cm2))

    def band_table(self) -> Table:
        """Zero points as an astropy Table, one band a row: Table 1 of the paper, with the irradiances beside it."""
        from astropy.table import Table

        rows = [
            (band, zero.wavelength_um, *zero.edges_um, zero.zero_mag_jy, zero.zero_mag_w_cm2, zero.width_um)
            for band, zero in self.zero_points.items()
        ]
        names = ("band", "wavelength_um", "lower_um", "upper_um", "zero_mag_jy", "zero_mag_w_cm2", "width_um")
        units = (None, "um", "um", "um", "Jy", "W / cm2", "um")
        return Table(rows=rows, names=names, units=units, meta={"physics": self.name})

    def dynamic_range_table(
        self,
        magnitudes: Sequence[float] = (0, 1, 2, 3, 4, 5, 6),
        nei_w_cm2: float = NEI_W_CM2,
        sei_w_cm2: float = SEI_W_CM2,
    ) -> Table:
        """Dynamic ranges as an astropy Table, one magnitude a row: Table 2 of the paper, shown to three decimals."""
        from astropy.table import Table

        table = Table({"magnitude": np.asarray(magnitudes)}, meta={"physics": self.name})
        for band in self.zero_points:
            table[band] = np.atleast_1d(self.dynamic_range(magnitudes, band, nei_w_cm2, sei_w_cm2))
            table[band].info.format = ".3f"
        return table


def _fluxes(flux_jy: ArrayLike) -> F64:
    flux = plain_array(flux_jy, "Jy", "flux_jy")
    if (flux < 0.0).any():
        raise InputError("must be >= 0", "flux_jy", flux[flux < 0.0][0], "g")
    return flux


def _like(values: Any) -> Any:
    """An array as it is, a single number as a float."""
    return values if np.ndim(values) else float(values)


_PAPER = {
    # Table 1: isophotal um, waveband um, zero magnitude Jy; first row of Table 2: irradiance of magnitude 0 over NEI.
    "A": (8.28, (6.8, 10.8), 58.49, 510.651),
    "B1": (4.29, (4.22, 4.36), 194.6, 444.097),
    "B2": (4.35, (4.24, 4.45), 188.8, 658.514),
    "C": (12.13, (11.1, 13.2), 26.51, 113.509),
    "D": (14.65, (13.5, 15.9), 18.29, 61.359),
    "E": (21.34, (18.2, 25.1), 8.80, 40.000),
}


def _paper() -> Radiometry:
    points = {}
    for name, (wavelength_um, edges_um, jy, in_nei) in _PAPER.items():
        w_cm2 = in_nei * NEI_W_CM2
        points[name] = ZeroPoint(wavelength_um, edges_um, jy, w_cm2, w_cm2 / jy)
    return Radiometry("paper", 2.512, MappingProxyType(points))


def _physical() -> Radiometry:
    points = {}
    for name in _PAPER:
        band = BANDS[name]
        zero_point = band.zero_mag_jy, band.zero_mag_w_cm2, band.w_cm2_per_jy
        points[name] = ZeroPoint(band.isophotal_um, band.half_power_um, *zero_point)
    return Radiometry("physical", 100.0**0.2, MappingProxyType(points))


PHYSICS: Mapping[str, Radiometry] = MappingProxyType({"physical": _physical(), "paper": _paper()})
"""The presets by name: "physical" (the default everywhere) and "paper" (reproduces the paper's Tables 1 and 2).

Both know the six bands of MSX only: A, B1, B2, C, D, E.
"""


def as_radiometry(physics: str) -> Radiometry:
    """Return the preset of that name, or raise an InputError."""
    if not isinstance(physics, str) or physics not in PHYSICS:
        raise InputError('must be "physical" or "paper"', "physics", physics)
    return PHYSICS[physics]
