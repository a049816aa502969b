"""Satellites by their element sets (TLE, OMM), moved by SGP4.

Sets that are given as text are read on construction; a file is read on first use, and then kept. SGP4 gives states in
TEME of date; they are turned into GCRS axes, without which they would be some 45 km off in 2025. Element sets date
themselves in UTC. The time that SGP4 runs on is the elapsed one, in SI seconds: across a leap second it goes on evenly,
where a difference of UTC dates, which other programs take, would be a second short (7 km along the path, for sets from
before a leap second and scenes behind it; the last one was at the end of 2016).
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, model_validator

from warpsim.arrays import F64
from warpsim.config.fields import FileName, Switch, as_tuple, rule_error
from warpsim.config.model import config_model, exactly_one
from warpsim.constants import DAY_S
from warpsim.errors import InputError, errors_at
from warpsim.exchange.element_set import ElementRecord, ElementSet
from warpsim.exchange.elements_files import element_records, read_element_records
from warpsim.exchange.instants import TT_MINUS_TAI_S
from warpsim.instant import Instant, tt_jd, utc_time, years_ahead
from warpsim.orbit.earth import frame_to_gcrs
from warpsim.orbit.element_catalog import Catalog, LeftOut, Satellite, choose_one, read_catalog

if TYPE_CHECKING:
    from warpsim.instant import Epoch


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

_LOOK_S = 60.0
"""Step at which satellites are looked at for being lost."""
_LOW_KM = 6400.0
"""Distance from the Earth's centre below which perigees are looked at, too. SGP4 has no state below 6,378.1 km; half a
step from its perigee a satellite is 4.4 km higher at most, as nothing is accelerated by more than 9.8 m/s2 there."""
_PERIGEE_S = 1e-3
"""How well the time of a perigee is known: 5e-6 m in height."""
_MANY_TIMES = 1000
_ROTATION_STEP_S = 8.0  # between such rotations it is linear to 1e-15, far below their rounding
_PAIRS_PER_CHUNK = 500_000  # (time, satellite) pairs of SGP4 held at once: some 30 MB


Lines = Annotated[tuple[str, ...], BeforeValidator(as_tuple)]
Selector = Annotated[str, BeforeValidator(_selector)]
Selectors = Annotated[tuple[Selector, ...], BeforeValidator(_selectors)]


class _FromElementSets:
    """Motion of satellites by SGP4."""

    if TYPE_CHECKING:
        file: str | None
        lines: tuple[str, ...] | None

        @property
        def _catalog(self) -> Catalog: ...

    @cached_property
    def satellites(self) -> tuple[Satellite, ...]:
        """The satellites, in the order of the source.

        Raises:
            InputError: The file cannot be read or is not valid, or what is chosen is not in it.
        """
        return self._catalog.satellites

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        """Element sets that are not valid, and are done without."""
        return self._catalog.left_out

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

    def _of_source(self, error: InputError) -> InputError:
        return error.within("lines") if self.file is None else error.of(self.file)

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
        exactly_one(self, "file", "lines")
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
    exclude: Selectors = ()
    """Names or catalog numbers of satellites not to take."""
    skip: Switch | None = None
    """Whether satellites without a valid set, or without a state in the scene, are left out; where not, they are an
    error. By default they are left out of sources of more than one set."""
    kind: Literal["tle"] = "tle"

    @model_validator(mode="after")
    def _one_source(self) -> TleSatellites:
        if self.only is not None and not self.only:
            raise InputError("must choose at least one satellite, or be left out", "only")
        self._check_source()
        return self

    @cached_property
    def _catalog(self) -> Catalog:
        return read_catalog(_records(self.file, self.lines), self._of_source, self.only, self.exclude, self.skip)

    @property
    def names(self) -> list[str]:
        """Names of the satellites; without one in the source, `norad` and the catalog number."""
        return [item.name for item in self.satellites]

    def notes(self, epoch: Epoch, duration_s: float) -> list[str]:
        """Return warnings: old element sets, and what `exclude` names that is not there."""
        unmatched = self._catalog.unmatched
        absent = [f"exclude: no object is called {', '.join(unmatched)}"] if unmatched else []
        return [*super().notes(epoch, duration_s), *absent]

    def within(self, epoch: Epoch, first_s: float, last_s: float) -> tuple[TleSatellites, list[LeftOut]]:
        """Return the constellation without the satellites that have no state at some time of a span, and these.

        They are looked for every minute, and in perigees. Where such satellites are an error it is the constellation
        itself.

        Args:
            epoch: The scene's epoch.
            first_s: Begin of the span [s since epoch].
            last_s: Its end.

        Raises:
            InputError: No satellite has states.
        """
        lost = _lost(self.satellites, epoch, first_s, last_s) if self._catalog.skips else {}
        if not lost:
            return self, []
        gone = []
        for one in self.satellites:
            if one.name in lost:
                chosen = one.set_for(float(epoch.utc.jd))
                gone.append(LeftOut(one.name, chosen.norad_id, chosen.location, lost[one.name]))
        if len(gone) == len(self.satellites):
            raise self._of_source(InputError(f"{gone[0].reason} (as all others)").of(gone[0].name))
        return self.some([number for number, one in enumerate(self.satellites) if one.name not in lost]), gone

    def some(self, numbers: Iterable[int]) -> TleSatellites:
        """Return the constellation of some of the satellites, by their numbers."""
        rest = dataclasses.replace(self)
        rest.__dict__["_catalog"] = self._catalog
        rest.__dict__["satellites"] = tuple(self.satellites[number] for number in numbers)
        return rest


@config_model
class TleOrbit(_FromElementSets):
    """The path of one object given by element sets; give `file` or `lines`. A file is read on first use."""

    file: FileName | None = None
    """TLE, 3LE, or OMM as KVN, XML, JSON or CSV."""
    lines: Lines | None = None
    """The same as text, line by line."""
    object: Selector | None = None
    """Its name or catalog number; may be left out where the source has one object only."""
    kind: Literal["tle_orbit", "tle"] = "tle_orbit"

    @model_validator(mode="after")
    def _one_source(self) -> TleOrbit:
        self._check_source()
        return self

    @cached_property
    def _catalog(self) -> Catalog:
        return choose_one(_records(self.file, self.lines), self._of_source, self.object)

    @property
    def satellite(self) -> Satellite:
        """The object, as `satellites` has it."""
        return self.satellites[0]


def _records(file: str | None, lines: Sequence[str] | None) -> list[ElementRecord]:
    """Element sets of a source, not yet parsed; errors say of which."""
    if file is not None:
        return read_element_records(file)
    with errors_at("lines"):
        return element_records("\n".join(lines or ()))


def _chosen_sets(satellites: Iterable[Satellite], epoch: Epoch) -> tuple[list[ElementSet], F64]:
    """Element sets that are taken, and TT - UTC at their epochs [s]; UTC days have 86,400 s in element sets."""
    import erfa

    jd_utc = float(epoch.utc.jd)
    sets = [item.set_for(jd_utc) for item in satellites]
    jd = np.array([item.epoch_jd_utc for item in sets])
    with years_ahead():
        return sets, TT_MINUS_TAI_S + np.asarray(erfa.dat(*erfa.jd2cal(jd[:, 0], jd[:, 1])), np.float64)


def _age_days(satellites: Sequence[Satellite], epoch: Epoch) -> F64:
    sets, offset_s = _chosen_sets(satellites, epoch)
    whole, fraction = tt_jd(epoch, 0.0)
    jd = np.array([item.epoch_jd_utc for item in sets])
    return np.asarray((whole - jd[:, 0]) + (fraction - jd[:, 1] - offset_s / DAY_S), np.float64)


def _sgp4_states(satellites: Sequence[Satellite], epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
    """Positions [m] and velocities [m/s], GCRS axes, each (n_time, n_satellite, 3)."""
    times = np.asarray(time_s, np.float64)
    if times.ndim != 1 or not np.isfinite(times).all():
        raise InputError(f"must be finite and of shape (n,), got shape {times.shape}", "time_s")
    sets, offset_s = _chosen_sets(satellites, epoch)
    position, velocity = np.empty((len(times), len(sets), 3)), np.empty((len(times), len(sets), 3))
    # SGP4 takes one time for many satellites; sets from before a leap second have another.
    rows = max(1, _PAIRS_PER_CHUNK // len(sets))
    for start in range(0, len(times), rows):
        block = slice(start, start + rows)
        turn = np.swapaxes(_teme_to_gcrs(epoch, times[block]), 1, 2)
        for value_s in np.unique(offset_s):
            members = np.flatnonzero(offset_s == value_s)
            some = [(satellites[i].name, sets[i]) for i in members.tolist()]
            states = _Sgp4States(some, epoch, times[block], value_s)
            if states.bad.any():
                row = int(np.argmax(states.bad.any(axis=1)))
                raise InputError(states.reason(row, int(np.argmax(states.bad[row])))).of(some[row][0])
            position[block, members] = 1e3 * (np.swapaxes(states.r, 0, 1) @ turn)
            velocity[block, members] = 1e3 * (np.swapaxes(states.v, 0, 1) @ turn)
    return position, velocity


def _teme_to_gcrs(epoch: Epoch, time_s: F64) -> F64:
    """Rotations, (n_time, 3, 3); many times close together get them from some, as nutation takes days."""
    first_s, last_s = float(time_s.min()), float(time_s.max())
    n_node = 2 + int((last_s - first_s) / _ROTATION_STEP_S)
    if len(time_s) < max(_MANY_TIMES, 4 * n_node):
        return frame_to_gcrs("TEME", epoch, time_s)
    rotation = frame_to_gcrs("TEME", epoch, np.linspace(first_s, last_s, n_node))
    at = (time_s - first_s) * ((n_node - 1) / (last_s - first_s))
    node = np.minimum(at.astype(np.int64), n_node - 2)
    return np.asarray(rotation[node] + (at - node)[:, None, None] * (rotation[node + 1] - rotation[node]))


def _lost(satellites: Sequence[Satellite], epoch: Epoch, first_s: float, last_s: float) -> dict[str, str]:
    """Satellites without a state at some time of a span, looked for every minute and in perigees, and why, by name."""
    sets, offset_s = _chosen_sets(satellites, epoch)
    times = np.linspace(first_s, last_s, max(2, int(np.ceil((last_s - first_s) / _LOOK_S)) + 1))
    some = max(1, _PAIRS_PER_CHUNK // len(times))
    found: dict[str, str] = {}
    for value_s in np.unique(offset_s):
        members = np.flatnonzero(offset_s == value_s)
        for start in range(0, len(members), some):
            part = [(satellites[i].name, sets[i]) for i in members[start : start + some].tolist()]
            states = _Sgp4States(part, epoch, times, value_s)
            for row in np.flatnonzero(states.bad.any(axis=1)).tolist():
                found[part[row][0]] = states.reason(row, int(np.argmax(states.bad[row])))
            for row in np.flatnonzero(~states.bad.any(axis=1) & (states.radius_km.min(axis=1) < _LOW_KM)).tolist():
                lowest = _in_perigees(part[row], epoch, times, states.falls(row), value_s)
                if lowest.bad.any():
                    found[part[row][0]] = lowest.reason(0, int(np.argmax(lowest.bad[0])))
    return found


def _in_perigees(
    member: tuple[str, ElementSet], epoch: Epoch, times: F64, falls: NDArray[np.bool_], offset_s: float
) -> _Sgp4States:
    """States of a satellite where it is lowest, between times at which it falls and rises; or near there, if bad."""
    turns = np.flatnonzero(falls[:-1] & ~falls[1:])
    low_s, high_s = times[turns], times[turns + 1]
    while True:
        states = _Sgp4States([member], epoch, 0.5 * (low_s + high_s), offset_s)
        if states.bad.any() or not (high_s - low_s > _PERIGEE_S).any():
            return states
        low_s = np.where(states.falls(0), states.times, low_s)
        high_s = np.where(states.falls(0), high_s, states.times)


class _Sgp4States:
    """SGP4 for sets of one TT - UTC: TEME [km], [km/s], each (n_satellite, n_time, 3), and where there are none."""

    def __init__(self, members: Sequence[tuple[str, ElementSet]], epoch: Epoch, times: F64, offset_s: float) -> None:
        from sgp4.api import SatrecArray

        self._members, self._epoch, self.times = members, epoch, times
        whole, fraction = tt_jd(epoch, times)
        self._code, self.r, self.v = SatrecArray([item.satrec for _, item in members]).sgp4(
            np.full_like(times, whole), np.ascontiguousarray(fraction - offset_s / DAY_S)
        )
        self.radius_km = np.linalg.norm(self.r, axis=-1)
        self._finite = np.isfinite(self.radius_km) & np.isfinite(self.v).all(axis=-1)
        believed = (self.radius_km >= NEAREST_KM) & (self.radius_km <= FARTHEST_KM)
        self.bad = (self._code != 0) | ~self._finite | ~believed

    def falls(self, row: int) -> NDArray[np.bool_]:
        """Return whether a satellite comes closer to the Earth, at each time."""
        return np.asarray(np.sum(self.r[row] * self.v[row], axis=-1) < 0.0)

    def reason(self, row: int, column: int) -> str:
        """Why a satellite has no state at a time, which it says."""
        from astropy.time import TimeDelta
        from sgp4.api import SGP4_ERRORS

        code, time_s, radius_km = self._code[row, column], self.times[column], self.radius_km[row, column]
        reason = SGP4_ERRORS.get(int(code), "the state is not finite")
        if code == 0 and self._finite[row, column]:
            name, item = self._members[row]
            days = _age_days([Satellite(name, (item,))], self._epoch)[0] + time_s / DAY_S
            reason = (
                f"{radius_km:.3g} km from the Earth's centre, not {NEAREST_KM:,.0f} to {FARTHEST_KM:,.0f} km, "
                f"{abs(days):.0f} days {'after' if days >= 0 else 'before'} the element set's epoch"
            )
        with years_ahead():
            start = utc_time(self._epoch.isot) if isinstance(self._epoch, Instant) else self._epoch
            utc = (start + TimeDelta(time_s, format="sec")).utc.isot
        return f"no state at {utc} UTC ({time_s:g} s): SGP4: {reason}"
