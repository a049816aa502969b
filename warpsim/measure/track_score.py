"""Scores of tracks against truth: OSPA, GOSPA and SIAP, by Stone Soup's metrics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.arguments import above_zero, plain_number, whole_number
from warpsim.errors import InputError
from warpsim.measure.paths import POSITION, VELOCITY, States, ordered_states, track_states, truth_states
from warpsim.measure.rows import check_stonesoup, dates

if TYPE_CHECKING:
    from astropy.table import Table


@dataclass(frozen=True, repr=False)
class TrackScore:
    """Scores of tracks over the times of the truth. Where nothing can be said a number is NaN."""

    by_time: Table
    """A row per time: date_obs, n_truth, n_track, ospa_m, gospa_m and its parts localisation, missed, false and
    switching [m**order]; completeness, ambiguity, spuriousness, position_m, velocity_m_s of the associated tracks."""
    completeness: float
    """SIAP: part of the targets that are tracked, over all times; 1 at best."""
    ambiguity: float
    """SIAP: tracks per tracked target; 1 at best."""
    spuriousness: float
    """SIAP: part of the tracks that are of no target; 0 at best."""
    position_m: float
    """SIAP: mean distance of associated tracks from their targets [m]."""
    velocity_m_s: float
    """SIAP: mean difference of their velocities [m/s]; NaN where tracks have none."""
    track_changes_per_s: float
    """SIAP: changes of the track of a target, over the time that targets are tracked [1/s]; 0 at best."""
    longest_segment: float
    """SIAP: part of its life in which a target has its longest track; 1 at best."""
    n_unscored: int
    """States of tracks at times that the truth does not have."""

    @property
    def ospa_m(self) -> float:
        """Mean over time of the OSPA distance [m]."""
        return float(np.mean(self.by_time["ospa_m"]))

    @property
    def gospa_m(self) -> float:
        """Mean over time of the GOSPA distance [m]."""
        return float(np.mean(self.by_time["gospa_m"]))

    def __repr__(self) -> str:
        distances = f"OSPA {self.ospa_m:.4g} m, GOSPA {self.gospa_m:.4g} m"
        siap = f"completeness {self.completeness:.3f}, spuriousness {self.spuriousness:.3f}"
        return f"TrackScore({distances}, {siap}, position {self.position_m:.4g} m)"


def tracks(
    found: Any,
    truth: Any,
    cutoff_m: float,
    order: float = 2.0,
    switching_m: float = 0.0,
    n_confirm: int = 3,
    n_end: int = 2,
    mapping: Sequence[int] = POSITION,
    velocity_mapping: Sequence[int] | None = VELOCITY,
) -> TrackScore:
    """Score tracks against the truth at the same times, by Stone Soup's metric generators.

    OSPA (Schuhmacher, Vo and Vo 2008) and GOSPA (Rahmathullah, Garcia-Fernandez and Svensson 2017, alpha = 2) are of
    each time, over the positions there are. SIAP (Votruba et al. 2001) goes by which track is of which target: the
    nearest within cutoff_m, n_confirm times in a row; n_end times farther away end it.

    Args:
        found: A set of Stone Soup's `Track` objects, or a table: track (its name), date_obs (UTC), x_m, y_m, z_m, and
            where known vx_m_s, vy_m_s, vz_m_s, geocentric in GCRS axes.
        truth: `FrameSet.truth`, or a table like it, of the targets that are to be tracked; or a set of
            `GroundTruthPath` objects. States are those at the time of the frame.
        cutoff_m: Distance from which on a track is none of a target's, the cost of a missed or false one [m].
        order: Exponent p of OSPA and GOSPA, at least 1.
        switching_m: GOSPA's penalty for each change of the track of a target [m].
        n_confirm: Times in a row that make an association, at least 2.
        n_end: Times in a row that end one.
        mapping: Rows of the position in the state vectors of Stone Soup's own tracks and paths.
        velocity_mapping: Rows of the velocity; None where there is none.

    Raises:
        InputError: Stone Soup is not installed, tracks and truth have no time in common, or a value is out of range.
    """
    check_stonesoup()
    cutoff, power = above_zero("cutoff_m", cutoff_m), plain_number(order, "", "order")
    penalty = plain_number(switching_m, "m", "switching_m")
    if not 1.0 <= power < np.inf or not 0.0 <= penalty < np.inf:
        raise InputError("must be at least 1, and at least 0", "order, switching_m", (order, switching_m))
    counts = whole_number("n_confirm", n_confirm, 2), whole_number("n_end", n_end, 1)
    maps = mapping, velocity_mapping
    of_truth = _own_states(truth, "truth", *maps) if _is_set(truth) else truth_states(truth, "frame")
    of_tracks = _own_states(found, "found", *maps) if _is_set(found) else track_states(found, "found")
    if not len(of_truth.when) or of_truth.when[0] == of_truth.when[-1]:
        raise InputError("must have states of two times or more", "truth")
    common = np.isin(of_tracks.when, of_truth.when)
    if len(common) and not common.any():
        raise InputError("must have a time in common with the truth", "found", str(of_tracks.when[0]), "s")
    from warpsim.measure.stonesoup_metrics import metrics_of

    metrics = metrics_of(of_tracks.where(common), of_truth, cutoff, power, penalty, counts)
    return _score(metrics, of_tracks.where(common), of_truth, int((~common).sum()))


def _score(metrics: dict[str, Any], of_tracks: States, of_truth: States, n_unscored: int) -> TrackScore:
    """The score of what Stone Soup's metrics say."""
    from astropy.table import Table

    when = np.unique(of_truth.when)
    table = Table({"date_obs": np.datetime_as_string(when, unit="us")})
    for name, states in (("n_truth", of_truth), ("n_track", of_tracks)):
        table[name] = [int((states.when == time).sum()) for time in when]
    table["ospa_m"] = [float(value) for value in metrics["OSPA"]]
    for name in ("distance", "localisation", "missed", "false", "switching"):
        table["gospa_m" if name == "distance" else name] = [float(value[name]) for value in metrics["GOSPA"]]
    for name, title in _SIAP.items():
        table[name] = np.array(metrics[f"{title} at times"], dtype=np.float64)
    tracked = np.asarray(table["completeness"]) > 0.0
    for name in ("ambiguity", "position_m", "velocity_m_s"):
        table[name][~tracked] = np.nan  # zeros of Stone Soup's, where nothing is tracked
    table["spuriousness"][np.asarray(table["n_track"]) == 0] = np.nan
    siap = {name: float(metrics[title]) for name, title in _SIAP.items()}
    if not np.isfinite(np.concatenate([of_tracks.vector, of_truth.vector])).all():
        table["velocity_m_s"] = siap["velocity_m_s"] = np.nan
    if not tracked.any():
        siap |= dict.fromkeys(("ambiguity", "position_m", "velocity_m_s"), np.nan)
    if not len(of_tracks.when):
        siap["spuriousness"] = np.nan
    changes, longest = metrics["Rate of Track Number Change"], metrics["Longest Track Segment"]
    return TrackScore(table, **siap, track_changes_per_s=changes, longest_segment=longest, n_unscored=n_unscored)


_SIAP = {
    "completeness": "Completeness", "ambiguity": "Ambiguity", "spuriousness": "Spuriousness",
    "position_m": "Position Accuracy", "velocity_m_s": "Velocity Accuracy",
}  # fmt: skip
"""Stone Soup's titles of numbers of the score."""


def _is_set(items: Any) -> bool:
    """Whether these are Stone Soup's own objects, and no table."""
    return isinstance(items, set | frozenset | list | tuple)


def _own_states(items: Any, where: str, mapping: Sequence[int], velocity_mapping: Sequence[int] | None) -> States:
    """States of Stone Soup's tracks or paths: the last of each time."""
    name, when, position, velocity = [], [], [], []
    try:
        for item in items:
            for state in item.last_timestamp_generator():
                vector = np.asarray(getattr(state, "mean", state.state_vector), dtype=np.float64).ravel()
                name.append(str(item.id))
                when.append(state.timestamp)
                position.append(vector[list(mapping)])
                velocity.append(np.full(3, np.nan) if velocity_mapping is None else vector[list(velocity_mapping)])
    except (AttributeError, IndexError, TypeError, ValueError) as error:
        raise InputError(
            f"must be Stone Soup's tracks or paths, with the rows of the mapping: {error}", where
        ) from None
    columns = {"date_obs": np.array(when, dtype=object), "track": np.array(name, dtype=str)}
    times = dates(columns, "date_obs", where)
    position_m, velocity_m_s = (np.array(part, dtype=np.float64).reshape(-1, 3) for part in (position, velocity))
    return ordered_states(columns["track"], times, position_m, velocity_m_s, np.arange(len(times)))
