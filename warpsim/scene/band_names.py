"""Names of bands in a scene's sensors, and the Band objects that may stand for them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import BeforeValidator, PlainValidator

from warpsim.config.fields import rule_error
from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import SHIPPED
from warpsim.scene.band_descriptions import description_of


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
    if not isinstance(value, list | tuple):
        raise rule_error("must be a list")
    return tuple(value)


BandNames = Annotated[tuple[Annotated[str, PlainValidator(_name_or_band)], ...], BeforeValidator(_as_tuple)]
"""Names of bands; Band objects too, which a scene takes among its own bands."""


def _bands_of(sensor: Any) -> Sequence[Any]:
    """Names and objects that a sensor, or its table of fields, gives as its bands; none where it gives no list."""
    bands = sensor.get("bands") if isinstance(sensor, Mapping) else getattr(sensor, "bands", None)
    if isinstance(bands, Band | str):
        return (bands,)
    return bands if isinstance(bands, list | tuple) else ()


def with_names(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a scene with names for the Band objects of its sensors, which join the scene's own bands.

    Raises:
        InputError: Two objects of one name differ, or an object from the description of its name.
    """
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
    try:
        description = description_of(name, given)
    except InputError as error:
        raise error.within("band") from None
    return bool(description.paths) or description.band(name) != band


def without_superseded(values: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a changed scene less descriptions of bands that its sensors now name by objects only."""
    sensors, given = values.get("sensors"), values.get("band")
    if not isinstance(sensors, list | tuple) or not isinstance(given, Mapping):
        return values
    named = [band for sensor in sensors for band in _bands_of(sensor)]
    gone = {band.name for band in named if isinstance(band, Band)} - {band for band in named if isinstance(band, str)}
    return {**values, "band": {name: entry for name, entry in given.items() if name not in gone}}
