"""Environment of a scene: the star background, and the external light that reaches the targets."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, PlainValidator, ValidationInfo, model_validator

from warpsim.config.fields import (
    Count,
    Integer,
    NonNegative,
    Number,
    Positive,
    Switch,
    closed_interval,
    rule_error,
    whole_path,
)
from warpsim.config.model import config_model, one_of
from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import BANDS, name_among
from warpsim.radiometry.by_band import AS_DICT, ByBand, FixedMapping, band_table, in_band, within
from warpsim.radiometry.sun_and_earth import earth_albedo, earth_brightness_temperature_k, sun_irradiance_w_m2
from warpsim.sky.photometric_bands import check_flux_band
from warpsim.sky.positions import Cone, checked_region
from warpsim.target.surface import UnitFractionByBand

BUILT_IN_CATALOGS = ("default", "union", "synthetic", "none")
"""Words for `Sky.catalog` that name no file."""


def _word_or_path(value: Any) -> str:
    rule = f"must be one of {', '.join(BUILT_IN_CATALOGS)}, or the path of a file"
    return value if isinstance(value, str) and value in BUILT_IN_CATALOGS else whole_path(value, rule)


@config_model
class SyntheticStars:
    """Synthetic stars over the whole sky; give n_star or limit_jy.

    Args:
        n_star: How many.
        limit_jy: Flux density of the faintest in band A [Jy].
        sky: "astrometric", as dense as a catalog selected in visible light, or "infrared", as dense as the true sky.
        seed: Of their random numbers; the scene's seed plays no part.
    """

    n_star: Annotated[Count, closed_interval(1, 10**8)] | None = None
    limit_jy: Annotated[Positive, closed_interval(1e-6, 1e6)] | None = None
    sky: Literal["astrometric", "infrared"] = "astrometric"
    seed: Annotated[Integer, closed_interval(0, 2**63 - 1)] = 0

    _one_size = one_of("n_star", "limit_jy")


def _column_names(value: Any) -> FixedMapping[str]:
    if not isinstance(value, Mapping) or not all(isinstance(text, str) for pair in value.items() for text in pair):
        raise rule_error('must be a table such as {ra_deg = "RAJ2000"}')
    return FixedMapping(value)


def _faintest(value: Any, info: ValidationInfo) -> FixedMapping[float]:
    magnitudes = band_table(value, info, -30.0, 60.0)
    for band in magnitudes:
        check_flux_band(band)
    return FixedMapping(magnitudes)  # of bands of the catalog, which the scene need not have


def _name_or_number(value: Any) -> Any:
    return int(value) if isinstance(value, np.integer) else value


@config_model
class Sky:
    """The star background.

    Args:
        catalog: "default" (embedded), "union" (all of its sources, needs the extra `catalogs`), "synthetic", "none", or
            the path of a catalog file, or of a folder; tiles of a HATS folder are read as views need them.
        format: Of a catalog file: a survey ("gaia") or a kind of file ("votable"); told by the file where left out.
        table: Of a catalog file with several tables: name or number, counted from 1.
        columns: Of a catalog file: which of its columns holds what, {ra_deg = "RAJ2000"}.
        epoch_jyear: Of a catalog file: Julian year of its positions; told by the file where left out.
        region: Of a catalog file: only its stars in a cone [ra_deg, dec_deg, radius_deg], or in any of several.
        limit: Of a catalog file: only its stars not fainter than a magnitude, in any of some bands, {W3 = 8.0}.
        synthetic: What to make, for catalog = "synthetic".
        physics: "physical", or "paper": motion by its Eq. 5 and irradiance by its zero points, which are known in the
            bands of MSX only.
        aberration: Whether apparent positions include the aberration of the sensor's motion.
        parallax: Whether they include the parallax of nearby stars.
        light_deflection: Whether they include the bending of light by the Sun.
    """

    catalog: Annotated[str, BeforeValidator(_word_or_path)] = "default"
    format: str | None = None
    table: Annotated[int | str | None, PlainValidator(_name_or_number)] = None
    columns: Annotated[FixedMapping[str], PlainValidator(_column_names), AS_DICT] | None = None
    epoch_jyear: Number | None = None
    region: Annotated[tuple[Cone, ...], BeforeValidator(checked_region)] = ()
    limit: Annotated[FixedMapping[float], PlainValidator(_faintest), AS_DICT] | None = None
    synthetic: SyntheticStars | None = None
    physics: Literal["physical", "paper"] = "physical"
    aberration: Switch = True
    parallax: Switch = False
    light_deflection: Switch = False

    @model_validator(mode="after")
    def _catalog_is_described(self) -> Sky:
        # Not by the field's type: a union has an error for each of its types, and "table" is a tag of others.
        if isinstance(self.table, bool) or not isinstance(self.table, int | str | None):
            raise InputError("must be a name or a whole number", "table", self.table)
        if (self.catalog == "synthetic") != (self.synthetic is not None):
            raise InputError('must be given with catalog = "synthetic", and only then', "synthetic")
        if self.catalog in BUILT_IN_CATALOGS:
            for name in ("format", "table", "columns", "epoch_jyear", "region", "limit"):
                if getattr(self, name) not in (None, ()):
                    raise InputError("must be given with the path of a catalog file, and only then", name)
        return self


EARTH_K = MappingProxyType({"B1": 235.0, "B2": 235.0, "A": 275.0, "C": 275.0, "D": 225.0, "E": 260.0})
"""Brightness temperature of the Earth seen from space [K], a mean over regions and weather: B1 and B2 look at carbon
dioxide high in the air, D at that of its 15 um band, A and C mostly at ground and clouds, E at water vapour."""

MSX_EARTH_ALBEDO = 0.3
"""Fraction of sunlight that the Earth reflects, as taken in the MSX bands: that of all sunlight."""

_W_CM2_PER_W_M2 = 1e-4


@config_model
class Lighting:
    """Light that targets reflect, besides what they emit.

    A term that stays below `leave_out_nei` for the whole scene, by a bound, is left out, as are terms switched off: the
    kernels are compiled without them. `Instrument.light_terms` reports which, and why.

    Args:
        sun: Whether targets reflect sunlight.
        earth: Whether targets reflect the Earth's thermal radiation.
        albedo: Whether targets reflect the sunlight that the Earth reflects.
        leave_out_nei: Largest irradiance of a term that may be left out [NEI]; 0 leaves out what is exactly 0.
        earth_albedo: Fraction of sunlight that the Earth reflects, as a Lambertian surface, for all bands or by band;
            in bands that are not named 0.3 in those of MSX, by the Earth's mean spectrum in others and behind sources.
        earth_k: Brightness temperature of the Earth by band [K]; in bands that are not named `EARTH_K` in those of MSX,
            by the Earth's mean spectrum in others.
        sun_w_cm2: Irradiance of the Sun in a band at 1 au by band [W/cm2]; that of the Sun's spectrum in bands that are
            not named.
        quadrature_error: Largest error of the quadrature over the exposure, as a fraction of the largest value of what
            is integrated.
        albedo_error: Largest error of Earth albedo, as a fraction of the most that it can be at the target's distance
            from the Earth; a larger one is taken where it surely stays within `leave_out_nei`. Targets that go more
            than an Earth radius above the ground have 0.02 at best.
    """

    sun: Switch = True
    earth: Switch = True
    albedo: Switch = True
    leave_out_nei: NonNegative = 0.01
    earth_albedo: UnitFractionByBand | None = None
    earth_k: Annotated[Mapping[str, float], within(2.7, 1000.0), AS_DICT] = ByBand({})
    sun_w_cm2: Annotated[Mapping[str, float], within(0.0, 1.0), AS_DICT] = ByBand({})
    quadrature_error: Annotated[Number, closed_interval(1e-5, 0.1)] = 1e-3
    albedo_error: Annotated[Number, closed_interval(2e-3, 0.1)] = 1e-2

    def earth_k_in(self, band: Band) -> float:
        """Brightness temperature of the Earth in a band [K]."""
        given = self.earth_k.get(band.name)
        if given is not None:
            return given
        msx = name_among(band, BANDS)
        return earth_brightness_temperature_k(band) if msx is None else EARTH_K[msx]

    def earth_albedo_in(self, band: Band) -> float:
        """Fraction of sunlight in a band that the Earth reflects."""
        if name_among(band, BANDS) is None or self._given_albedo(band) is not None:
            return self.background_albedo_in(band)
        return MSX_EARTH_ALBEDO

    def background_albedo_in(self, band: Band) -> float:
        """Fraction of sunlight in a band that the Earth reflects where it is seen: 0.003 at 4.3 um."""
        given = self._given_albedo(band)
        return earth_albedo(band) if given is None else given

    def _given_albedo(self, band: Band) -> float | None:
        return None if self.earth_albedo is None else in_band(self.earth_albedo, band.name)

    def sun_w_m2_in(self, band: Band) -> float:
        """Irradiance of the Sun in a band at 1 au [W/m2]."""
        given = self.sun_w_cm2.get(band.name)
        return sun_irradiance_w_m2(band) if given is None else given / _W_CM2_PER_W_M2
