"""Satellites by their element sets (TLE, OMM), moved by SGP4.

Sets that are given as text are read on construction; a file is read on first use, and then kept. SGP4 gives states in
TEME of date; they are turned into GCRS axes, without which they would be some 45 km off in 2025. Element sets date
themselves in UTC. The time that SGP4 runs on is the elapsed one, in SI seconds: across a leap second it goes on evenly,
where a difference of UTC dates, which other programs take, would be a second short (7 km along the path, for sets from
before a leap second and scenes behind it; the last one was at the end of 2016).
"""

from __future__ import annotations

import difflib
import fnmatch
import hashlib
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, model_validator

from warpsim.config.fields import FileName, as_tuple, rule_error
from warpsim.config.model import config_model
from warpsim.constants import DAY_S
from warpsim.errors import InputError
from warpsim.exchange.element_set import ElementSet
from warpsim.exchange.elements_files import parse_element_sets, read_element_sets
from warpsim.exchange.segments import plain_name
from warpsim.instant import Instant, tt_jd, utc_time, years_ahead
from warpsim.orbit.earth import frame_to_gcrs

if TYPE_CHECKING:
    from warpsim.instant import Epoch

F64 = NDArray[np.float64]


def _selector(value: Any) -> Any:
    """A catalog number may be given as a number."""
    if isinstance(value, bool) or not isinstance(value, str | int | np.integer):
        raise rule_error("must be a name or a catalog number")
    return str(value)


def _selectors(value: Any) -> Any:
    return as_tuple(str(value) if isinstance(value, int | np.integer) and not isinstance(value, bool) else value)


OLD_DAYS = 30.0
"""Element sets farther than this from the scene are worth a note: SGP4 loses kilometres a day."""

NEAREST_KM, FARTHEST_KM = 6000.0, 1e6
"""Distances from the Earth's centre at which SGP4's states are believed: far from their epoch, sets give any."""

_TT_MINUS_TAI_S = 32.184
_PAIRS_PER_CHUNK = 500_000  # (time, satellite) pairs of SGP4 held at once: some 30 MB


class Satellite(NamedTuple):
    """One object with all the element sets that there are of it."""

    name: str
    """Unique in its source; letters, digits, `_ . -`."""
    sets: tuple[ElementSet, ...]

    def set_for(self, epoch_jd_utc: float) -> ElementSet:
        """The element set nearest to an instant."""
        return min(self.sets, key=lambda item: abs(sum(item.epoch_jd_utc) - epoch_jd_utc))


Lines = Annotated[tuple[str, ...], BeforeValidator(as_tuple)]
Selector = Annotated[str, BeforeValidator(_selector)]
Selectors = Annotated[tuple[Selector, ...], BeforeValidator(_selectors)]


class _FromElementSets:
    """Motion of satellites by SGP4."""

    if TYPE_CHECKING:
        file: str | None
        lines: tuple[str, ...] | None

        @property
        def satellites(self) -> tuple[Satellite, ...]: ...

    @property
    def checksum(self) -> str:
        """SHA-256 of the element sets' numbers as they were read, in hexadecimal."""
        numbers = [(item.name, *(one.numbers for one in item.sets)) for item in self.satellites]
        return hashlib.sha256(repr(numbers).encode()).hexdigest()

    def states(self, epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
        """Return positions [m] and velocities [m/s], GCRS axes, each (n_time, n_satellite, 3).

        Args:
            epoch: The scene's epoch.
            time_s: Times [s since epoch], shape (n_time,).

        Raises:
            InputError: SGP4 has no state for some satellite and time, because it has decayed, say, or one that is
                closer to the Earth's centre than 6,000 km or farther than 1e6 km.
        """
        return _sgp4_states(self.satellites, epoch, time_s)

    def age_days(self, epoch: Epoch) -> F64:
        """Return the ages of the element sets at an epoch [d], negative before theirs, shape (n_satellite,)."""
        return _age_days(self.satellites, epoch)

    def notes(self, epoch: Epoch, duration_s: float) -> list[str]:
        """Return warnings: element sets more than 30 days away from some time of the scene."""
        first = self.age_days(epoch)
        farthest = np.maximum(np.abs(first), np.abs(first + duration_s / DAY_S))
        worst = int(np.argmax(farthest))
        if not farthest[worst] > OLD_DAYS:
            return []
        n_old, name = int(np.sum(farthest > OLD_DAYS)), self.satellites[worst].name
        which = name if n_old == 1 else f"{n_old} satellites, {name} most"
        return [
            f"element sets more than {OLD_DAYS:g} days from the scene: {which} ({farthest[worst]:.0f} days); "
            "SGP4 loses kilometres a day"
        ]

    def _check_source(self) -> None:
        """Check that there is one; sets given as text are read, as the field's path is known now."""
        if (self.file is None) == (self.lines is None):
            raise InputError("exactly one must be given", "file, lines")
        if self.lines is not None:
            self.satellites  # noqa: B018


@config_model
class TleSatellites(_FromElementSets):
    """A constellation of satellites given by element sets; give `file` or `lines`.

    Of several sets of one object, the one nearest to the scene's epoch is taken. A file is read on first use.
    """

    file: FileName | None = None
    """TLE, 3LE, or OMM as KVN, XML, JSON or CSV."""
    lines: Lines | None = None
    """The same as text, line by line."""
    only: Selectors | None = None
    """Names or catalog numbers of the satellites to take, with `*` and `?` as wild cards; all if left out."""
    kind: Literal["tle"] = "tle"

    @model_validator(mode="after")
    def _one_source(self) -> TleSatellites:
        if self.only is not None and not self.only:
            raise InputError("must choose at least one satellite, or be left out", "only")
        self._check_source()
        return self

    @cached_property
    def satellites(self) -> tuple[Satellite, ...]:
        """The satellites, in the order of the source.

        Raises:
            InputError: The file cannot be read or is not valid, or `only` names no satellite of it.
        """
        found = _satellites(self.file, self.lines)
        if self.only is None:
            return found
        chosen = [_matches(found, pattern, "only") for pattern in self.only]
        return tuple(item for item in found if any(item in some for some in chosen))

    @property
    def names(self) -> list[str]:
        """Names of the satellites; without one in the source, `norad` and the catalog number."""
        return [item.name for item in self.satellites]


@config_model
class TleOrbit(_FromElementSets):
    """The path of one object given by element sets; give `file` or `lines`. A file is read on first use."""

    file: FileName | None = None
    """TLE, 3LE, or OMM as KVN, XML, JSON or CSV."""
    lines: Lines | None = None
    """The same as text, line by line."""
    object: Selector | None = None
    """Its name or catalog number; may be left out where the source has one object only."""
    kind: Literal["tle_orbit"] = "tle_orbit"

    @model_validator(mode="after")
    def _one_source(self) -> TleOrbit:
        self._check_source()
        return self

    @cached_property
    def satellites(self) -> tuple[Satellite, ...]:
        """The object, the only one.

        Raises:
            InputError: The file cannot be read or is not valid, or `object` names none or several of its objects.
        """
        found = _satellites(self.file, self.lines)
        chosen = found if self.object is None else tuple(_matches(found, self.object, "object"))
        if len(chosen) > 1:
            names = ", ".join(item.name for item in chosen[:3]) + (", ..." if len(chosen) > 3 else "")
            raise InputError(f"must choose one of {len(chosen)} objects ({names})", "object", self.object)
        return chosen

    @property
    def satellite(self) -> Satellite:
        """The object, as `satellites` has it."""
        return self.satellites[0]


def _satellites(file: str | None, lines: Sequence[str] | None) -> tuple[Satellite, ...]:
    """Objects of a source; errors say of which."""
    if file is not None:
        return _named(read_element_sets(file), lambda error: error.of(file))
    try:
        sets = parse_element_sets("\n".join(lines or ()))
    except InputError as error:
        raise error.within("lines") from None
    return _named(sets, lambda error: error.within("lines"))


def _named(sets: Iterable[ElementSet], of_source: Callable[[InputError], InputError]) -> tuple[Satellite, ...]:
    """Objects with all their sets, with names made unique; `of_source` puts the source before an error."""
    grouped: dict[Any, list[ElementSet]] = {}
    for item in sets:
        key = item.norad_id if item.norad_id is not None else (item.name, item.international_designator)
        grouped.setdefault(key, []).append(item)
    groups = list(grouped.values())
    first = [group[0] for group in groups]
    # Names that can be a file's, of the catalog number where there is no other.
    plain = [plain_name(one.name, "satellite" if one.norad_id is None else f"norad{one.norad_id:05d}") for one in first]
    twice = {name for name, count in Counter(plain).items() if count > 1}
    names = [f"{name}-{_identifier(one)}" if name in twice else name for name, one in zip(plain, first, strict=True)]
    for name, count in Counter(names).items():
        if count > 1:
            group = groups[len(names) - 1 - names[::-1].index(name)]
            error = InputError(f"name must be unique, got {name} twice").of(group[0].label).of(group[0].location)
            raise of_source(error)
    return tuple(Satellite(name, tuple(group)) for name, group in zip(names, groups, strict=True))


def _identifier(item: ElementSet) -> str:
    """Identifier that distinguishes objects of one name."""
    known = item.international_designator if item.norad_id is None else f"{item.norad_id:05d}"
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", known)


def _matches(found: Sequence[Satellite], pattern: str, field: str) -> list[Satellite]:
    """Objects whose name (as in the file or cleaned) or catalog number is the pattern."""
    requested = pattern.strip().upper()
    number = int(requested) if re.fullmatch(r"\d{1,9}", requested, re.ASCII) else None

    def fits(item: Satellite) -> bool:
        first = item.sets[0]
        texts = (first.name.upper(), item.name.upper(), f"{first.norad_id}")
        # A name may hold brackets, which are no wild cards here.
        glob = re.sub(r"\[", "[[]", requested)
        return number == first.norad_id is not None or any(fnmatch.fnmatchcase(text, glob) for text in texts)

    chosen = [item for item in found if fits(item)]
    if not chosen:
        close = difflib.get_close_matches(requested, [item.name.upper() for item in found], n=1)
        hint = next((f" (did you mean {item.name}?)" for item in found if [item.name.upper()] == close), "")
        raise InputError(f"no object of that name or catalog number, got {pattern!r}{hint}", field)
    return chosen


def _chosen_sets(satellites: Iterable[Satellite], epoch: Epoch) -> list[ElementSet]:
    jd_utc = float(epoch.utc.jd)
    return [item.set_for(jd_utc) for item in satellites]


def _tai_minus_utc_s(sets: Sequence[ElementSet]) -> F64:
    """TAI - UTC at the sets' epochs [s]; UTC days have 86,400 s in element sets."""
    import erfa

    jd = np.array([item.epoch_jd_utc for item in sets])
    with years_ahead():
        return np.asarray(erfa.dat(*erfa.jd2cal(jd[:, 0], jd[:, 1])), np.float64)


def _age_days(satellites: Sequence[Satellite], epoch: Epoch) -> F64:
    """Ages of the satellites' element sets at an epoch [d]."""
    sets = _chosen_sets(satellites, epoch)
    whole, fraction = tt_jd(epoch, 0.0)
    jd = np.array([item.epoch_jd_utc for item in sets])
    offset_s = _TT_MINUS_TAI_S + _tai_minus_utc_s(sets)
    return np.asarray((whole - jd[:, 0]) + (fraction - jd[:, 1] - offset_s / DAY_S), np.float64)


def _sgp4_states(satellites: Sequence[Satellite], epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
    """Positions [m] and velocities [m/s], GCRS axes, each (n_time, n_satellite, 3)."""
    times = np.asarray(time_s, np.float64)
    if times.ndim != 1 or not np.isfinite(times).all():
        raise InputError(f"must be finite and of shape (n,), got shape {times.shape}", "time_s")
    sets = _chosen_sets(satellites, epoch)
    position, velocity = np.empty((len(times), len(sets), 3)), np.empty((len(times), len(sets), 3))
    # SGP4 takes one time for many satellites; sets from before a leap second have another.
    offset_s = _TT_MINUS_TAI_S + _tai_minus_utc_s(sets)
    rows = max(1, _PAIRS_PER_CHUNK // len(sets))
    for start in range(0, len(times), rows):
        block = slice(start, start + rows)
        turn = np.swapaxes(frame_to_gcrs("TEME", epoch, times[block]), 1, 2)
        for value_s in np.unique(offset_s):
            members = np.flatnonzero(offset_s == value_s)
            some = [(satellites[i].name, sets[i]) for i in members.tolist()]
            r, v = _sgp4_block(some, epoch, times[block], value_s)
            position[block, members] = 1e3 * (r @ turn)
            velocity[block, members] = 1e3 * (v @ turn)
    return position, velocity


def _sgp4_block(
    members: Sequence[tuple[str, ElementSet]], epoch: Epoch, times: F64, offset_s: float
) -> tuple[F64, F64]:
    """SGP4 for sets of one TT - UTC: TEME [km], [km/s], each (n_time, n_satellite, 3)."""
    from astropy.time import TimeDelta
    from sgp4.api import SGP4_ERRORS, SatrecArray

    whole, fraction = tt_jd(epoch, times)
    code, r, v = SatrecArray([item.satrec for _, item in members]).sgp4(
        np.full_like(times, whole), np.ascontiguousarray(fraction - offset_s / DAY_S)
    )
    radius_km = np.linalg.norm(r, axis=-1)
    finite = np.isfinite(radius_km) & np.isfinite(v).all(axis=-1)
    bad = (code != 0) | ~finite | (radius_km < NEAREST_KM) | (radius_km > FARTHEST_KM)
    if bad.any():
        row = int(np.argmax(bad.any(axis=1)))
        column = int(np.argmax(bad[row]))
        reason = SGP4_ERRORS.get(int(code[row, column]), "the state is not finite")
        if code[row, column] == 0 and finite[row, column]:
            name, item = members[row]
            days = _age_days([Satellite(name, (item,))], epoch)[0] + times[column] / DAY_S
            reason = (
                f"{radius_km[row, column]:.3g} km from the Earth's centre, not {NEAREST_KM:,.0f} to {FARTHEST_KM:,.0f} "
                f"km, {abs(days):.0f} days {'after' if days >= 0 else 'before'} the element set's epoch"
            )
        with years_ahead():
            start = utc_time(epoch.isot) if isinstance(epoch, Instant) else epoch
            utc = (start + TimeDelta(times[column], format="sec")).utc.isot
        raise InputError(f"no state at {utc} UTC ({times[column]:g} s): SGP4: {reason}").of(members[row][0])
    return np.swapaxes(r, 0, 1), np.swapaxes(v, 0, 1)
