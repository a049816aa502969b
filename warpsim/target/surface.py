"""Emissivity and reflectance of a target's surface by band."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import PlainValidator, ValidationInfo, model_validator

from warpsim.config.fields import number_within, rule_error
from warpsim.config.model import config_model
from warpsim.errors import InputError
from warpsim.radiometry.by_band import AS_DICT, ByBand, band_table, in_band, named_bands

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
        for band in named_bands(self.reflectance, self.emissivity) or [""]:
            reflected, emitted = _in_band(self.reflectance, band), _in_band(self.emissivity, band)
            if reflected is None or emitted is None or abs(reflected + emitted - 1) <= OPAQUE_TOLERANCE:
                continue
            where = f" in band {band}" if band else ""
            rule, total = f"must be 1 (opaque graybody){where}", reflected + emitted
            raise InputError(rule, value=total, form="g").of("emissivity + reflectance")
        return self

    def describes(self, band: str) -> bool:
        """Return whether the surface is described in a band."""
        return _in_band(self.emissivity, band) is not None or _in_band(self.reflectance, band) is not None

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
            found = ", ".join(named_bands(self.reflectance, self.emissivity))
            raise InputError(f"must give reflectance or emissivity in band {band}, got them in {found}", "surface")
        return fraction


def _in_band(value: float | Mapping[str, float] | None, band: str) -> float | None:
    return None if value is None else in_band(value, band)
