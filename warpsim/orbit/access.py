"""Access: when a sensor may look at a target, as signed margins (>= 0 where a rule holds) and as time intervals.

The Earth never may be in the way; the other rules are those of AccessConstraints. All geometry is instantaneous (light
time shifts a target by at most 0.15 km at 6,000 km). The field of view plays no part, since a camera can be aimed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING
from warpsim.describe import Number, Positive, closed_interval, part
from warpsim.errors import InputError
from warpsim.orbit.earth import meridian_altitude_m

F64 = NDArray[np.float64]

PositionFunction = Callable[[F64], F64]
"""time_s (n_time,) -> geocentric position, GCRS axes [m], (n_time, 3). `Track.position_at_m` is one."""

Elevation = Annotated[Number, closed_interval(-90, 90)]
HalfTurn = Annotated[Number, closed_interval(0, 180)]

_RESOLUTION_S = 1e-3
_PAIRS_PER_CHUNK = 200_000  # (sensor, time) pairs held at once: about 100 MB of temporaries
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


@part
class AccessConstraints:
    """Rules for looking at a target; None leaves a rule out. The paper's Table 4: 6000, -32, 250 and 60."""

    max_range_km: Positive | None = None
    """Longest distance sensor to target."""
    min_elevation_deg: Elevation | None = None
    """Lowest elevation of the line of sight above the plane perpendicular to the sensor's geocentric position."""
    min_grazing_altitude_km: Number | None = None
    """Lowest WGS84 altitude on the segment between sensor and target, its ends included."""
    min_solar_exclusion_deg: HalfTurn | None = None
    """Smallest angle at the sensor between target and Sun."""


class AccessInterval(NamedTuple):
    """One uninterrupted access."""

    sensor: int
    """Index into the sensors given."""
    start_s: float
    end_s: float


def grazing_altitude_m(start_m: ArrayLike, end_m: ArrayLike, pole_icrs: ArrayLike) -> F64:
    """Return the lowest WGS84 altitude on segments [m], broadcast shape of (..., 3) without the last axis.

    Height above an ellipsoid is convex along a straight line, so it has one minimum: found by Newton's method on its
    slope (geodetic normal times direction) from the point nearest the centre in stretched axes, where the ellipsoid is
    a sphere. Error below 1e-6 m for lines above the surface. For lines that pass through the Earth the sign is right.
    """
    a, b, pole = (np.asarray(x, np.float64) for x in (start_m, end_m, pole_icrs))
    path = b - a
    # All that matters is the meridian half-plane: distance from the axis squared is a quadratic along the segment.
    a_up, path_up = a @ pole, path @ pole
    a_square = np.einsum("...i,...i->...", a, a) - a_up**2
    path_square = np.einsum("...i,...i->...", path, path)
    path_out_square = path_square - path_up**2
    mixed = np.einsum("...i,...i->...", a, path) - a_up * path_up
    stretch = (1.0 - EARTH_FLATTENING) ** -2
    s = -(mixed + stretch * a_up * path_up) / np.maximum(path_out_square + stretch * path_up**2, 1e-30)
    s = np.clip(s, 0.0, 1.0)
    lowest: F64 | float = np.inf
    for _ in range(4):
        across = np.sqrt(np.maximum(a_square + s * (2.0 * mixed + s * path_out_square), 1.0))
        height, cosine, sine = meridian_altitude_m(across, a_up + s * path_up)
        lowest = np.minimum(lowest, height)
        slope = cosine * (mixed + s * path_out_square) / across + sine * path_up
        # A shell of radius rho + h bends the height; rho within 0.7 %, so each round gains two digits or more.
        bend = (path_square - slope**2) / np.maximum(EARTH_EQUATORIAL_RADIUS_M + height, 1e6)
        s = np.clip(s - slope / np.maximum(bend, 1e-30 + 1e-9 * path_square / EARTH_EQUATORIAL_RADIUS_M), 0.0, 1.0)
    return np.asarray(lowest)


def margins(
    sensor_m: ArrayLike, target_m: ArrayLike, sun_m: ArrayLike, constraints: AccessConstraints, pole_icrs: ArrayLike
) -> dict[str, F64]:
    """Return the signed margin of each rule in force, >= 0 where it holds.

    Args:
        sensor_m: Sensor positions, geocentric, GCRS axes [m], (n_sensor, n_time, 3).
        target_m: Target positions [m], (n_time, 3) or broadcastable.
        sun_m: Sun positions [m], (n_time, 3) or broadcastable.
        constraints: The rules.
        pole_icrs: Unit vector of the ellipsoid's axis, the pole of date, (3,).

    Returns:
        Arrays of the broadcast shape, (n_sensor, n_time): "earth_km" (lowest altitude on the segment) always, and
        those asked for of "range_km", "elevation_deg", "grazing_altitude_km", "solar_exclusion_deg".
    """
    sensor, target, sun = (np.asarray(x, np.float64) for x in (sensor_m, target_m, sun_m))
    sight = target - sensor
    distance = np.sqrt(np.einsum("...i,...i->...", sight, sight))
    safe = np.maximum(distance, 1e-9)  # a target in the sensor has range 0 and no direction: angles of 0 and 90
    grazing_km = 1e-3 * grazing_altitude_m(sensor, target, pole_icrs)
    result = {"earth_km": grazing_km}
    if constraints.max_range_km is not None:
        result["range_km"] = constraints.max_range_km - 1e-3 * distance
    if constraints.min_elevation_deg is not None:
        sine = np.einsum("...i,...i->...", sight, sensor) / (safe * np.linalg.norm(sensor, axis=-1))
        result["elevation_deg"] = np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0))) - constraints.min_elevation_deg
    if constraints.min_grazing_altitude_km is not None:
        result["grazing_altitude_km"] = grazing_km - constraints.min_grazing_altitude_km
    if constraints.min_solar_exclusion_deg is not None:
        to_sun = sun - sensor
        along = np.einsum("...i,...i->...", sight, to_sun)
        across = np.linalg.norm(np.cross(sight, to_sun), axis=-1)  # atan2: exact near 0 and 180 degrees as well
        result["solar_exclusion_deg"] = np.degrees(np.arctan2(across, along)) - constraints.min_solar_exclusion_deg
    return result


def access_intervals(
    sensor_position_m: Sequence[PositionFunction],
    target_position_m: PositionFunction,
    sun_position_m: PositionFunction,
    constraints: AccessConstraints,
    pole_icrs: ArrayLike,
    duration_s: float,
    step_s: float = 10.0,
) -> list[AccessInterval]:
    """Return all intervals within [0, duration_s] in which every rule holds, by sensor, then time.

    A scan at step_s finds the changes; local extrema of the smallest margin that could cross zero between scan points
    are searched out, so windows (and gaps) shorter than a step are found as well. Ends are bisected to 1 ms and clipped
    to the scenario.

    Args:
        sensor_position_m: One function per sensor; `Track.position_at_m` is the fast choice.
        target_position_m: The target's positions.
        sun_position_m: The Sun's positions; a track costs less than the ephemeris itself.
        constraints: The rules.
        pole_icrs: Pole of date, (3,).
        duration_s: Length of the scenario [s], > 0.
        step_s: Scan step [s], > 0; a twentieth of the fastest orbit or less.
    """
    if not (np.isfinite(duration_s) and duration_s > 0):
        raise InputError(f"duration_s: must be > 0, got {duration_s}")
    if not (np.isfinite(step_s) and step_s > 0):
        raise InputError(f"step_s: must be > 0, got {step_s}")
    time_s = np.linspace(0.0, duration_s, max(3, int(np.ceil(duration_s / step_s)) + 1))
    target_m, sun_m = target_position_m(time_s), sun_position_m(time_s)
    intervals: list[AccessInterval] = []
    chunk = max(1, _PAIRS_PER_CHUNK // len(time_s))
    for first in range(0, len(sensor_position_m), chunk):
        sensors = sensor_position_m[first : first + chunk]

        def smallest_at(sensor: NDArray[np.int64], t: F64, sensors: Sequence[PositionFunction] = sensors) -> F64:
            """Smallest margin of (sensor, time) pairs; sensors in ascending order."""
            position = np.empty((len(t), 3))
            edge = np.searchsorted(sensor, np.arange(len(sensors) + 1))
            for i in np.unique(sensor):
                position[edge[i] : edge[i + 1]] = sensors[i](t[edge[i] : edge[i + 1]])
            return _smallest(margins(position, target_position_m(t), sun_position_m(t), constraints, pole_icrs))

        position_m = np.stack([position(time_s) for position in sensors])
        margin = _smallest(margins(position_m, target_m, sun_m, constraints, pole_icrs))
        intervals += [
            AccessInterval(first + i, start, end) for i, start, end in _intervals(margin, time_s, smallest_at)
        ]
    return intervals


def _smallest(by_name: dict[str, F64]) -> F64:
    """The smallest margin, 100 km counted like one degree; only its sign and its course near zero matter."""
    smallest: F64 = np.minimum.reduce(
        [value * (0.01 if name.endswith("_km") else 1.0) for name, value in by_name.items()]
    )
    return smallest


PairFunction = Callable[[NDArray[np.int64], F64], F64]


def _intervals(margin: F64, time_s: F64, smallest_at: PairFunction) -> list[tuple[int, float, float]]:
    """Turn scanned margins (n_sensor, n_time) into intervals."""
    n_sensor, n_time = margin.shape
    sensor = np.repeat(np.arange(n_sensor), n_time)
    extra_sensor, extra_s, extra_margin = _extrema(margin, time_s, smallest_at)
    sensor = np.concatenate([sensor, extra_sensor])
    t = np.concatenate([np.tile(time_s, n_sensor), extra_s])
    inside = np.concatenate([margin.ravel(), extra_margin]) >= 0.0
    order = np.lexsort((t, sensor))
    sensor, t, inside = sensor[order], t[order], inside[order]

    change = np.flatnonzero((inside[1:] != inside[:-1]) & (sensor[1:] == sensor[:-1]))
    low, high, rises = t[change], t[change + 1], inside[change + 1]
    while len(low) and np.max(high - low) > _RESOLUTION_S:
        middle = 0.5 * (low + high)
        upper = (smallest_at(sensor[change], middle) >= 0.0) == rises  # the change lies below the middle
        low, high = np.where(upper, low, middle), np.where(upper, middle, high)
    # The end point is the side inside: every instant reported keeps all the rules.
    edge_sensor, edge_s = sensor[change], np.where(rises, high, low)

    first, last = time_s[0], time_s[-1]
    begins = np.flatnonzero(margin[:, 0] >= 0.0)
    ends = np.flatnonzero(margin[:, -1] >= 0.0)
    start_sensor = np.concatenate([begins, edge_sensor[rises]])
    start_s = np.concatenate([np.full(len(begins), first), edge_s[rises]])
    end_sensor = np.concatenate([ends, edge_sensor[~rises]])
    end_s = np.concatenate([np.full(len(ends), last), edge_s[~rises]])
    starts, stops = np.lexsort((start_s, start_sensor)), np.lexsort((end_s, end_sensor))
    return [
        (int(i), float(a), float(b))
        for i, a, b in zip(start_sensor[starts], start_s[starts], end_s[stops], strict=True)
    ]


def _extrema(margin: F64, time_s: F64, smallest_at: PairFunction) -> tuple[NDArray[np.int64], F64, F64]:
    """Search out the extrema that may cross zero between scan points: sensor, time and margin of each.

    Maxima below zero and minima above it are candidates when the margin, changing twice as fast as around them, could
    reach zero within a step.
    """
    n_time = margin.shape[1]
    before = np.concatenate([margin[:, 1:2], margin[:, :-1]], axis=1)  # ends: mirrored
    after = np.concatenate([margin[:, 1:], margin[:, -2:-1]], axis=1)
    sign = np.where(margin < 0.0, 1.0, -1.0)  # +1: looking for a maximum
    peak = (sign * margin >= sign * before) & (sign * margin >= sign * after)
    reach = 2.0 * np.maximum(np.abs(margin - before), np.abs(margin - after))
    sensor, column = np.nonzero(peak & (np.abs(margin) <= reach))
    sign = sign[sensor, column]
    low, high = time_s[np.maximum(column - 1, 0)], time_s[np.minimum(column + 1, n_time - 1)]
    best_s, best = time_s[column], margin[sensor, column]
    if len(sensor) == 0:
        return sensor, best_s, best
    # Golden section, all candidates side by side.
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = sign * smallest_at(sensor, left), sign * smallest_at(sensor, right)
    while np.max(high - low) > 0.1 * _RESOLUTION_S:
        go_left = at_left >= at_right
        low, high = np.where(go_left, low, left), np.where(go_left, right, high)
        probe = np.where(go_left, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
        value = sign * smallest_at(sensor, probe)
        left, right = np.where(go_left, probe, right), np.where(go_left, left, probe)
        at_left, at_right = np.where(go_left, value, at_right), np.where(go_left, at_left, value)
        for t, v in ((left, at_left), (right, at_right)):
            better = v > sign * best
            best_s, best = np.where(better, t, best_s), np.where(better, sign * v, best)
    keep = np.where(sign > 0.0, best >= 0.0, best < 0.0)  # crossed zero; the others change nothing
    return sensor[keep], best_s[keep], best[keep]
