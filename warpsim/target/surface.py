"""Emissivity and reflectance of a target's surface by band."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import PlainValidator, ValidationInfo, model_validator

from warpsim.config.fields import number_within, rule_error
from warpsim.config.model import config_model
from warpsim.errors import InputError
from warpsim.radiometry.bands import BANDS
from warpsim.radiometry.by_band import AS_DICT, ByBand, band_table

OPAQUE_TOLERANCE = 1e-9
"""How far from 1 the sum of a given emissivity and reflectance may be."""


def _unit_fraction(value: Any, info: ValidationInfo) -> float | ByBand[float]:
    """One number from 0 to 1 for all bands, or a table of them."""
    if not isinstance(value, Mapping):
        return number_within(value, info, 0, 1)
    if not value:
        raise rule_error("must be a number or a table that names a band")
    return band_table(value, info, 0, 1)


UnitFraction = Annotated[float | Mapping[str, float], PlainValidator(_unit_fraction), AS_DICT]
"""A fraction from 0 to 1, one for all bands or a table by band."""


@config_model
class Graybody:
    """Opaque surface that emits and reflects alike in all directions, within a band at all wavelengths.

    In every band emissivity = 1 - reflectance. Each is a number for all bands, or a table by band like
    {"A": 0.9, "C": 0.85}. A band in which both are given and do not add up to 1 is an error.

    Args:
        reflectance: Diffuse reflectance, 0 to 1.
        emissivity: Emissivity, 0 to 1.
    """

    reflectance: UnitFraction | None = None
    emissivity: UnitFraction | None = None

    @model_validator(mode="after")
    def _opaque(self) -> Graybody:
        if self.reflectance is None and self.emissivity is None:
            raise InputError("give reflectance or emissivity")
        for band in BANDS:
            reflected, emitted = _in_band(self.reflectance, band), _in_band(self.emissivity, band)
            if reflected is None or emitted is None or abs(reflected + emitted - 1) <= OPAQUE_TOLERANCE:
                continue
            tables = any(isinstance(given, Mapping) for given in (self.reflectance, self.emissivity))
            where = f" in band {band}" if tables else ""
            rule, total = f"must be 1 (opaque graybody){where}", reflected + emitted
            raise InputError(rule, value=total, form="g").of("emissivity + reflectance")
        return self

    @property
    def bands(self) -> tuple[str, ...]:
        """Names of the bands in which the surface is described."""
        given = (self.reflectance, self.emissivity)
        return tuple(band for band in BANDS if any(_in_band(value, band) is not None for value in given))

    def emissivity_in(self, band: str) -> float:
        """Emissivity in a band, whichever of the two was given.

        Raises:
            InputError: The surface is not described in that band.
        """
        emitted = _in_band(self.emissivity, band)
        return emitted if emitted is not None else 1.0 - self._needed(self.reflectance, band)

    def reflectance_in(self, band: str) -> float:
        """Reflectance in a band, whichever of the two was given.

        Raises:
            InputError: The surface is not described in that band.
        """
        reflected = _in_band(self.reflectance, band)
        return reflected if reflected is not None else 1.0 - self._needed(self.emissivity, band)

    def _needed(self, value: float | Mapping[str, float] | None, band: str) -> float:
        fraction = _in_band(value, band)
        if fraction is None:
            raise InputError(
                f"must give reflectance or emissivity in band {band}, got them in {', '.join(self.bands)}", "surface"
            )
        return fraction


def _in_band(value: float | Mapping[str, float] | None, band: str) -> float | None:
    if band not in BANDS:
        raise InputError(f"must be one of {', '.join(BANDS)}", "band", band)
    return value.get(band) if isinstance(value, Mapping) else value
