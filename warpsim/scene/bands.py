"""Spectral bands of a scene: shipped ones by name, and those that it describes itself."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, PlainValidator, ValidationError, model_validator

from warpsim.config.fields import FileName, Number, Positive, Switch, rows_in, rule_error
from warpsim.config.model import adapter, config_model, input_error
from warpsim.errors import InputError
from warpsim.exchange.curve_file import read_curve
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import SHIPPED
from warpsim.radiometry.by_band import AS_DICT, BAND_NAME, ByBand

RANGE_UM = (0.3, 30.0)
"""Wavelengths within which the half-power points of a scene's bands lie [um]: where spectra of stars are known."""

RESPONSE_UM = (0.28, 45.0)
"""Wavelengths outside which responses are 0 [um]: those of the templates of stars."""

_POINTS = ("isophotal_um", "zero_mag_jy", "zero_mag_w_cm2", "w_cm2_per_jy")
"""Fields that a band has besides its response; NaN where unknown."""


def _is_rising(edges: tuple[float, float]) -> tuple[float, float]:
    if edges[0] >= edges[1]:
        raise rule_error("must increase")
    return edges


@config_model
class BandDescription:
    """A spectral band: give half_power_um, or wavelength_um with response, or file, or shipped.

    Args:
        half_power_um: Lower and upper edge of a top hat [um]: response 1 between them, 0 outside.
        wavelength_um: Nodes of the response [um], increasing.
        response: Response at the nodes, relative; linear between them, 0 outside.
        file: Table of wavelengths and response (CSV, ECSV, FITS, VOTable); the column of wavelengths states its unit.
        column: Name of the file's column of the response, where it has several.
        shipped: Name of a shipped band (`warpsim.bands()`) that this one is another name of.
        per_photon: Whether the response is that per photon, as a quantum efficiency is; per energy when left out.
        isophotal_um: Isophotal wavelength [um]; the mean over the response when left out.
        zero_mag_jy: Flux density of a star of magnitude 0 [Jy].
        zero_mag_w_cm2: In-band irradiance of a star of magnitude 0 [W/cm2].
        w_cm2_per_jy: In-band irradiance per flux density [W/cm2 per Jy].
    """

    half_power_um: Annotated[tuple[Positive, Positive], AfterValidator(_is_rising)] | None = None
    wavelength_um: Annotated[tuple[Number, ...], rows_in("um")] | None = None
    response: Annotated[tuple[Number, ...], rows_in("")] | None = None
    file: FileName | None = None
    column: str | None = None
    shipped: str | None = None
    per_photon: Switch = False
    isophotal_um: Positive | None = None
    zero_mag_jy: Positive | None = None
    zero_mag_w_cm2: Positive | None = None
    w_cm2_per_jy: Positive | None = None

    @model_validator(mode="after")
    def _one_source(self) -> BandDescription:
        sources = ("half_power_um", "wavelength_um", "file", "shipped")
        given = [name for name in sources if getattr(self, name) is not None]
        if len(given) != 1:
            raise InputError(f"exactly one must be given, got {', '.join(given) or 'none'}", ", ".join(sources))
        if (self.wavelength_um is None) != (self.response is None):
            raise InputError("must be given together", "wavelength_um, response")
        if self.column is not None and self.file is None:
            raise InputError("belongs to file", "column")
        if self.shipped is not None:
            if self.shipped not in SHIPPED:
                raise InputError(unknown_rule(self.shipped, {}), "shipped", self.shipped)
            for name in ("per_photon", *_POINTS):
                if getattr(self, name):
                    raise InputError("must be left out with shipped, which has its own", name)
        if self.file is None:
            self.band("band")  # a response that is none is found here
        return self

    @staticmethod
    def fields_of(band: Band) -> dict[str, Any]:
        """Return the fields of a band's description."""
        points = {name: getattr(band, name) for name in _POINTS}
        return {
            "wavelength_um": tuple(band.wavelength_um.tolist()),
            "response": tuple(band.response.tolist()),
            "per_photon": band.per_photon,
            **{name: value for name, value in points.items() if not math.isnan(value)},
        }

    def band(self, name: str) -> Band:
        """Return the band under a name; its file is read.

        Raises:
            InputError: The file cannot be read, the response is none, or it is not within RANGE_UM.
        """
        if self.shipped is not None:
            return dataclasses.replace(SHIPPED[self.shipped], name=name)
        points = {point: value for point in _POINTS if (value := getattr(self, point)) is not None}
        if self.half_power_um is not None:
            wavelength_um, response = np.array(self.half_power_um), np.ones(2)
        elif self.file is not None:
            wavelength_um, response, _ = read_curve(self.file, self.column)
        else:
            wavelength_um, response = np.array(self.wavelength_um), np.array(self.response)
        try:
            band = Band(name, wavelength_um, response, per_photon=self.per_photon, **points)
        except InputError as error:
            raise InputError(error.rule, error.field, error.value, "g").of(self.file or "") from None
        low_um, high_um = band.half_power_um
        if low_um < RANGE_UM[0] or high_um > RANGE_UM[1]:
            rule = f"must lie within {RANGE_UM[0]:g} to {RANGE_UM[1]:g} um, got {low_um:g} to {high_um:g} um"
            raise InputError(rule, "half_power_um").of(self.file or "")
        first_um, last_um = band.lit_um
        if first_um < RESPONSE_UM[0] or last_um > RESPONSE_UM[1]:
            rule = f"must be 0 outside {RESPONSE_UM[0]:g} to {RESPONSE_UM[1]:g} um, got {first_um:g} to {last_um:g} um"
            raise InputError(rule, "response").of(self.file or "")
        return band

    @property
    def checksum(self) -> str:
        """SHA-256 of the file.

        Raises:
            InputError: There is none, or it cannot be read.
        """
        if self.file is None:
            raise InputError("there is no file", "file")
        return read_curve(self.file, self.column).sha256


def _descriptions(value: Any) -> ByBand[BandDescription]:
    """Descriptions by name, of tables of fields or of Band objects."""
    if not isinstance(value, Mapping):
        raise rule_error("must be a table of bands by name")
    found = {}
    for name, given in value.items():
        if not BAND_NAME.fullmatch(str(name)):
            raise rule_error("must be names of letters, digits, '_', '.' or '-'")
        if name in SHIPPED:
            raise InputError("must be no shipped band's name", name)
        if isinstance(given, Band):
            if given.name != name:
                raise InputError(f"must be the band's own name, {given.name}", name)
            given = BandDescription.fields_of(given)
        try:
            found[name] = adapter(BandDescription).validate_python(given)
        except ValidationError as error:
            raise input_error(error).within(name) from None
    return ByBand(found)


BandDescriptions = Annotated[Mapping[str, BandDescription], PlainValidator(_descriptions), AS_DICT]
"""Bands that a scene describes, by name; a Band object stands for its description."""


def _name_or_band(value: Any) -> Any:
    if isinstance(value, Band):
        return value
    if not isinstance(value, str):
        raise rule_error("must be the name of a band, or a Band")
    return value


def _as_tuple(value: Any) -> Any:
    if isinstance(value, str | Band):
        return (value,)
    if not isinstance(value, list | tuple):
        raise rule_error("must be a list")
    return tuple(value)


BandNames = Annotated[tuple[Annotated[str, PlainValidator(_name_or_band)], ...], BeforeValidator(_as_tuple)]
"""Names of bands; Band objects too, which a scene takes among its own bands."""


def with_names(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a scene with names for the Band objects of its sensors, which join the scene's own bands.

    An object goes before a description of the same name.

    Raises:
        InputError: Two objects of one name differ.
    """
    result, found = dict(values), dict[str, Band]()
    sensors = result.get("sensors")
    if not isinstance(sensors, list | tuple):
        return result
    named = []
    for sensor in sensors:
        bands = sensor.get("bands") if isinstance(sensor, Mapping) else getattr(sensor, "bands", None)
        bands = (bands,) if isinstance(bands, Band) else bands
        if not isinstance(bands, list | tuple) or not any(isinstance(band, Band) for band in bands):
            named.append(sensor)
            continue
        for band in bands:
            if isinstance(band, Band) and found.setdefault(band.name, band) != band:
                raise InputError(f"must be one band a name, got two of {band.name}", "bands")
        names = tuple(band.name if isinstance(band, Band) else band for band in bands)
        named.append(
            {**sensor, "bands": names} if isinstance(sensor, Mapping) else dataclasses.replace(sensor, bands=names)
        )
    own = {name: band for name, band in found.items() if SHIPPED.get(name) != band}
    given = {} if result.get("band") is None else result["band"]
    if own and isinstance(given, Mapping):  # what is no table is refused later
        result["band"] = {**given, **own}
    return {**result, "sensors": named} if found else result


def unknown_rule(name: str, own: Iterable[str]) -> str:
    """Return the rule that a name of a band breaks which is neither a scene's own nor shipped."""
    own = list(own)
    mine = f"one of the scene's ({', '.join(own)}) or " if own else ""
    close = difflib.get_close_matches(name, [*own, *SHIPPED], n=1)
    hint = f" (did you mean {close[0]}?)" if close else ""
    return f"must be {mine}a shipped band ({', '.join(SHIPPED)}){hint}"


def find_band(name: str, descriptions: Mapping[str, BandDescription]) -> Band:
    """Return a band by name, the scene's own or a shipped one.

    Raises:
        InputError: There is none, or its description breaks a rule; the path begins with `band`.
    """
    if name in descriptions:
        try:
            return descriptions[name].band(name)
        except InputError as error:
            raise error.within(f"band.{name}") from None
    if name not in SHIPPED:
        raise InputError(unknown_rule(name, descriptions), value=name)
    return SHIPPED[name]


def needs_file(name: str, descriptions: Mapping[str, BandDescription]) -> bool:
    """Return whether a file must be read to know a band."""
    return name in descriptions and descriptions[name].file is not None


def tables_by_band(part: Any, path: str = "") -> Iterator[tuple[str, ByBand[Any]]]:
    """Yield the tables by band within a part of a description, each with its field path."""
    if isinstance(part, ByBand):
        yield path, part
    elif isinstance(part, tuple):
        for number, item in enumerate(part):
            yield from tables_by_band(item, f"{path}[{number}]")
    elif dataclasses.is_dataclass(part):
        for field in dataclasses.fields(part):
            yield from tables_by_band(getattr(part, field.name), f"{path}.{field.name}" if path else field.name)
