"""Emissivity and reflectance of a target's surface: the same at all wavelengths, by band, or by wavelength."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import PlainSerializer, PlainValidator, ValidationError, ValidationInfo, model_validator

from warpsim.config.fields import FileName, NonNegative, Number, closed_interval, number_within, rows_in, rule_error
from warpsim.config.model import adapter, config_model, input_error
from warpsim.errors import InputError
from warpsim.exchange.curve_file import CurveFile, read_curve
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import as_band, band_radiance_w_m2_sr, planck_w_m2_sr_um
from warpsim.radiometry.by_band import AS_DICT, band_table, named_bands
from warpsim.radiometry.curve_nodes import checked_curve
from warpsim.radiometry.sun_and_earth import Curve, band_rule, earth_rule, earthshine_rule, sunlight_rule
from warpsim.target.from_file import FromFile

Wavelengths = Annotated[tuple[Number, ...], rows_in("um")]
Fractions = Annotated[tuple[Annotated[NonNegative, closed_interval(0, 1)], ...], rows_in("")]

OPAQUE_TOLERANCE = 1e-9
"""How far from 1 the sum of a given emissivity and reflectance may be."""

Light = Literal["sun", "earth", "albedo"]
"""Light that falls on a surface: sunlight, the Earth's infrared, sunlight that the Earth reflects."""

_RULES = {"sun": sunlight_rule, "earth": earth_rule, "albedo": earthshine_rule}

_NODES_PER_PIECE = 12
_MAX_PIECE_LOG_WIDTH = 0.02


@config_model
class ByWavelength(FromFile):
    """A fraction by wavelength, linear between nodes and constant beyond; give wavelength_um and value, or file.

    Args:
        wavelength_um: Nodes, increasing, two or more [um].
        value: The fraction at each, 0 to 1.
        file: A table (CSV, ECSV, FITS) with a column of wavelengths that states its unit, as in `wavelength_um`, and a
            column of fractions; read on first use, and kept.
        column: Name of the column of fractions, for a file with several.
    """

    wavelength_um: Wavelengths | None = None
    value: Fractions | None = None
    file: FileName | None = None
    column: str | None = None

    @model_validator(mode="after")
    def _one_source(self) -> ByWavelength:
        if self._is_inline("wavelength_um", "value"):
            if self.column is not None:
                raise InputError("belongs to a file, which is not given", "column", self.column)
            self.curve  # noqa: B018  # checked here, where the field's path is known
        return self

    @cached_property
    def _content(self) -> CurveFile:
        return read_curve(str(self.file), self.column)

    @cached_property
    def curve(self) -> Curve:
        """Nodes and values.

        Raises:
            InputError: The file cannot be read, or holds no fractions.
        """
        if self.file is None:
            return Curve(*checked_curve(np.array(self.wavelength_um), np.array(self.value), "value"))
        wavelength_um, value, _ = self._content
        if value.max() > 1.0:
            raise InputError("must hold fractions from 0 to 1", value=float(value.max()), form="g").of(self.file)
        return Curve(wavelength_um, value)

    @property
    def checksum(self) -> str | None:
        """SHA-256 of the file, in hexadecimal; None for nodes.

        Raises:
            InputError: The file cannot be read.
        """
        return None if self.file is None else self._content.sha256


_FIELDS = tuple(ByWavelength.__dataclass_fields__)


def _unit_fraction(value: Any, info: ValidationInfo) -> Any:
    """One number from 0 to 1 for all bands, or a table of them."""
    if not isinstance(value, Mapping):
        return number_within(value, info, 0, 1)
    if not value:
        raise rule_error("must be a number or a table that names a band")
    return band_table(value, info, 0, 1)


def _spectral_fraction(value: Any, info: ValidationInfo) -> Any:
    """A number, a table by band, or a fraction by wavelength."""
    if isinstance(value, ByWavelength):
        return value
    if not (isinstance(value, Mapping) and set(_FIELDS) & set(value)):  # else a table by band
        return _unit_fraction(value, info)
    try:
        return adapter(ByWavelength).validate_python(dict(value))
    except ValidationError as report:
        raise input_error(report) from None


def _plain(value: Any) -> Any:
    if isinstance(value, ByWavelength):
        given = {name: getattr(value, name) for name in _FIELDS if getattr(value, name) is not None}
        return {name: list(own) if isinstance(own, tuple) else own for name, own in given.items()}
    return dict(value) if isinstance(value, Mapping) else value


UnitFractionByBand = Annotated[float | Mapping[str, float], PlainValidator(_unit_fraction), AS_DICT]
"""A fraction from 0 to 1, one for all bands or a table by band."""

SpectralFraction = Annotated[
    float | Mapping[str, float] | ByWavelength, PlainValidator(_spectral_fraction), PlainSerializer(_plain)
]
"""A fraction from 0 to 1, one for all bands, a table by band, or by wavelength."""


@config_model
class Graybody:
    """Opaque surface that emits and reflects alike in all directions.

    Emissivity = 1 - reflectance, at every wavelength. Each is a number for all wavelengths, a table by band like
    {"A": 0.9, "C": 0.85}, or a ByWavelength (in files a table of its fields), which serves any band: its emissivity in
    a band then depends on the body's temperature, and its reflectance on the light. A band in which both are given and
    do not add up to 1 is an error; of a surface by wavelength one is given.

    Args:
        reflectance: Diffuse reflectance, 0 to 1.
        emissivity: Emissivity, 0 to 1.
    """

    reflectance: SpectralFraction | None = None
    emissivity: SpectralFraction | None = None

    @model_validator(mode="after")
    def _opaque(self) -> Graybody:
        both = (self.reflectance, self.emissivity)
        if both == (None, None):
            raise InputError("give reflectance or emissivity")
        if self.is_spectral:
            if None not in both:
                raise InputError("one of them must be given where it is by wavelength", "reflectance, emissivity")
            return self
        for band in named_bands(*both) or [""]:
            reflected, emitted = _in_band(self.reflectance, band), _in_band(self.emissivity, band)
            if reflected is None or emitted is None or abs(reflected + emitted - 1) <= OPAQUE_TOLERANCE:
                continue
            where = f" in band {band}" if band else ""
            rule, total = f"must be 1 (opaque graybody){where}", reflected + emitted
            raise InputError(rule, value=total, form="g").of("emissivity + reflectance")
        return self

    @property
    def is_spectral(self) -> bool:
        """Whether the surface is described by wavelength."""
        return isinstance(self.reflectance, ByWavelength) or isinstance(self.emissivity, ByWavelength)

    @property
    def emissivity_curve(self) -> Curve:
        """Emissivity of a surface by wavelength.

        Raises:
            InputError: The surface is not described by wavelength, or its file cannot be read.
        """
        if isinstance(self.emissivity, ByWavelength):
            return self.emissivity.curve
        if isinstance(self.reflectance, ByWavelength):
            wavelength_um, reflectance = self.reflectance.curve
            return Curve(wavelength_um, 1.0 - reflectance)
        raise InputError("must be described by wavelength", "surface")

    def describes(self, band: Band | str) -> bool:
        """Return whether the surface is described in a band."""
        return any(
            value is not None and (not isinstance(value, Mapping) or _name(band) in value)
            for value in (self.reflectance, self.emissivity)
        )

    def emissivity_in(self, band: Band | str, temperature_k: float | None = None) -> float:
        """Emissivity in a band, whichever of the two was given.

        Args:
            band: A Band, or its name.
            temperature_k: Of the body [K]; needed for a surface by wavelength, whose emissivity is averaged with the
                weight of Planck's law.

        Raises:
            InputError: The surface is not described in that band, or needs a temperature.
        """
        if self.is_spectral:
            if temperature_k is None:
                raise InputError("must be given for a surface by wavelength", "temperature_k")
            band = as_band(band)
            weighted, plain = _emitted(band, temperature_k, self.emissivity_curve)
            if plain == 0.0:  # so cold that only the band's longest wavelength would be seen
                return float(self.emissivity_curve.at(band.lit_um[1]))
            return float(weighted / plain)
        emitted = _in_band(self.emissivity, _name(band))
        return emitted if emitted is not None else 1.0 - self._needed(self.reflectance, _name(band))

    def emitted_w_m2_sr(self, temperature_k: ArrayLike, band: Band | str) -> NDArray[np.float64]:
        """Radiance that the surface emits in a band [W/m2/sr], for temperatures [K] of any shape.

        Raises:
            InputError: The surface is not described in that band.
        """
        if self.is_spectral:
            return np.asarray(_emitted(as_band(band), temperature_k, self.emissivity_curve)[0])
        return np.asarray(self.emissivity_in(band) * band_radiance_w_m2_sr(temperature_k, band))

    def reflectance_in(self, band: Band | str, light: Light = "sun") -> float:
        """Reflectance in a band, whichever of the two was given.

        Args:
            band: A Band, or its name.
            light: What falls on the surface; with its spectrum a surface by wavelength is averaged.

        Raises:
            InputError: The surface is not described in that band.
        """
        if self.is_spectral:
            wavelength_um, emissivity = self.emissivity_curve
            node_um, weight = _RULES[light](as_band(band), wavelength_um)
            if weight.sum() == 0.0:  # beyond the light's spectrum
                node_um, weight = band_rule(as_band(band), wavelength_um)
            return float(weight @ np.interp(node_um, wavelength_um, 1.0 - emissivity) / weight.sum())
        reflected = _in_band(self.reflectance, _name(band))
        return reflected if reflected is not None else 1.0 - self._needed(self.emissivity, _name(band))

    def _needed(self, value: Any, band: str) -> float:
        fraction = _in_band(value, band)
        if fraction is None:
            found = ", ".join(named_bands(self.reflectance, self.emissivity))
            raise InputError(f"must give reflectance or emissivity in band {band}, got them in {found}", "surface")
        return fraction


def _emitted(band: Band, temperature_k: ArrayLike, emissivity: Curve) -> tuple[Any, Any]:
    """In-band radiance [W/m2/sr] of a surface, and of a blackbody, at temperatures of any shape."""
    node_um, weight_um = band_rule(
        band, emissivity.wavelength_um, n_node=_NODES_PER_PIECE, max_log_width=_MAX_PIECE_LOG_WIDTH
    )
    radiance = planck_w_m2_sr_um(node_um, np.asarray(temperature_k, dtype=np.float64)[..., None])
    return radiance @ (weight_um * emissivity.at(node_um)), radiance @ weight_um


def _name(band: Band | str) -> str:
    return band.name if isinstance(band, Band) else band


def _in_band(value: Any, band: str) -> float | None:
    return value.get(band) if isinstance(value, Mapping) else value
