"""Node steps of tracks: the longest that keep the interpolation error of bodies small.

Bodies that need about the same step have one: all that do with SHARED_STEP_S or more, those that need less in classes
of a factor of four. The class of a body is by its own motion, so uneven bodies do not shorten the steps of the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from warpsim.arrays import F64, I64
from warpsim.errors import InputError
from warpsim.orbit.sampling import (
    ALWAYS_S,
    INCONSISTENT_M_S,
    PAIRS_PER_PIECE,
    StateFunction,
    assessed,
    central,
    even_step_s,
    finite_states,
    interpolated_middle_m,
    n_step,
    node_grid,
    sample_tracks,
)
from warpsim.orbit.track import Track

SomeStatesFunction = Callable[[F64, I64], tuple[F64, F64]]
"""time_s (n_time,), numbers of objects (n,) -> position_m, velocity_m_s of these, both (n_time, n, 3)."""

TRACK_ERROR_M = 1e-3
"""Default bound of the interpolation error [m]."""

WORST_TRACK_ERROR_M = 1.0
"""What is taken of motion that is not smooth."""

SHARED_STEP_S = 8.0
"""Shortest node step that all bodies share [s]: circular orbits need 12 s or more, the most eccentric ones 8.8 s."""

SHORTEST_STEP_S = 0.01
"""Shortest node step [s]."""

MOST_NODES = 20_000_000
"""Nodes of all objects together: 1 GB, and below 2 GB while they are made."""

MOST_NODES_OF_ONE = 5_000_000
"""Nodes of one object, which is sampled at once."""

MOST_ROUGH_NODES = 2_000_000
"""Nodes of a class of objects to which steps are shortened for motion that is not smooth."""

_N_TRIAL = 96
_CLASS = 4.0  # ratio of the steps of a class at most
_MANY = 1000  # of more objects only those whose error is not far from the largest are tried again
_TOGETHER = 256  # objects are cut into pieces of multiples of this: as free flight is integrated
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


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
    sampler = _Sampler(names, state, some_states, duration_s, error_m, np.asarray(counted_s, np.float64))
    left, found, room = np.arange(len(names)), dict[int, Track](), MOST_NODES
    least_s = SHARED_STEP_S
    while len(left):
        made, left = sampler.tracks_of_class(left, longest_s, least_s, room)
        found |= made
        room = max(1, room - sum(track.n_node for track in made.values()))
        least_s /= _CLASS
    return [found[number] for number in range(len(names))]


@dataclass(frozen=True, eq=False)
class _Sampler:
    """Sampling of the objects of a scene, some of them at a time."""

    names: Sequence[str]
    state: StateFunction
    some_states: SomeStatesFunction | None
    duration_s: float
    error_m: float
    counted_s: F64

    def choose(self, bodies: I64, longest_s: float, shortest_s: float, least_s: float = 0.0) -> tuple[float, I64]:
        """Choose a step for bodies that keeps the error between nodes small; those that need less than least_s go.

        The error of smooth motion scales with the fourth power of the step; trials at intervals spread over the scene,
        and never outside it, give the step. It divides the scene evenly, and aims at 80 % of the bound to leave room
        for what is between the trials. Motion that is not smooth, as that of a table with few digits, may never come
        below the bound: then the step is taken from where shorter ones stop to help.
        """
        duration_s, bound_m = self.duration_s, 0.8 * self.error_m
        step_s = even_step_s(duration_s, max(min(30.0, longest_s), shortest_s))
        before = math.inf, step_s  # error and step of the last shorter trial
        too_long_s = math.inf
        tried = bodies
        for _ in range(24):
            errors_m = self._trial_errors_m(tried, step_s)
            stays = step_s * (bound_m / np.maximum(errors_m, 1e-300)) ** 0.25 >= least_s
            bodies, tried, errors_m = np.setdiff1d(bodies, tried[~stays]), tried[stays], errors_m[stays]
            if not len(bodies):
                break
            if not len(tried):  # those left have not been tried with this step
                tried = bodies
                continue
            if len(tried) > _MANY:
                tried = tried[errors_m >= 0.1 * errors_m.max()]
            worst_m = float(errors_m.max())
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
            next_s = even_step_s(duration_s, proposed_s)
            if next_s == step_s or (ratio >= 1.0 and next_s >= too_long_s):
                break
            step_s = next_s
        return step_s, bodies

    def tracks_of_class(self, bodies: I64, longest_s: float, least_s: float, room: int) -> tuple[dict[int, Track], I64]:
        """Sample those of some bodies that need least_s or more, with one step; and the others, that need less.

        room is how many nodes there may be.
        """
        duration_s, error_m = self.duration_s, self.error_m
        shortest_s = max(SHORTEST_STEP_S, duration_s * len(bodies) / room, duration_s / MOST_NODES_OF_ONE)
        if least_s <= shortest_s:
            least_s = 0.0
        step_s, own = self.choose(bodies, longest_s, shortest_s, least_s)
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
            step_s = even_step_s(duration_s, max(shortest_s, proposed_s))
        if not len(own):
            return {}, bodies
        if worst_m > WORST_TRACK_ERROR_M:
            self._refuse(own, tracks, step_s, shortest_s)
        return dict(zip(own.tolist(), tracks, strict=True)), np.setdiff1d(bodies, own)

    def _refuse(self, bodies: I64, tracks: Sequence[Track], step_s: float, shortest_s: float) -> None:
        """Refuse tracks that are more than WORST_TRACK_ERROR_M off."""
        rough = max(tracks, key=lambda track: track.error_m)
        if SHORTEST_STEP_S < step_s <= shortest_s:
            longer_s = even_step_s(self.duration_s, 2.0 * step_s)
            longer_m = max(track.error_m for track in self._sampled(bodies, longer_s))
            if longer_s == step_s or longer_m > 2.0**0.5 * rough.error_m:
                raise InputError(
                    f"{self.duration_s:g} s are too long for {len(self.names)} satellites and targets: between as "
                    f"many orbit nodes as fit into memory, {step_s:.3g} s apart, {rough.name} is "
                    f"{rough.error_m:.3g} m off near {rough.error_at_s:.6g} s",
                    "duration_s",
                )
        raise InputError(
            f"the motion must be smooth, but near {rough.error_at_s:.6g} s it is {rough.error_m:.3g} m off between "
            f"nodes {step_s:.3g} s apart",
        ).of(rough.name)

    def _sampled(self, bodies: I64, step_s: float) -> list[Track]:
        """Tracks over a scene that the step divides evenly; outside it the motion is free."""
        start_s, n_node = node_grid(self.duration_s, step_s)
        ends = round(-start_s / step_s), n_node - 2
        found: list[Track] = []
        for names, state, spans_s in self._pieces(bodies, 2 * n_node):
            found += sample_tracks(names, state, start_s, step_s, n_node, spans_s, ends)
        return found

    def _trial_errors_m(self, bodies: I64, step_s: float) -> F64:
        """Largest error of each body in intervals, as _trial_error_m [m]."""
        n_time = min(2 * n_step(self.duration_s, step_s) + 1, 7 * _N_TRIAL)
        return np.concatenate([
            _trial_error_m(partial(finite_states, names, state), self.duration_s, step_s, spans_s)
            for names, state, spans_s in self._pieces(bodies, n_time)
        ])  # fmt: skip

    def _pieces(self, bodies: I64, n_time: int) -> Iterator[tuple[Sequence[str], StateFunction, F64]]:
        """Names, states and spans of bodies, so many at a time that their states at n_time times take little memory."""
        at_once = max(1, PAIRS_PER_PIECE // n_time)
        at_once -= at_once % _TOGETHER if at_once > _TOGETHER else 0
        for some in np.split(bodies, range(at_once, len(bodies), at_once)):
            is_all = len(some) == len(self.names)
            names = [self.names[number] for number in some.tolist()]
            spans_s = self.counted_s[some] if self.counted_s.ndim > 1 else self.counted_s
            yield names, self.state if is_all else self._states_of(some), spans_s

    def _states_of(self, bodies: I64) -> StateFunction:
        some_states = self.some_states
        if some_states is not None:
            return lambda time_s: some_states(time_s, bodies)

        def cut(time_s: F64) -> tuple[F64, F64]:
            position_m, velocity_m_s = self.state(time_s)
            return position_m[:, bodies], velocity_m_s[:, bodies]

        return cut


def _trial_error_m(state: StateFunction, duration_s: float, step_s: float, counted_s: ArrayLike) -> F64:
    """Largest error of each object in intervals: all of a short scene, or some spread evenly over a long one."""
    n_interval = n_step(duration_s, step_s)
    if n_interval <= _N_TRIAL:
        dense_m, velocity_m_s = state(0.5 * step_s * np.arange(2 * max(1, n_interval) + 1, dtype=np.float64))
        _, missed_m = assessed(dense_m, velocity_m_s[::2], step_s)
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
    slope_m_s = np.stack([central(p[0], p[1], p[3], p[4], h_s), central(p[2], p[3], p[5], p[6], h_s)])
    v = v[[2, 4]]
    replaced = np.median(np.linalg.norm(slope_m_s - v, axis=-1), axis=(0, 1)) > INCONSISTENT_M_S
    v = np.where(replaced[:, None], slope_m_s, v)
    return np.asarray(np.linalg.norm(interpolated_middle_m(p[2], p[4], v[0], v[1], step_s) - p[3], axis=-1))
