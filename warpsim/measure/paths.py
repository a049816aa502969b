"""States of bodies over time, from tables of truth and of tracks."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from warpsim.constants import EARTH_GM_M3_S2, SPEED_OF_LIGHT_M_S
from warpsim.errors import InputError
from warpsim.measure.rows import column, dates, has_column, numbers

F64 = npt.NDArray[np.float64]

POSITION, VELOCITY = (0, 2, 4), (1, 3, 5)
"""Rows of Stone Soup's own state vectors: x, vx, y, vy, z, vz."""


_NEEDED = (
    "target", "date_obs", "range_km", "target_x_m", "target_y_m", "target_z_m",
    "target_vx_m_s", "target_vy_m_s", "target_vz_m_s",
)  # fmt: skip


class States(NamedTuple):
    """States of named bodies, in the order of time, (n,) each."""

    name: npt.NDArray[Any]
    when: npt.NDArray[np.datetime64]
    """UTC, to the microsecond."""
    vector: F64
    """x, vx, y, vy, z, vz, geocentric, GCRS axes [m, m/s], (n, 6); NaN where a velocity is not known."""
    row: npt.NDArray[np.int64]
    """Row of the table that each is from."""

    def where(self, chosen: npt.NDArray[np.bool_]) -> States:
        """Some of the states."""
        return States(self.name[chosen], self.when[chosen], self.vector[chosen], self.row[chosen])


def truth_states(truth: Any, at: str) -> States:
    """States of targets from truth, each once for each time.

    Truth says where targets were when their light left. At the time of the frame they are where free fall has taken
    them since, under two-body gravity: 1e-6 m beyond what J2 does in light times of milliseconds.

    Args:
        truth: `FrameSet.truth`, or a table like it.
        at: "frame", or "emission" for the times at which the light left, which differ from sensor to sensor.

    Raises:
        InputError: A column is missing, `at` is another word, or no target is anywhere.
    """
    if at not in ("frame", "emission"):
        raise InputError("must be frame or emission", "at", at)
    axes = ("x", "y", "z")
    known = np.isfinite(column(truth, "target_x_m", "truth").astype(np.float64))  # absent targets have no state
    rows = np.flatnonzero(known)
    if not len(rows):
        raise InputError("must have a row of a target that is somewhere", "truth")
    used = {name: column(truth, name, "truth")[rows] for name in _NEEDED}
    position_m = numbers(used, [f"target_{axis}_m" for axis in axes], "truth")
    velocity_m_s = numbers(used, [f"target_v{axis}_m_s" for axis in axes], "truth")
    delay_s = 1e3 * numbers(used, ["range_km"], "truth")[:, 0] / SPEED_OF_LIGHT_M_S
    if has_column(truth, "row_time_s"):
        delay_s = delay_s - np.nan_to_num(column(truth, "row_time_s", "truth")[rows].astype(np.float64))
    when = dates(used, "date_obs", "truth")
    if at == "emission":
        when = when - np.rint(1e6 * delay_s).astype("timedelta64[us]")
    else:
        pull_m_s2 = -EARTH_GM_M3_S2 * position_m / np.linalg.norm(position_m, axis=1, keepdims=True) ** 3
        delay = delay_s[:, None]
        position_m = position_m + delay * velocity_m_s + 0.5 * delay**2 * pull_m_s2
        velocity_m_s = velocity_m_s + delay * pull_m_s2
    return ordered_states(used["target"], when, position_m, velocity_m_s, rows)


def track_states(tracks: Any, where: str) -> States:
    """States of a table of tracks: track, date_obs, x_m, y_m, z_m, and where known vx_m_s, vy_m_s, vz_m_s.

    Raises:
        InputError: A column is missing, or holds what is no number or no date.
    """
    position_m = numbers(tracks, ("x_m", "y_m", "z_m"), where)
    velocity_m_s = np.full(position_m.shape, np.nan)
    if has_column(tracks, "vx_m_s"):
        velocity_m_s = numbers(tracks, ("vx_m_s", "vy_m_s", "vz_m_s"), where)
    when = dates(tracks, "date_obs", where)
    return ordered_states(column(tracks, "track", where), when, position_m, velocity_m_s, np.arange(len(when)))


def ordered_states(
    name: npt.NDArray[Any], when: npt.NDArray[Any], position_m: F64, velocity_m_s: F64, row: npt.NDArray[Any]
) -> States:
    """Put states in the order of time, the first row of each body and time."""
    named = np.unique(name, return_inverse=True)[1]
    order = np.lexsort((named, when))
    later, other = np.diff(when[order]) > np.timedelta64(0), np.diff(named[order]) != 0
    kept = order[np.r_[True, later | other]] if len(order) else order
    vector = np.stack([position_m, velocity_m_s], axis=2).reshape(-1, 6)
    return States(name[kept], when[kept], vector[kept], row[kept])
