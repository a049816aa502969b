"""Spectral bands of a scene: shipped ones by name, those that it describes itself, and Band objects in its sensors."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, PlainValidator, ValidationError, model_validator

from warpsim.arrays import F64
from warpsim.config.fields import MOST_LETTERS, FileName, Number, Positive, Switch, as_tuple, rows_in, rule_error
from warpsim.config.model import adapter, config_model, input_error
from warpsim.errors import InputError, errors_at
from warpsim.exchange.curve_file import CurveFile, read_curve
from warpsim.radiometry.band import ZERO_POINT, Band
from warpsim.radiometry.bands import SHIPPED
from warpsim.radiometry.by_band import AS_DICT, BAND_NAME, ByBand
from warpsim.radiometry.curve_nodes import product
from warpsim.scene.short_form import with_paths

RANGE_UM = (0.3, 30.0)
"""Wavelengths within which the half-power points of a scene's bands lie [um]: where spectra of stars are known."""

RESPONSE_UM = (0.28, 45.0)
"""Wavelengths outside which responses are 0 [um]: those of the templates of stars."""

_LEAST_NM = 100.0
"""Wavelengths beyond are far from any band's in um, and usual in nm."""

_POINTS = ("isophotal_um", "zero_mag_jy", "zero_mag_w_cm2", "w_cm2_per_jy")
"""Fields that a band has besides its response and half-power points; NaN where unknown."""


def _is_rising(edges: tuple[float, float]) -> tuple[float, float]:
    if edges[0] >= edges[1]:
        raise rule_error("must increase")
    return edges


@config_model
class BandDescription:
    """A spectral band: give half_power_um, or wavelength_um with response, or file, or files, or shipped.

    Args:
        half_power_um: Lower and upper edge of a top hat [um]: response 1 between them, 0 outside. Beside a response
            from nodes or files, its half-power points instead of the outermost crossings of half the peak.
        wavelength_um: Nodes of the response [um], increasing.
        response: Response at the nodes, relative; linear between them, 0 outside.
        file: Table of wavelengths and response (CSV, ECSV, FITS, VOTable); the column of wavelengths states its unit.
            It is read on first use, and kept.
        files: Several such tables, of two columns each, whose product is the response: filter, telescope, quantum
            efficiency.
        column: Name of the file's column of the response, where it has several.
        shipped: Name of a shipped band (`warpsim.bands()`) that this one is another name of.
        per_photon: Whether the response is that per photon, as a quantum efficiency is; per energy when left out.
        isophotal_um: Isophotal wavelength [um]; the mean over the response when left out.
        zero_mag_jy: Flux density of a star of magnitude 0 [Jy]; 3631 for AB magnitudes.
        zero_mag_w_cm2: In-band irradiance of a star of magnitude 0 [W/cm2]; follows from zero_mag_jy, or the other way
            round.
        w_cm2_per_jy: In-band irradiance per flux density [W/cm2 per Jy]; of the mean flux density by frequency when
            left out.
    """

    half_power_um: Annotated[tuple[Positive, Positive], AfterValidator(_is_rising)] | None = None
    wavelength_um: Annotated[tuple[Number, ...], rows_in("um")] | None = None
    response: Annotated[tuple[Number, ...], rows_in("")] | None = None
    file: FileName | None = None
    files: Annotated[tuple[FileName, ...], BeforeValidator(as_tuple)] | None = None
    column: str | None = None
    shipped: str | None = None
    per_photon: Switch = False
    isophotal_um: Positive | None = None
    zero_mag_jy: Positive | None = None
    zero_mag_w_cm2: Positive | None = None
    w_cm2_per_jy: Positive | None = None

    @model_validator(mode="after")
    def _one_source(self) -> BandDescription:
        sources = ("half_power_um", "wavelength_um", "file", "files", "shipped")
        given = [name for name in sources if getattr(self, name) is not None]
        if len(given) == 2 and given[0] == "half_power_um" and given[1] != "shipped":
            given = given[1:]  # points of a response, no top hat
        if len(given) != 1:
            raise InputError(f"exactly one must be given, got {', '.join(given) or 'none'}", ", ".join(sources))
        if (self.wavelength_um is None) != (self.response is None):
            raise InputError("must be given together", "wavelength_um, response")
        if self.column is not None and self.file is None:
            raise InputError("belongs to file", "column")
        if self.files is not None and not self.files:
            raise InputError("must name at least one", "files")
        if self.shipped is not None and self.shipped not in SHIPPED:
            raise InputError(unknown_rule(self.shipped, {}), "shipped", self.shipped)
        for name in ("per_photon", *_POINTS):
            if self.shipped is not None and getattr(self, name):
                raise InputError("must be left out with shipped, which has its own", name)
        if not self.paths:
            self.band("band")  # a response that is none is found here
        return self

    @staticmethod
    def fields_of(band: Band) -> dict[str, Any]:
        """Return the fields of a band's description: of a plain top hat its edges, else the nodes."""
        plain = Band(band.name, band.wavelength_um, band.response, per_photon=band.per_photon)
        nodes_um, response = band.wavelength_um.tolist(), band.response.tolist()
        points = {name: getattr(band, name) for name in ("half_power_um", "isophotal_um")}
        points = {name: value for name, value in points.items() if value != getattr(plain, name)}
        points |= _fewest_zero_points(plain, band)
        top_hat = response == [1.0, 1.0] and "half_power_um" not in points
        curve = {"half_power_um": nodes_um} if top_hat else {"wavelength_um": nodes_um, "response": response}
        return {**curve, "per_photon": band.per_photon, **points}

    def band(self, name: str) -> Band:
        """Return the band under a name; its files are read on first use.

        Raises:
            InputError: A file cannot be read, the response is none, or it is not within RANGE_UM.
        """
        if self.shipped is not None:
            return dataclasses.replace(SHIPPED[self.shipped], name=name)
        points = {point: value for point in _POINTS if (value := getattr(self, point)) is not None}
        wavelength_um, response = self._curve
        if self.half_power_um is not None:
            points["half_power_um"] = self.half_power_um
        try:
            band = Band(name, wavelength_um, response, per_photon=self.per_photon, **points)
        except InputError as error:
            raise InputError(error.rule, error.field, error.value, "g").of(", ".join(self.paths)) from None
        _check_range(band, ", ".join(self.paths))
        return band

    @property
    def _curve(self) -> tuple[F64, F64]:
        """Nodes [um] and response."""
        if self.files is not None:
            curves = [(content.wavelength_um, content.value) for content in self._contents]
            with errors_at("files"):
                return product(curves, self.files)
        if self.file is not None:
            return self._contents[0].wavelength_um, self._contents[0].value
        if self.wavelength_um is not None:
            return np.array(self.wavelength_um), np.array(self.response)
        return np.array(self.half_power_um), np.ones(2)

    @property
    def peak(self) -> float:
        """Largest value of the response as given, which the band scales to 1; 1 for a top hat and a shipped band.

        Raises:
            InputError: A file cannot be read.
        """
        return 1.0 if self.shipped is not None else float(self._curve[1].max())

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths of the files."""
        return (self.file,) if self.file is not None else self.files or ()

    @cached_property
    def _contents(self) -> tuple[CurveFile, ...]:
        return tuple(read_curve(path, self.column) for path in self.paths)

    @property
    def checksums(self) -> dict[str, str]:
        """SHA-256 of the bytes that the band was made from, by the file's path.

        Raises:
            InputError: A file cannot be read.
        """
        return {path: content.sha256 for path, content in zip(self.paths, self._contents, strict=True)}


def _check_range(band: Band, files: str) -> None:
    """Check that a band lies where the spectra of stars are known."""
    low_um, high_um = band.half_power_um
    if low_um < RANGE_UM[0] or high_um > RANGE_UM[1]:
        rule = f"must lie within {RANGE_UM[0]:g} to {RANGE_UM[1]:g} um, got {low_um:g} to {high_um:g} um"
        rule += "; are these nm?" if low_um > _LEAST_NM else ""
        raise InputError(rule, "half_power_um").of(files)
    first_um, last_um = band.lit_um
    if first_um < RESPONSE_UM[0] or last_um > RESPONSE_UM[1]:
        rule = f"must be 0 outside {RESPONSE_UM[0]:g} to {RESPONSE_UM[1]:g} um, got {first_um:g} to {last_um:g} um"
        raise InputError(rule, "response").of(files)


def description_of(name: str, given: Any) -> BandDescription:
    """Return the description of a band, of a table of fields or of a Band object."""
    if isinstance(given, Band):
        if given.name != name:
            raise InputError(f"must be the band's own name, {given.name}", name)
        given = BandDescription.fields_of(given)
    try:
        return adapter(BandDescription).validate_python(given)  # type: ignore[no-any-return]
    except ValidationError as error:
        raise input_error(error).within(name) from None


def _fewest_zero_points(plain: Band, band: Band) -> dict[str, float]:
    """Numbers that a band's zero point follows from, so that a change of one is no contradiction to the others."""
    known = {name: value for name in ZERO_POINT if not math.isnan(value := getattr(band, name))}
    jy, w_cm2, per_jy = ZERO_POINT
    for names in ((), (jy,), (w_cm2,), (jy, per_jy), (w_cm2, per_jy), (jy, w_cm2)):
        points = {name: known[name] for name in names if name in known}
        made = dataclasses.replace(plain, **points)
        if all(getattr(made, name) == value for name, value in known.items()):
            return points
    return known


def _descriptions(value: Any) -> ByBand[BandDescription]:
    """Descriptions by name, of tables of fields or of Band objects."""
    if not isinstance(value, Mapping):
        raise rule_error("must be a table of bands by name")
    for name in value:
        if not BAND_NAME.fullmatch(str(name)):
            raise rule_error(f"must be names of letters, digits, '_', '.' or '-', at most {MOST_LETTERS}")
        if name in SHIPPED:
            raise InputError("must be no shipped band's name", name)
    return ByBand({name: description_of(name, given) for name, given in value.items()})


BandDescriptions = Annotated[Mapping[str, BandDescription], PlainValidator(_descriptions), AS_DICT]
"""Bands that a scene describes, by name; a Band object stands for its description."""


def unknown_rule(name: str, own: Iterable[str]) -> str:
    """Return the rule that a name of a band breaks which is neither a scene's own nor shipped."""
    own = list(own)
    mine = f"one of the scene's ({', '.join(own)}) or " if own else ""
    close = [*_close(name, own), *_close(name, SHIPPED)]
    hint = f"is no band (did you mean {close[0]}?); " if close else ""
    return f"{hint}must be {mine}a shipped band ({', '.join(SHIPPED)})"


def _close(name: str, bands: Iterable[str]) -> list[str]:
    """The band whose name is closest to another name, whatever the case; none if no name is close."""
    known = {band.casefold(): band for band in bands}
    return [known[found] for found in difflib.get_close_matches(name.casefold(), known, n=1)]


def find_band(name: str, descriptions: Mapping[str, BandDescription]) -> Band:
    """Return a band by name, the scene's own or a shipped one."""
    if name in descriptions:
        with errors_at(f"band.{name}"):
            return descriptions[name].band(name)
    if name not in SHIPPED:
        raise InputError(unknown_rule(name, descriptions), value=name)
    return SHIPPED[name]


def needs_file(name: str, descriptions: Mapping[str, BandDescription]) -> bool:
    """Return whether a file must be read to know a band."""
    return name in descriptions and bool(descriptions[name].paths)


def parts_with_bands(sensors: Sequence[Any], groups: Sequence[Any], lighting: Any) -> list[tuple[str, Any]]:
    """Return the parts of a scene that may hold tables by band, each with its field path."""
    return [*with_paths("sensors", sensors), *with_paths("groups", groups), ("lighting", lighting)]


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


def _name_or_band(value: Any) -> Any:
    if isinstance(value, Band):
        return value
    if not isinstance(value, str):
        raise rule_error("must be the name of a band, or a Band")
    return value


def _as_tuple(value: Any) -> Any:
    if isinstance(value, str | Band):
        return (value,)
    if isinstance(value, Mapping):
        raise rule_error("must be a list of names, which a table may describe (did you mean band?)")
    return as_tuple(value)


BandNames = Annotated[tuple[Annotated[str, PlainValidator(_name_or_band)], ...], BeforeValidator(_as_tuple)]
"""Names of bands; Band objects too, which a scene takes among its own bands."""


def _bands_of(sensor: Any) -> Sequence[Any]:
    """Names and objects that a sensor, or its table of fields, gives as its bands; none where it gives no list."""
    bands = sensor.get("bands") if isinstance(sensor, Mapping) else getattr(sensor, "bands", None)
    if isinstance(bands, Band | str):
        return (bands,)
    return bands if isinstance(bands, list | tuple) else ()


def with_names(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a scene with names for the Band objects of its sensors, which join the scene's own bands."""
    result, found = dict(values), dict[str, Band]()
    sensors = result.get("sensors")
    if not isinstance(sensors, list | tuple):
        return result
    named = []
    for sensor in sensors:
        bands = _bands_of(sensor)
        if not any(isinstance(band, Band) for band in bands):
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
        for name in own.keys() & given.keys():
            if _differs(name, given[name], own[name]):
                raise InputError("must be the Band of that name in bands, or be left out", f"band.{name}")
        result["band"] = {**own, **given}
    return {**result, "sensors": named} if found else result


def _differs(name: str, given: Any, band: Band) -> bool:
    """Return whether a description is of another band, as far as that is known without its files."""
    with errors_at("band"):
        description = description_of(name, given)
    return bool(description.paths) or description.band(name) != band


def without_superseded(values: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a changed scene less descriptions of bands that its sensors now name by objects only."""
    sensors, given = values.get("sensors"), values.get("band")
    if not isinstance(sensors, list | tuple) or not isinstance(given, Mapping):
        return values
    named = [band for sensor in sensors for band in _bands_of(sensor)]
    gone = {band.name for band in named if isinstance(band, Band)} - {band for band in named if isinstance(band, str)}
    return {**values, "band": {name: entry for name, entry in given.items() if name not in gone}}
