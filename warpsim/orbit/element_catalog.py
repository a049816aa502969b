"""Satellites of catalogs of element sets: their names, which of them are chosen, and which must be left out."""

from __future__ import annotations

import difflib
import fnmatch
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from warpsim.errors import InputError
from warpsim.exchange.element_set import ElementRecord, ElementSet, label
from warpsim.exchange.segments import plain_name


class Satellite(NamedTuple):
    """One object with all the element sets that there are of it."""

    name: str
    """Unique in its source; letters, digits, `_ . -`."""
    sets: tuple[ElementSet, ...]

    def set_for(self, epoch_jd_utc: float) -> ElementSet:
        """The element set nearest to an instant."""
        return min(self.sets, key=lambda item: abs(sum(item.epoch_jd_utc) - epoch_jd_utc))


class LeftOut(NamedTuple):
    """An element set that a constellation does without."""

    name: str
    """Of the object, as constellations call it."""
    norad_id: int | None
    location: str
    """Line or record of the source: `line 3`."""
    reason: str
    """In one line."""


@dataclass(frozen=True)
class Catalog:
    """The objects of a source that are chosen."""

    satellites: tuple[Satellite, ...]
    left_out: tuple[LeftOut, ...]
    skips: bool
    """Whether what is not valid is left out, and no error."""
    unmatched: tuple[str, ...] = ()
    """What `exclude` names that is not there."""


OfSource = Callable[[InputError], InputError]
"""Puts the source before an error."""


class _Object(NamedTuple):
    """An object with its records, as far as they are known without parsing."""

    name: str
    records: list[ElementRecord]


def read_catalog(
    records: Sequence[ElementRecord],
    of_source: OfSource,
    only: Sequence[str] | None = None,
    exclude: Sequence[str] = (),
    skip: bool | None = None,
) -> Catalog:
    """Choose objects of a catalog by name and number, and parse the sets of these alone.

    Args:
        records: The element sets as they stand in the source.
        of_source: Puts the source before an error.
        only: Names or numbers of the objects to take, with `*` and `?`; all if left out.
        exclude: Those not to take.
        skip: Whether what is not valid is left out, and no error. By default it is, but for a single set.

    Raises:
        InputError: `only` names no object, a set is not valid, or none is.
    """
    skips = len(records) > 1 if skip is None else skip
    objects, left_out = _named(records, of_source, skips)
    excluded = [_matches(objects, pattern) for pattern in exclude]
    kept = set(range(len(objects))).difference(*excluded)
    if only is not None:
        kept &= set().union(*(_some_matches(objects, pattern, "only") for pattern in only))
        left_out = []
    found = []
    for index in sorted(kept):
        satellite = _parsed(objects[index], of_source, left_out if skips else None)
        found += [satellite] if satellite.sets else []
    if not found:
        first = f" ({left_out[0].location}: {left_out[0].reason})" if left_out else ""
        raise of_source(InputError(f"must leave an element set, got none of {len(records)}{first}"))
    unmatched = (pattern for pattern, some in zip(exclude, excluded, strict=True) if not some)
    return Catalog(tuple(found), tuple(left_out), skips, tuple(unmatched))


def choose_one(records: Sequence[ElementRecord], of_source: OfSource, name: str | None) -> Catalog:
    """Choose the only object of a catalog, or the one of a name or number; the sets of no other are parsed.

    Of its sets those that are not valid are left out.

    Raises:
        InputError: There is none, there are several, or none of its sets is valid.
    """
    if name is None:
        for record in records:
            _ = _parsed(_Object("", [record]), of_source)
    objects, left_out = _named(records, of_source, skips=name is not None)
    chosen = range(len(objects)) if name is None else sorted(_some_matches(objects, name, "object"))
    if len(chosen) > 1:
        names = ", ".join(objects[index].name for index in chosen[:3]) + (", ..." if len(chosen) > 3 else "")
        raise InputError(f"must choose one of {len(chosen)} objects ({names})", "object", name)
    item, left_out = objects[chosen[0]], []
    satellite = _parsed(item, of_source, left_out)
    if not satellite.sets:
        _ = _parsed(item, of_source)
    return Catalog((satellite,), tuple(left_out), skips=True)


def _parsed(item: _Object, of_source: OfSource, left_out: list[LeftOut] | None = None) -> Satellite:
    """An object with its valid sets; the others go to `left_out`, or are an error without it."""
    sets = []
    for record in item.records:
        try:
            sets.append(record.parse())
        except InputError as error:
            if left_out is None:
                raise of_source(error) from None
            left_out.append(_left_out(item.name, record, error))
    return Satellite(item.name, tuple(sets))


def _left_out(name: str, record: ElementRecord, error: InputError) -> LeftOut:
    """What is wrong with a record, without the line and the names that it has besides."""
    text = str(error)
    for part in filter(None, (label(record.name, record.norad_id), record.name)):
        text = text.replace(f"{part}: ", "", 1)
    return LeftOut(name, record.norad_id, record.location, text.removeprefix(f"{record.location}: "))


def _named(records: Iterable[ElementRecord], of_source: OfSource, skips: bool) -> tuple[list[_Object], list[LeftOut]]:
    """Objects with all their records, with names made unique, and those for which there is no unique name."""
    grouped: dict[Any, list[ElementRecord]] = {}
    for item in records:
        location = "" if item.name else item.location
        key = item.norad_id if item.norad_id is not None else (item.name, item.designator, location)
        grouped.setdefault(key, []).append(item)
    first = [group[0] for group in grouped.values()]
    # Names that can be a file's, of the catalog number where there is no other.
    plain = [plain_name(one.name, "satellite" if one.norad_id is None else f"norad{one.norad_id:05d}") for one in first]
    twice = {name for name, count in Counter(plain).items() if count > 1}
    names = [f"{name}-{_identifier(one)}" if name in twice else name for name, one in zip(plain, first, strict=True)]
    objects: dict[str, _Object] = {}
    left_out: list[LeftOut] = []
    for name, group in zip(names, grouped.values(), strict=True):
        if name not in objects:
            objects[name] = _Object(name, group)
            continue
        one = group[0]
        satellite = _parsed(_Object(name, group), of_source, left_out if skips else None)
        if satellite.sets:
            error = InputError(f"name must be unique, got {name} twice")
            if not skips:
                raise of_source(error.of(label(one.name, one.norad_id)).of(one.location))
            left_out.append(_left_out(name, one, error))
    return list(objects.values()), left_out


def _identifier(item: ElementRecord) -> str:
    known = item.designator if item.norad_id is None else f"{item.norad_id:05d}"
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", known)


def _matches(objects: Sequence[_Object], pattern: str) -> set[int]:
    """Indices of the objects whose name (as in the source or cleaned) or catalog number is the pattern."""
    requested = pattern.strip().upper()
    number = int(requested) if re.fullmatch(r"\d{1,9}", requested, re.ASCII) else None
    # A name may hold brackets, which are no wild cards here.
    fits = re.compile(fnmatch.translate(re.sub(r"\[", "[[]", requested))).match
    found = set()
    for index, item in enumerate(objects):
        one = item.records[0]
        if number == one.norad_id is not None or any(
            map(fits, (one.name.upper(), item.name.upper(), f"{one.norad_id}"))
        ):
            found.add(index)
    return found


def _some_matches(objects: Sequence[_Object], pattern: str, field: str) -> set[int]:
    """Those that match, which must be there."""
    found = _matches(objects, pattern)
    if not found:
        close = difflib.get_close_matches(pattern.strip().upper(), [item.name.upper() for item in objects], n=1)
        hint = next((f" (did you mean {item.name}?)" for item in objects if [item.name.upper()] == close), "")
        raise InputError(f"no object of that name or catalog number, got {pattern!r}{hint}", field)
    return found
