"""Sampling of tracks: node grids, the steps that keep the interpolation error small, and that error.

The interpolation error of a cubic Hermite interval is `step^4 / 384 * |d4r/dt4|`, largest at its middle, so comparing
with the propagator at the midpoints measures the worst error. On a circular orbit it is `a (n step)^4 / 384`: for
1 mm, about 14 s in low orbit and 17 s at 1,600 km.

Bodies that need about the same step have one: all that do with SHARED_STEP_S or more, those that need less in classes
of a factor of four. The class of a body is by its own motion alone, so uneven bodies do not shorten the steps of others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.errors import InputError
from warpsim.orbit.track import Track

F64 = NDArray[np.float64]

I64 = NDArray[np.int64]

StateFunction = Callable[[F64], tuple[F64, F64]]
"""time_s (n_time,) -> position_m, velocity_m_s, both (n_time, 3) or (n_time, n_object, 3)."""


class SomeStatesFunction(Protocol):
    """States of some objects of a propagator."""

    def __call__(self, time_s: F64, bodies: I64) -> tuple[F64, F64]:
        """Return positions and velocities at times (n_time,) of bodies, numbers (n,), both (n_time, n, 3)."""
        ...


TRACK_ERROR_M = 1e-3
"""Default bound of the interpolation error [m]."""

WORST_TRACK_ERROR_M = 1.0
"""What is taken of motion that is not smooth."""

SHARED_STEP_S = 8.0
"""Shortest node step that all bodies share [s]: circular orbits need 12 s or more, the most eccentric ones 9 s."""

SHORTEST_STEP_S = 0.01
"""Shortest node step [s]."""

ROOM_S = 2.0
"""Room of the node grid before time 0, at least [s]: the light time of 600,000 km."""

MOST_NODES = 20_000_000
"""Nodes of all objects together: 1 GB, and below 2 GB while they are made."""

MOST_ROUGH_NODES = 5_000_000
"""Nodes of one object, and of a class of objects to which steps are shortened for motion that is not smooth."""

ALWAYS_S = (-math.inf, math.inf)
"""Span of a track that matters throughout [s]."""

_N_TRIAL = 96
_PAIRS_PER_PIECE = 4_000_000  # states asked for at once: J2's take 0.6 GB, SGP4's 0.9 GB
_CLASS = 4.0  # ratio of the steps of a class at most
_MANY = 1000  # of more objects only those whose error is not far from the largest are tried again
_TOGETHER = 256  # objects are cut into pieces of multiples of this: as free flight is integrated
_BEND = 3.0**0.5 / 18.0  # largest u (1 - u) (1 - 2 u)
_INCONSISTENT_M_S = 1e-4
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


def node_grid(duration_s: float, step_s: float) -> tuple[float, int]:
    """Return start_s and n_node of the grid shared by all tracks of a scene.

    Time 0 is a node. Before it there is room for light time, ROOM_S or a step, whichever is longer; behind duration_s
    there is a step.
    """
    if not (math.isfinite(duration_s) and duration_s >= 0):
        raise InputError("must be >= 0", "duration_s", duration_s)
    if not (math.isfinite(step_s) and step_s > 0):
        raise InputError("must be > 0", "step_s", step_s)
    n_before = max(1, math.ceil(round(ROOM_S / step_s, 9)))
    return -n_before * step_s, n_before + _n_step(duration_s, step_s) + 2


def _n_step(duration_s: float, step_s: float) -> int:
    """Steps that cover a time."""
    return math.ceil(round(duration_s / step_s, 9))  # rounded: 1614 / 0.1 is 16140 steps, not 16141


def _even_step_s(duration_s: float, step_s: float) -> float:
    """The longest step up to step_s that divides the scene evenly: its end is a node, as its beginning is.

    So what the motion does outside the scene has no part in the tracks within.
    """
    return duration_s / max(1, _n_step(duration_s, step_s)) if duration_s > 0 else step_s


def sample_tracks(
    names: Sequence[str],
    state: StateFunction,
    start_s: float,
    step_s: float,
    n_node: int,
    counted_s: ArrayLike = ALWAYS_S,
    ends: tuple[int, int] | None = None,
) -> list[Track]:
    """Sample the objects of one propagator on a node grid and measure each one's interpolation error.

    The propagator is called with nodes and interval midpoints together, once but for very many of them. From when to
    when each object's track matters is counted_s, a pair for all or one each [s], (n_object, 2); `ends` are the numbers
    of the nodes at which the scene begins and ends, where the acceleration may jump.
    """
    time_s: F64 = start_s + 0.5 * step_s * np.arange(2 * n_node - 1, dtype=np.float64)
    position_m, velocity_m_s = np.empty((len(time_s), len(names), 3)), np.empty((n_node, len(names), 3))
    rows = 2 * max(1, _PAIRS_PER_PIECE // (2 * max(1, len(names))))
    for begin in range(0, len(time_s), rows):
        piece = slice(begin, begin + rows)
        some_m, some_m_s = _finite_states(names, state, time_s[piece])
        if some_m.shape[1] != len(names):
            raise InputError(f"must be {some_m.shape[1]}, one per object", "names", len(names))
        position_m[piece], velocity_m_s[begin // 2 : (begin + rows) // 2] = some_m, some_m_s[::2]
    spans_s = np.broadcast_to(counted_s, (len(names), 2))
    return [
        _one_track(name, start_s, step_s, position_m[:, i], velocity_m_s[:, i], spans_s[i], ends)
        for i, name in enumerate(names)
    ]


def _finite_states(names: Sequence[str], state: StateFunction, time_s: F64) -> tuple[F64, F64]:
    """Positions and velocities, each (n_time, n_object, 3), none of them NaN or infinite."""
    position_m, velocity_m_s = (np.asarray(x, np.float64).reshape(len(time_s), -1, 3) for x in state(time_s))
    good = np.isfinite(position_m).all(axis=-1) & np.isfinite(velocity_m_s).all(axis=-1)
    if not good.all():
        row, column = (int(index) for index in np.argwhere(~good)[0])
        name = names[column] if column < len(names) else f"object {column}"
        raise InputError(f"the state must be finite, but is not at {time_s[row]:.6g} s").of(name)
    return position_m, velocity_m_s


def _one_track(
    name: str,
    start_s: float,
    step_s: float,
    dense_m: F64,
    velocity_m_s: F64,
    counted_s: F64,
    ends: tuple[int, int] | None,
) -> Track:
    """Track of positions at nodes and middles, (2 n - 1, 3), and velocities at nodes, (n, 3)."""
    used_m_s, missed_m = _assessed(dense_m, velocity_m_s, step_s, ends)
    p, v = np.ascontiguousarray(dense_m[::2]), np.ascontiguousarray(used_m_s)
    node_s = start_s + step_s * np.arange(len(p))
    missed_m[(node_s[1:] <= counted_s[0]) | (node_s[:-1] >= counted_s[1])] = 0.0
    worst = int(np.argmax(missed_m))
    return Track(name, start_s, step_s, p, v, float(missed_m[worst]), start_s + (worst + 0.5) * step_s)


def _assessed(dense_m: F64, velocity_m_s: F64, step_s: float, ends: tuple[int, int] | None = None) -> tuple[F64, F64]:
    """Velocities used by the interpolant (n, ..., 3), and its error in each interval [m], (n - 1, ...).

    A velocity that is not the derivative of the positions shifts the interpolant by up to 0.096 step times the
    difference, and not at the middles: it is counted apart, and where all velocities of an object are so, those of the
    positions replace it. SGP4's are: by some cm/s on near-Earth orbits, by more than 1 m/s on Molniya's. At `ends`, and
    outside, positions of both sides do not determine single velocities.
    """
    differ_m_s = np.zeros(velocity_m_s.shape[:-1])
    if len(velocity_m_s) > 2:
        slope_m_s = _slopes(dense_m, 0.5 * step_s)
        differ_m_s = np.linalg.norm(slope_m_s - velocity_m_s, axis=-1)
        replaced = np.median(differ_m_s, axis=0) > _INCONSISTENT_M_S
        velocity_m_s = np.where(replaced[..., None], slope_m_s, velocity_m_s)
        differ_m_s = np.where(replaced, 0.0, differ_m_s)
        if ends is not None:
            differ_m_s[: ends[0] + 1], differ_m_s[ends[1] :] = 0.0, 0.0
    middle_m = _middle_m(dense_m[:-1:2], dense_m[2::2], velocity_m_s[:-1], velocity_m_s[1:], step_s)
    missed_m = np.linalg.norm(middle_m - dense_m[1::2], axis=-1)
    missed_m += _BEND * step_s * 0.5 * (differ_m_s[:-1] + differ_m_s[1:])
    return velocity_m_s, missed_m


def _slopes(dense_m: F64, h: float) -> F64:
    """Derivatives at every second of equidistant positions, h apart, to fourth order; (2 n - 1, ...) to (n, ...)."""
    slope = np.empty(((len(dense_m) + 1) // 2, *dense_m.shape[1:]))
    slope[1:-1] = _central(dense_m[:-4:2], dense_m[1:-3:2], dense_m[3:-1:2], dense_m[4::2], h)
    one_sided = np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / (12.0 * h)
    slope[0], slope[-1] = np.tensordot(one_sided, dense_m[:5], 1), np.tensordot(-one_sided, dense_m[:-6:-1], 1)
    return slope


def _central(before2: F64, before1: F64, after1: F64, after2: F64, h: float) -> F64:
    """Derivative from two neighbours on either side, to fourth order."""
    return (8.0 * (after1 - before1) - (after2 - before2)) / (12.0 * h)


def _middle_m(p0: F64, p1: F64, v0: F64, v1: F64, step_s: float) -> F64:
    """The interpolant half-way between nodes."""
    return 0.5 * (p0 + p1) + 0.125 * step_s * (v0 - v1)


def choose_step_s(
    state: StateFunction,
    duration_s: float,
    error_m: float = TRACK_ERROR_M,
    counted_s: ArrayLike = ALWAYS_S,
    longest_s: float = 3600.0,
    shortest_s: float = SHORTEST_STEP_S,
    names: Sequence[str] = (),
) -> float:
    """Return a node step [s] whose measured interpolation error over [0, duration_s] stays below error_m.

    The error of smooth motion scales with the fourth power of the step; trials at intervals spread over the scene, and
    never outside it, give the step. It divides the scene evenly, and aims at 80 % of the bound to leave room for what
    is between the trials. Motion that is not smooth, as that of a table with few digits, may never come below error_m:
    then the step is taken from where shorter ones stop to help. Meant for satellites and targets: the Sun's distance in
    float64 is itself rounded to 0.03 mm, so its track takes the step of the others.
    """
    sampler = _Sampler(names, state, None, duration_s, error_m, counted_s)
    return sampler.choose(None, longest_s, shortest_s)[0]


def make_tracks(
    names: Sequence[str],
    state: StateFunction,
    duration_s: float,
    error_m: float = TRACK_ERROR_M,
    counted_s: ArrayLike = ALWAYS_S,
    longest_s: float = 3600.0,
    some_states: SomeStatesFunction | None = None,
) -> list[Track]:
    """Sample objects with node steps chosen so that the measured error stays below error_m.

    Objects have one step, but those that need less than SHARED_STEP_S: they have one with others that need as much
    within a factor of four. Smooth motion keeps the error, for other motion see `Track.error_m`.

    Args:
        names: Of the objects.
        state: States of all.
        duration_s: Length of the scene [s].
        error_m: Bound of the interpolation error [m].
        counted_s: From when to when tracks matter [s], a pair for all or one each, (n_object, 2).
        longest_s: Longest step [s].
        some_states: States of some objects; if left out, those of all are computed.

    Raises:
        InputError: A state is not finite, or no step keeps the error below 1 m: the motion is too rough, or the scene
            so long that the nodes would not fit into memory.
    """
    sampler = _Sampler(names, state, some_states, duration_s, error_m, counted_s)
    left, found, room = np.arange(len(names)), dict[int, Track](), MOST_NODES
    least_s = SHARED_STEP_S
    while len(left):
        made, left = sampler.tracks_of_class(left, longest_s, least_s, room)
        found |= made
        room = max(1, room - sum(track.n_node for track in made.values()))
        least_s /= _CLASS
    return [found[number] for number in range(len(names))]


class _Sampler:
    """Sampling of the objects of a scene, some of them at a time."""

    def __init__(
        self,
        names: Sequence[str],
        state: StateFunction,
        some_states: SomeStatesFunction | None,
        duration_s: float,
        error_m: float,
        counted_s: ArrayLike,
    ) -> None:
        self._names, self._state = names, state
        self._some_states = some_states or self._cut_states
        self._duration_s, self._error_m, self._counted_s = duration_s, error_m, np.asarray(counted_s, np.float64)

    def _cut_states(self, time_s: F64, bodies: I64) -> tuple[F64, F64]:
        """States of some objects, of all that were computed."""
        position_m, velocity_m_s = self._state(time_s)
        return position_m[:, bodies], velocity_m_s[:, bodies]

    def choose(
        self, bodies: I64 | None, longest_s: float, shortest_s: float, least_s: float = 0.0
    ) -> tuple[float, I64 | None]:
        """Choose the step of bodies, all if None; those that need less than least_s are left out."""
        duration_s, bound_m = self._duration_s, 0.8 * self._error_m
        step_s = _even_step_s(duration_s, max(min(30.0, longest_s), shortest_s))
        before = math.inf, step_s  # error and step of the last shorter trial
        too_long_s = math.inf
        tried = bodies
        for _ in range(24):
            errors_m = self._trial_errors_m(tried, step_s)
            if bodies is not None and tried is not None:
                stays = step_s * (bound_m / np.maximum(errors_m, 1e-300)) ** 0.25 >= least_s
                bodies, tried, errors_m = np.setdiff1d(bodies, tried[~stays]), tried[stays], errors_m[stays]
                if not len(bodies):
                    break
                if not len(tried):  # those left have not been tried with this step
                    tried = bodies
                    continue
                if len(tried) > _MANY:
                    tried = tried[errors_m >= 0.1 * errors_m.max()]
            worst_m = float(errors_m.max(initial=0.0))
            ratio = (bound_m / max(worst_m, 1e-300)) ** 0.25
            if 1.0 <= ratio < 1.3:
                break
            if ratio < 1.0:
                too_long_s = min(too_long_s, step_s)
                if step_s < before[1]:
                    gain = math.log(before[0] / worst_m) / math.log(before[1] / step_s) if before[0] < math.inf else 4.0
                    if gain < 0.5:
                        break
                    before = worst_m, step_s
            proposed_s = max(min(step_s * min(max(ratio * 0.999, 0.1), 8.0), longest_s), shortest_s)
            next_s = _even_step_s(duration_s, proposed_s)
            if next_s == step_s or (ratio >= 1.0 and next_s >= too_long_s):
                break
            step_s = next_s
        return step_s, bodies

    def tracks_of_class(self, bodies: I64, longest_s: float, least_s: float, room: int) -> tuple[dict[int, Track], I64]:
        """Sample those of some bodies that need least_s or more, with one step; and the others, that need less.

        room is how many nodes there may be.
        """
        duration_s, error_m = self._duration_s, self._error_m
        shortest_s = max(SHORTEST_STEP_S, duration_s * len(bodies) / room, duration_s / MOST_ROUGH_NODES)
        if least_s <= shortest_s:
            least_s = 0.0
        step_s, chosen = self.choose(bodies, longest_s, shortest_s, least_s)
        own = bodies if chosen is None else chosen
        shortest_s = max(shortest_s, min(0.5 * step_s, duration_s * len(own) / MOST_ROUGH_NODES))
        first: tuple[float, float] | None = None  # error and step of the first sampling
        while len(own):
            tracks = self._sampled(own, step_s)
            missed_m = np.array([track.error_m for track in tracks])
            worst_m = float(missed_m.max())
            if worst_m <= error_m or step_s <= shortest_s:
                break
            order = 4.0 if first is None else math.log(first[0] / worst_m) / math.log(first[1] / step_s)
            if order < 0.5:  # of the error in the step: shorter ones do not help
                break
            # The worst interval was between the trials: a perigee, or a manoeuvre, where the velocity jumps.
            needs_s = step_s * np.maximum(
                0.25, 0.95 * (error_m / np.maximum(missed_m, 1e-300)) ** (1 / min(order, 4.0))
            )
            stays = (needs_s >= least_s) | (missed_m <= error_m)
            if not stays.all():
                own = own[stays]
                tracks = [track for track, stay in zip(tracks, stays, strict=True) if stay]
                worst_m = float(missed_m[stays].max(initial=0.0))
                if worst_m <= error_m:
                    break
            first, tracks = first or (worst_m, step_s), []  # the next ones need their memory
            proposed_s = step_s * max(0.25, 0.95 * (error_m / worst_m) ** (1 / min(order, 4.0)))
            step_s = _even_step_s(duration_s, max(shortest_s, proposed_s))
        if not len(own):
            return {}, bodies
        if worst_m > WORST_TRACK_ERROR_M:
            self._refuse(own, tracks, step_s, shortest_s)
        return dict(zip(own.tolist(), tracks, strict=True)), np.setdiff1d(bodies, own)

    def _refuse(self, bodies: I64, tracks: Sequence[Track], step_s: float, shortest_s: float) -> None:
        """Refuse tracks that are more than WORST_TRACK_ERROR_M off."""
        rough = max(tracks, key=lambda track: track.error_m)
        if SHORTEST_STEP_S < step_s <= shortest_s:
            longer_s = _even_step_s(self._duration_s, 2.0 * step_s)
            longer_m = max(track.error_m for track in self._sampled(bodies, longer_s))
            if longer_s == step_s or longer_m > 2.0**0.5 * rough.error_m:
                raise InputError(
                    f"{self._duration_s:g} s are too long for {len(self._names)} satellites and targets: between as many "
                    f"orbit nodes as fit into memory, {step_s:.3g} s apart, {rough.name} is {rough.error_m:.3g} m off "
                    f"near {rough.error_at_s:.6g} s",
                    "duration_s",
                )
        raise InputError(
            f"the motion must be smooth, but near {rough.error_at_s:.6g} s it is {rough.error_m:.3g} m off between "
            f"nodes {step_s:.3g} s apart",
        ).of(rough.name)

    def _sampled(self, bodies: I64, step_s: float) -> list[Track]:
        """Tracks over a scene that the step divides evenly; outside it the motion is free."""
        start_s, n_node = node_grid(self._duration_s, step_s)
        ends = round(-start_s / step_s), n_node - 2
        found: list[Track] = []
        for names, state, spans_s in self._pieces(bodies, 2 * n_node):
            found += sample_tracks(names, state, start_s, step_s, n_node, spans_s, ends)
        return found

    def _trial_errors_m(self, bodies: I64 | None, step_s: float) -> F64:
        """Largest error of each body in intervals, as _trial_error_m [m]."""
        n_time = min(2 * _n_step(self._duration_s, step_s) + 1, 7 * _N_TRIAL)
        return np.concatenate([
            _trial_error_m(partial(_finite_states, names, state), self._duration_s, step_s, spans_s)
            for names, state, spans_s in self._pieces(bodies, n_time)
        ])  # fmt: skip

    def _pieces(self, bodies: I64 | None, n_time: int) -> Iterator[tuple[Sequence[str], StateFunction, F64]]:
        """Names, states and spans of bodies, so many at a time that their states at n_time times take little memory."""
        if bodies is None:
            yield self._names, self._state, self._counted_s
            return
        at_once = max(1, _PAIRS_PER_PIECE // n_time)
        at_once -= at_once % _TOGETHER if at_once > _TOGETHER else 0
        for some in np.split(bodies, range(at_once, len(bodies), at_once)):
            is_all = len(some) == len(self._names)
            names = [self._names[number] for number in some.tolist()]
            spans_s = self._counted_s[some] if self._counted_s.ndim > 1 else self._counted_s
            yield names, self._state if is_all else partial(self._some_states, bodies=some), spans_s


def _trial_error_m(state: StateFunction, duration_s: float, step_s: float, counted_s: ArrayLike) -> F64:
    """Largest error of each object in intervals: all of a short scene, or some spread evenly over a long one."""
    n_interval = _n_step(duration_s, step_s)
    if n_interval <= _N_TRIAL:
        dense_m, velocity_m_s = state(0.5 * step_s * np.arange(2 * max(1, n_interval) + 1, dtype=np.float64))
        _, missed_m = _assessed(dense_m, velocity_m_s[::2], step_s)
        end_s = step_s * np.arange(1, len(missed_m) + 1)
    else:
        begin_s = step_s + (duration_s - 3.0 * step_s) * np.mod(_GOLDEN * np.arange(_N_TRIAL), 1.0)
        missed_m, end_s = _missed_at(state, begin_s, step_s), begin_s + step_s
    first_s, last_s = np.moveaxis(np.broadcast_to(counted_s, (missed_m.shape[1], 2)), -1, 0)
    counts = (end_s[:, None] > first_s) & (end_s[:, None] - step_s < last_s)
    return np.asarray(np.where(counts, missed_m, 0.0).max(axis=0, initial=0.0))


def _missed_at(state: StateFunction, begin_s: F64, step_s: float) -> F64:
    """Errors at the middles of single intervals [m], (n_interval, n_object), with the velocities that a track has."""
    # States half a step apart, from one step before each interval to one behind it, (7, n_interval, n_object, 3).
    h_s = 0.5 * step_s
    time_s = begin_s + h_s * np.arange(-2.0, 5.0)[:, None]
    p, v = (x.reshape(*time_s.shape, -1, 3) for x in state(time_s.ravel()))
    slope_m_s = np.stack([_central(p[0], p[1], p[3], p[4], h_s), _central(p[2], p[3], p[5], p[6], h_s)])
    v = v[[2, 4]]
    replaced = np.median(np.linalg.norm(slope_m_s - v, axis=-1), axis=(0, 1)) > _INCONSISTENT_M_S
    v = np.where(replaced[:, None], slope_m_s, v)
    return np.asarray(np.linalg.norm(_middle_m(p[2], p[4], v[0], v[1], step_s) - p[3], axis=-1))
