"""States of bodies in tables of truth and of tracks: over time, and in Earth-fixed axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from warpsim.arguments import chosen_names
from warpsim.arrays import F64
from warpsim.constants import EARTH_GM_M3_S2, SPEED_OF_LIGHT_M_S
from warpsim.errors import InputError
from warpsim.instant import Epoch
from warpsim.measure.rows import column, dates, has_column, numbers
from warpsim.orbit.earth import gcrs_to_geodetic, itrs_to_gcrs

if TYPE_CHECKING:
    from astropy.table import Table


POSITION, VELOCITY = (0, 2, 4), (1, 3, 5)
"""Rows of Stone Soup's own state vectors: x, vx, y, vy, z, vz."""

BODIES = ("sensor", "target")

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


def earth_fixed(table: Table, epoch: Epoch, bodies: str | Sequence[str] | None = None) -> Table:
    """Return a copy of a table of states with Earth-fixed ones beside them.

    Of each body, besides `sensor_x_m` and their like: sensor_itrs_x_m, sensor_itrs_y_m and sensor_itrs_z_m (ITRS),
    sensor_lon_deg, sensor_lat_deg and sensor_height_m (geodetic, WGS84). Of targets they are those of the time when
    the light left, `range_km` / c before `time_s`. Without tables of the Earth's rotation from the network (UT1 is
    taken as warpsim does everywhere).

    Args:
        table: Truth, or any table with time_s and the columns of states.
        epoch: From which time_s counts: `scene.epoch`.
        bodies: "sensor", "target" or both; those that the table has when left out.

    Raises:
        InputError: A column is missing.
    """
    found = table.copy()
    known = [body for body in BODIES if f"{body}_x_m" in table.colnames]
    chosen = known if bodies is None else chosen_names("bodies", bodies, list(BODIES))
    for body in chosen or BODIES:
        names = [f"{body}_{axis}_m" for axis in "xyz"]
        required = ["time_s", *names, *(["range_km"] if body == "target" else [])]
        if missing := [name for name in required if name not in table.colnames]:
            raise InputError(f"must have {', '.join(missing)}", "table")
        position_m = np.column_stack([np.asarray(table[name], dtype=np.float64) for name in names])
        time_s = np.asarray(table["time_s"], dtype=np.float64)
        if body == "target":
            time_s = time_s - 1e3 * np.asarray(table["range_km"], dtype=np.float64) / SPEED_OF_LIGHT_M_S
        there = np.isfinite(time_s) & np.isfinite(position_m).all(axis=1)
        columns = np.full((6, len(table)), np.nan)
        columns[:3, there] = np.einsum("nji,nj->in", itrs_to_gcrs(epoch, time_s[there]), position_m[there])
        columns[3:, there] = gcrs_to_geodetic(position_m[there], epoch, time_s[there])
        new = [f"{body}_itrs_{axis}_m" for axis in "xyz"]
        new += [f"{body}_lon_deg", f"{body}_lat_deg", f"{body}_height_m"]
        for name, values, unit in zip(new, columns, ("m", "m", "m", "deg", "deg", "m"), strict=True):
            found[name] = values
            found[name].unit = unit
    return found
