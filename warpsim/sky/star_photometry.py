"""Photometry of stars: the fluxes that a catalog holds, and from them the light in any other band."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.arrays import F64, I64
from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import as_band
from warpsim.radiometry.magnitudes import Physics, as_radiometry
from warpsim.sky.photometric_bands import FLUX_FILLED, FLUX_NONE, flux_band, photometric_bands, photometric_name
from warpsim.sky.stellar_spectrum import band_irradiance_w_cm2, calibration_w_cm2_per_jy
from warpsim.sky.stellar_templates import (
    DWARF,
    UNKNOWN_TEMPERATURE_K,
    colour,
    colour_temperature_k,
    luminosity_class,
)

Flags = NDArray[np.uint8]

COLOURS = {
    ("BP", "RP"): 1.0,
    ("V", "Ks"): 0.43,
    ("V", "Ic"): 1.0,
    ("J", "Ks"): 1.5,
    ("B", "V"): 1.15,
    **{("V", infrared): 0.43 for infrared in ("S9W", "W3", "IRAS12", "C", "A")},
}
"""Colours that tell a temperature, the surest first, and BP-RP over them where dwarfs and giants part, BP-RP = 0.95."""

_VISIBLE = ("V", "G", "Hp", "BP", "RP", "Ic", "B")
_INFRARED = ("Ks", "H", "J", "W1", "IRAC1", "W2", "IRAC2", "IRAC3", "IRAC4", "S9W", "W3", "IRAS12", "C", "A")
OTHER_COLOURS = (
    *((visible, infrared) for visible in _VISIBLE for infrared in _INFRARED if (visible, infrared) not in COLOURS),
    *(("G", "RP"), ("BP", "G"), ("B", "Ic"), ("Hp", "Ic")),
)
"""Colours that tell a temperature where none of COLOURS is known."""

BEYOND_MAG = 0.5
"""Distance from the colours of the templates from which a colour is doubted [mag]: most stars are closer."""


@dataclass(frozen=True, eq=False)
class StarPhotometry:
    """Fluxes of stars as given, and the light in other bands that follows from them; arrays are (n,), read-only.

    Light is predicted from the fluxes given alone, never from predictions. What was computed once is kept.
    """

    given_jy: Mapping[str, F64]
    """Flux density [Jy] by photometric band; NaN where unknown."""

    given_flag: Mapping[str, Flags]
    """Kinds of the fluxes given, for the same bands."""

    temperature_k: F64
    """Colour temperature as given, or of the spectral type [K]; NaN where neither does."""

    luminosity: NDArray[np.int8]
    """Luminosity class: 0 dwarf, 1 giant, -1 unknown."""

    parallax_mas: F64
    """Parallax [mas]; NaN where unknown."""

    pm_mas_yr: F64
    """Proper motion [mas/yr]; 0 where unknown."""

    filled: bool = False
    """Whether flux_jy() gives predictions where no flux was given."""

    limit_jy: Mapping[str, F64] = field(default_factory=dict)
    """Upper limits of predicted fluxes by band [Jy], NaN for none."""

    _flux_jy: dict[str, F64] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        fluxes: list[NDArray[Any]] = [*self.given_jy.values(), *self.given_flag.values()]
        for values in (*fluxes, self.temperature_k, self.luminosity):
            frozen(values)

    def flux_jy(self, band: Band | str) -> F64:
        """Flux density as given [Jy], or predicted if `filled`; NaN where there is none."""
        name = flux_band(band).name
        if self.filled:
            return self._known_jy(name)
        return self.given_jy[name] if name in self.given_jy else np.broadcast_to(np.nan, self.temperature_k.shape)

    def flux_flag(self, band: Band | str) -> Flags:
        """Kind of flux_jy(): 0 unknown, 1 measured, 2 predicted by the catalog, 3 filled in from the spectrum."""
        name = flux_band(band).name
        none = np.broadcast_to(np.uint8(FLUX_NONE), self.temperature_k.shape)
        given = self.given_flag.get(name, none)
        if not self.filled:
            return given
        predicted = (given == FLUX_NONE) & np.isfinite(self._known_jy(name))
        return frozen(np.where(predicted, np.uint8(FLUX_FILLED), given))

    def irradiance_w_cm2(self, band: Band | str, physics: Physics = "physical") -> F64:
        """In-band irradiance [W/cm2]; 0 for stars without any flux. See StarCatalog.irradiance_w_cm2()."""
        radiometry = as_radiometry(physics)
        band = as_band(band)
        if radiometry.name == "paper":
            msx = radiometry.band_name(band)
            light = np.asarray(radiometry.flux_irradiance_w_cm2(self._known_jy(msx), msx))
        elif (name := photometric_name(band)) is not None:
            light = self._known_jy(name) * calibration_w_cm2_per_jy(name)
        else:
            light = self._spectral_w_cm2(band)
        return np.where(np.isnan(light), 0.0, light)

    def magnitude(self, band: Band | str) -> F64:
        """Magnitude: of flux_jy() in a photometric band, in any other that has a zero point of the irradiance."""
        band = as_band(band)
        if photometric_name(band) is not None:
            ratio = self.flux_jy(band) / band.zero_mag_jy
        elif band.zero_mag_w_cm2 > 0.0:
            ratio = self._spectral_w_cm2(band) / band.zero_mag_w_cm2
        else:
            rule = "must be known for magnitudes: give the band zero_mag_jy, 3631 for AB"
            raise InputError(rule, "zero_mag_jy").of(f"band {band.name}")
        with np.errstate(divide="ignore"):
            return np.asarray(-2.5 * np.log10(ratio))

    @functools.cached_property
    def spectrum_luminosity(self) -> I64:
        """Luminosity classes of the spectra: as given, else by colour and parallax or motion, else giants."""
        luminosity = self.luminosity.astype(np.int64)
        rows = np.flatnonzero(luminosity < DWARF)
        if len(rows):
            magnitude = np.full(len(rows), np.nan)
            for name in ("G", "V", "Hp"):
                magnitude = np.where(np.isnan(magnitude), self._magnitude(name, rows), magnitude)
            luminosity[rows] = luminosity_class(
                magnitude,
                self._bp_rp_mag(rows),
                self.parallax_mas[rows],
                self.pm_mas_yr[rows],
            )
        return frozen(luminosity)

    @functools.cached_property
    def spectrum_temperature_k(self) -> F64:
        """Colour temperatures of the spectra [K]: as given, else by the first colour known, else a K giant's."""
        temperature_k = self.temperature_k.copy()
        for bands, rows, colour_mag in self.telling_colours():
            temperature_k[rows] = colour_temperature_k(colour_mag, bands, self.spectrum_luminosity[rows])
        return frozen(np.where(np.isnan(temperature_k), UNKNOWN_TEMPERATURE_K, temperature_k))

    def telling_colours(self) -> Iterator[tuple[tuple[str, str], I64, F64]]:
        """Yield the colours that temperatures follow from, the surest first: bands, rows of stars, colours [mag]."""
        missing = np.isnan(self.temperature_k)
        for blue, red in (*COLOURS, *OTHER_COLOURS):
            if blue in self.given_jy and red in self.given_jy and missing.any():
                rows = np.flatnonzero(missing)
                colour_mag = self._magnitude(blue, rows) - self._magnitude(red, rows)
                known = np.isfinite(colour_mag)
                missing[rows[known]] = False
                yield (blue, red), rows[known], colour_mag[known]

    def with_types(self, type_temperature_k: F64) -> StarPhotometry:
        """Return the photometry with temperatures of spectral types where none is given and no colour in COLOURS known.

        Those are of a dwarf and of a giant of the type [K], (n, 2); NaN without a type.
        """
        rows = np.flatnonzero(np.isnan(self.temperature_k) & np.isfinite(type_temperature_k[:, DWARF]))
        rows = rows[np.isnan(self._bp_rp_mag(rows))]
        temperature_k = self.temperature_k.copy()
        temperature_k[rows] = type_temperature_k[rows, self.spectrum_luminosity[rows]]
        return replace(self, temperature_k=temperature_k)

    def rows(self, rows: I64) -> StarPhotometry:
        """Return the photometry of the stars in some rows."""

        def of_rows(values: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
            return {name: column[rows] for name, column in values.items()}

        return replace(
            self,
            given_jy=of_rows(self.given_jy),
            given_flag=of_rows(self.given_flag),
            temperature_k=self.temperature_k[rows],
            luminosity=self.luminosity[rows],
            parallax_mas=self.parallax_mas[rows],
            pm_mas_yr=self.pm_mas_yr[rows],
            limit_jy=of_rows(self.limit_jy),
        )

    def _bp_rp_mag(self, rows: I64) -> F64:
        """BP-RP, or what another colour makes of it [mag]; NaN where there is none."""
        bp_rp_mag = np.full(len(rows), np.nan)
        for (blue, red), bp_rp_per_colour in COLOURS.items():
            colour_mag = self._magnitude(blue, rows) - self._magnitude(red, rows)
            bp_rp_mag = np.where(np.isnan(bp_rp_mag), colour_mag * bp_rp_per_colour, bp_rp_mag)
        return bp_rp_mag

    def _magnitude(self, name: str, rows: I64) -> F64:
        """Magnitude of the flux given in a band; NaN where there is none, or it is 0."""
        if name not in self.given_jy:
            return np.full(len(rows), np.nan)
        flux_jy = self.given_jy[name][rows]
        return np.asarray(
            -2.5 * np.log10(np.where(flux_jy > 0.0, flux_jy, np.nan) / photometric_bands()[name].zero_mag_jy)
        )

    def _known_jy(self, name: str) -> F64:
        """Flux density given or predicted [Jy]; NaN for stars without any flux."""
        if name not in self._flux_jy:
            flux_jy = self.given_jy.get(name)
            if flux_jy is None:
                flux_jy = self._predicted_jy(name, slice(None))
            elif np.isnan(flux_jy).any():
                rows = np.flatnonzero(np.isnan(flux_jy))
                flux_jy = flux_jy.copy()
                flux_jy[rows] = self._predicted_jy(name, rows)
            self._flux_jy[name] = frozen(flux_jy)
        return self._flux_jy[name]

    def _predicted_jy(self, name: str, rows: slice | NDArray[np.int64]) -> F64:
        band = photometric_bands()[name]
        flux_jy = self._spectral_w_cm2(band, rows) / calibration_w_cm2_per_jy(name)
        if name not in self.limit_jy:
            return flux_jy
        return np.where(np.isnan(flux_jy), np.nan, np.fmin(flux_jy, self.limit_jy[name][rows]))

    def _spectral_w_cm2(self, band: Band, rows: slice | NDArray[np.int64] = slice(None)) -> F64:
        """Irradiance of the spectra in a band [W/cm2]; NaN for stars without any flux."""
        given_jy = {name: flux_jy[rows] for name, flux_jy in self.given_jy.items()}
        return band_irradiance_w_cm2(band, given_jy, self.spectrum_temperature_k[rows], self.spectrum_luminosity[rows])


def warn_colours(name: str, photometry: StarPhotometry) -> None:
    """Warn about stars of unknown temperature, and about colours far beyond those of stars; `name` is their file's."""
    n_star = len(photometry.temperature_k)
    unknown = np.isnan(photometry.temperature_k) & np.any(
        [np.isfinite(flux_jy) for flux_jy in photometry.given_jy.values()], axis=0
    )
    n_beyond, example = 0, ""
    for bands, rows, colour_mag in photometry.telling_colours():
        unknown[rows] = False
        of_templates = colour(*bands, photometry.spectrum_luminosity[rows], photometry.spectrum_temperature_k[rows])
        beyond = np.flatnonzero(np.abs(colour_mag - of_templates) > BEYOND_MAG)
        if len(beyond) and not n_beyond:
            example = f"{'-'.join(bands)} {colour_mag[beyond[0]]:.2f}"
        n_beyond += len(beyond)
    if n_unknown := np.count_nonzero(unknown):
        rule = f"have no colour, type or temperature: their spectra are a K giant's of {UNKNOWN_TEMPERATURE_K:g} K"
        warnings.warn(f"{name}: {n_unknown} of {n_star} stars {rule}", stacklevel=2)
    if n_beyond:
        rule = f"have colours more than {BEYOND_MAG:g} mag beyond those of known spectra ({example})"
        warnings.warn(f"{name}: {n_beyond} of {n_star} stars {rule}", stacklevel=2)


def frozen(values: NDArray[Any]) -> NDArray[Any]:
    """Make an array read-only and return it."""
    values.setflags(write=False)
    return values
