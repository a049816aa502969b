"""States of satellites by their element sets: SGP4, and how old the sets are.

SGP4 gives states in TEME of date; they are turned into GCRS axes, without which they would be some 45 km off in 2025.
Element sets date themselves in UTC. The time that SGP4 runs on is the elapsed one, in SI seconds: across a leap second
it goes on evenly, where a difference of UTC dates, which other programs take, would be a second short (7 km along the
path, for sets from before a leap second and scenes behind it; the last one was at the end of 2016).
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.constants import DAY_S
from warpsim.errors import InputError
from warpsim.exchange.element_set import ElementSet
from warpsim.instant import Instant, tt_jd, utc_time, years_ahead
from warpsim.orbit.teme import teme_to_gcrs

if TYPE_CHECKING:
    from warpsim.instant import Epoch

F64 = NDArray[np.float64]

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


def _chosen_sets(satellites: Iterable[Satellite], epoch: Epoch) -> list[ElementSet]:
    jd_utc = float(epoch.utc.jd)
    return [item.set_for(jd_utc) for item in satellites]


def _tai_minus_utc_s(sets: Sequence[ElementSet]) -> F64:
    """TAI - UTC at the sets' epochs [s]; UTC days have 86,400 s in element sets."""
    import erfa

    jd = np.array([item.epoch_jd_utc for item in sets])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)  # future leap seconds are not known
        return np.asarray(erfa.dat(*erfa.jd2cal(jd[:, 0], jd[:, 1])), np.float64)


def age_days(satellites: Sequence[Satellite], epoch: Epoch) -> F64:
    """Ages of the satellites' element sets at an epoch [d], negative before theirs, shape (n_satellite,)."""
    sets = _chosen_sets(satellites, epoch)
    whole, fraction = tt_jd(epoch, 0.0)
    jd = np.array([item.epoch_jd_utc for item in sets])
    offset_s = _TT_MINUS_TAI_S + _tai_minus_utc_s(sets)
    return np.asarray((whole - jd[:, 0]) + (fraction - jd[:, 1] - offset_s / DAY_S), np.float64)


def age_notes(satellites: Sequence[Satellite], epoch: Epoch, duration_s: float) -> list[str]:
    """One line if element sets are more than OLD_DAYS away from some time of a scene."""
    first = age_days(satellites, epoch)
    farthest = np.maximum(np.abs(first), np.abs(first + duration_s / DAY_S))
    worst = int(np.argmax(farthest))
    if not farthest[worst] > OLD_DAYS:
        return []
    n_old = int(np.sum(farthest > OLD_DAYS))
    which = satellites[worst].name if n_old == 1 else f"{n_old} satellites, {satellites[worst].name} most"
    return [
        f"element sets more than {OLD_DAYS:g} days from the scene: {which} ({farthest[worst]:.0f} days); "
        "SGP4 loses kilometres a day"
    ]


def sgp4_states(satellites: Sequence[Satellite], epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
    """Positions [m] and velocities [m/s], GCRS axes, each (n_time, n_satellite, 3).

    Raises:
        InputError: SGP4 has no state for some satellite and time, or one that is not between NEAREST_KM and FARTHEST_KM
            from the Earth's centre.
    """
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
        turn = np.swapaxes(teme_to_gcrs(epoch, times[block]), 1, 2)
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
            days = age_days([Satellite(name, (item,))], epoch)[0] + times[column] / DAY_S
            reason = (
                f"{radius_km[row, column]:.3g} km from the Earth's centre, not {NEAREST_KM:,.0f} to {FARTHEST_KM:,.0f} "
                f"km, {abs(days):.0f} days {'after' if days >= 0 else 'before'} the element set's epoch"
            )
        with years_ahead():
            start = utc_time(epoch.isot) if isinstance(epoch, Instant) else epoch
            utc = (start + TimeDelta(times[column], format="sec")).utc.isot
        raise InputError(f"no state at {utc} UTC ({times[column]:g} s): SGP4: {reason}").of(members[row][0])
    return np.swapaxes(r, 0, 1), np.swapaxes(v, 0, 1)
