"""Paths of aircraft and ships: geodetic positions in the Earth's axes, and great arcs between waypoints."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from warpsim.arrays import F64
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING

_ECCENTRICITY_SQUARED = EARTH_FLATTENING * (2.0 - EARTH_FLATTENING)

_ARC_RAD = 1e-3
"""Longest piece of a great arc: its cubic is 1e-7 m off."""

_TURN_S = 2.0
"""Time before and after a waypoint in which the velocity turns."""


def geodetic_to_itrs_m(lon_deg: ArrayLike, lat_deg: ArrayLike, altitude_m: ArrayLike) -> F64:
    """Return Earth-fixed positions [m] of WGS84 geodetic coordinates, broadcast shape plus (3,)."""
    lon, lat, altitude = np.broadcast_arrays(np.radians(lon_deg), np.radians(lat_deg), np.asarray(altitude_m, float))
    normal = EARTH_EQUATORIAL_RADIUS_M / np.sqrt(1.0 - _ECCENTRICITY_SQUARED * np.sin(lat) ** 2)
    across = (normal + altitude) * np.cos(lat)
    along = (normal * (1.0 - _ECCENTRICITY_SQUARED) + altitude) * np.sin(lat)
    return np.stack([across * np.cos(lon), across * np.sin(lon), along], axis=-1)


def great_arcs(time_s: F64, position_m: F64) -> tuple[F64, F64, F64]:
    """Return times, positions [m] and velocities [m/s] along great arcs between waypoints, at most 1e-3 rad apart.

    Directions turn, and radii change, at constant rates; at a waypoint the velocity turns within 2 s before and after.
    """
    if len(time_s) < 2:
        return time_s, position_m, np.zeros_like(position_m)
    radius_m = np.linalg.norm(position_m, axis=1)
    direction = position_m / radius_m[:, None]
    across = np.cross(direction[:-1], direction[1:])
    sine = np.linalg.norm(across, axis=1)
    angle = np.arctan2(sine, np.sum(direction[:-1] * direction[1:], axis=1))
    times, leg = [], []
    for number, (start_s, end_s, turn) in enumerate(zip(time_s[:-1], time_s[1:], angle, strict=True)):
        even = np.linspace(start_s, end_s, max(2, int(np.ceil(turn / _ARC_RAD))) + 1)
        near = [start_s + _TURN_S, end_s - _TURN_S] if end_s - start_s > 4.0 * _TURN_S else []
        times.append(np.union1d(even, near))
        leg.append(np.full(len(times[-1]), number))
    now_s, row = np.concatenate(times), np.concatenate(leg)
    step_s, rise_m = np.diff(time_s)[row], np.diff(radius_m)[row]
    part = (now_s - time_s[row]) / step_s
    first, ahead = direction[row], np.cross(across[row] / np.maximum(sine, 1e-300)[row, None], direction[row])
    turned, length_m = (part * angle[row])[:, None], radius_m[row] + part * rise_m
    there = first * np.cos(turned) + ahead * np.sin(turned)
    along = ahead * np.cos(turned) - first * np.sin(turned)
    velocity_m_s = (angle[row] / step_s * length_m)[:, None] * along + (rise_m / step_s)[:, None] * there
    begins = np.flatnonzero(np.diff(row)) + 1  # of each leg but the first; the end of the one before is left out
    velocity_m_s[begins] = 0.5 * (velocity_m_s[begins - 1] + velocity_m_s[begins])
    kept = np.delete(np.arange(len(row)), begins - 1)
    return now_s[kept], (length_m[:, None] * there)[kept], velocity_m_s[kept]
