"""Orbits by Kepler elements or by a state: one object, osculating at the scene's epoch, GCRS axes.

Elements are referred to the GCRS equator and its x axis. A circular orbit has no perigee and an equatorial one no node:
`state_to_elements` then puts the perigee at the node, or the node on the x axis, and keeps the sum of the angles exact,
so that the state comes back. Source of the formulas: Vallado, Fundamentals of Astrodynamics, sections 2.4 to 2.6.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, model_validator

from warpsim.arrays import F64
from warpsim.config.fields import Number, Positive, Vector, closed_interval
from warpsim.config.model import config_model, exactly_one
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_GM_M3_S2
from warpsim.errors import InputError
from warpsim.orbit.earth import EARTH_POLAR_RADIUS_M, pole_of_date
from warpsim.orbit.gravity import Gravity, propagate

if TYPE_CHECKING:
    from warpsim.instant import Epoch


_MAX_ECCENTRICITY = 0.999
"""Beyond, a float64 perigee loses more than three digits; a state vector loses none."""

LARGEST_SPEED_M_S = 1e6
"""Of a state: no body near the Earth is faster, and faster ones ask for ever shorter node steps."""


class Elements(NamedTuple):
    """Osculating elements of closed orbits, arrays of one shape; angles in [0, 360) degrees."""

    semi_major_axis_m: F64
    eccentricity: F64
    inclination_deg: F64
    """0 to 180."""
    raan_deg: F64
    """0 for an equatorial orbit."""
    argument_of_perigee_deg: F64
    """Counted from the node; 0 where the orbit is circular."""
    mean_anomaly_deg: F64
    true_anomaly_deg: F64


def eccentric_anomaly_rad(mean_anomaly_rad: ArrayLike, eccentricity: ArrayLike) -> F64:
    """Solve Kepler's equation M = E - e sin E for E [rad], in the turn of M; 0 <= e < 1.

    Newton's method with Halley's correction, kept within the bracket [M - e, M + e]. Error below 1e-15 / (1 - e cos E).
    """
    mean, e = np.broadcast_arrays(np.asarray(mean_anomaly_rad, np.float64), np.asarray(eccentricity, np.float64))
    turns = np.round(mean / (2.0 * np.pi)) * (2.0 * np.pi)
    m = mean - turns
    low, high = m - e, m + e
    anomaly = m + 0.85 * np.copysign(e, m)  # Danby's start
    for _ in range(60):
        sine, cosine = e * np.sin(anomaly), e * np.cos(anomaly)
        value, slope = anomaly - sine - m, 1.0 - cosine
        low, high = np.where(value <= 0.0, anomaly, low), np.where(value >= 0.0, anomaly, high)
        newton = value / slope
        step = value / (slope - 0.5 * newton * sine)
        moved = anomaly - step
        moved = np.where((moved >= low) & (moved <= high), moved, 0.5 * (low + high))
        settled = np.abs(moved - anomaly) <= 4e-16 * np.maximum(np.abs(anomaly), 1e-30)
        anomaly = moved
        if settled.all():
            break
    return np.asarray(anomaly + turns, np.float64)


def mean_anomaly_of_true_rad(true_anomaly_rad: ArrayLike, eccentricity: ArrayLike) -> F64:
    """Return the mean anomaly [rad] of a true one, in the same turn; 0 <= e < 1."""
    true, e = np.broadcast_arrays(np.asarray(true_anomaly_rad, np.float64), np.asarray(eccentricity, np.float64))
    turns = np.round(true / (2.0 * np.pi)) * (2.0 * np.pi)
    half = 0.5 * (true - turns)
    anomaly = 2.0 * np.arctan2(np.sqrt(1.0 - e) * np.sin(half), np.sqrt(1.0 + e) * np.cos(half))
    return np.asarray(anomaly - e * np.sin(anomaly) + turns, np.float64)


def elements_to_state(
    semi_major_axis_m: ArrayLike,
    eccentricity: ArrayLike,
    inclination_deg: ArrayLike,
    raan_deg: ArrayLike,
    argument_of_perigee_deg: ArrayLike,
    mean_anomaly_deg: ArrayLike,
) -> tuple[F64, F64]:
    """Return positions [m] and velocities [m/s] of closed orbits, each of the broadcast shape plus (3,)."""
    given = semi_major_axis_m, eccentricity, inclination_deg, raan_deg, argument_of_perigee_deg, mean_anomaly_deg
    a, e, *angles = np.broadcast_arrays(*(np.asarray(x, np.float64) for x in given))
    tilt, node, perigee, mean = (np.radians(np.mod(x, 360.0)) for x in angles)
    for name, bad, rule in (
        ("semi_major_axis_m", ~(a > 0.0) | ~np.isfinite(a), "> 0"),
        ("eccentricity", ~((e >= 0.0) & (e < 1.0)), "in [0, 1)"),
        ("angles", ~np.isfinite(tilt + node + perigee + mean), "finite"),
    ):
        if bad.any():
            raise InputError(f"must be {rule}, element {int(np.argmax(bad))} is not", name)
    anomaly = eccentric_anomaly_rad(mean, e)
    sine, cosine = np.sin(anomaly), np.cos(anomaly)
    narrow = np.sqrt((1.0 - e) * (1.0 + e))
    # 1 - e cos E, cos E - e: written so that nothing cancels near the perigee of a long ellipse.
    versine = 2.0 * np.sin(0.5 * anomaly) ** 2
    radius_ratio = (1.0 - e) + e * versine
    speed = np.sqrt(EARTH_GM_M3_S2 / a) / radius_ratio
    x, y = a * ((1.0 - e) - versine), a * narrow * sine
    vx, vy = -speed * sine, speed * narrow * cosine
    to_perigee, to_side = plane_axes(tilt, node, perigee)
    position = x[..., None] * to_perigee + y[..., None] * to_side
    velocity = vx[..., None] * to_perigee + vy[..., None] * to_side
    return position, velocity


def plane_axes(tilt: ArrayLike, node: F64, along: F64) -> tuple[F64, F64]:
    """Unit vectors in the orbit's plane: at the angle `along` from the node, and a quarter turn ahead."""
    zero = np.zeros_like(node)
    to_node = np.stack([np.cos(node), np.sin(node), zero], axis=-1)
    to_top = np.stack([-np.sin(node) * np.cos(tilt), np.cos(node) * np.cos(tilt), zero + np.sin(tilt)], axis=-1)
    cosine, sine = np.cos(along)[..., None], np.sin(along)[..., None]
    return cosine * to_node + sine * to_top, cosine * to_top - sine * to_node


def state_to_elements(position_m: ArrayLike, velocity_m_s: ArrayLike) -> Elements:
    """Return osculating elements of states of closed orbits, of their shape (..., 3) without the last axis."""
    r, v = np.broadcast_arrays(np.asarray(position_m, np.float64), np.asarray(velocity_m_s, np.float64))
    if r.shape[-1:] != (3,):
        raise InputError("must have shape (..., 3)", "position_m, velocity_m_s", r.shape)
    radius = np.linalg.norm(r, axis=-1)
    momentum = np.cross(r, v)
    size = np.linalg.norm(momentum, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        a = 1.0 / (2.0 / radius - np.einsum("...i,...i->...", v, v) / EARTH_GM_M3_S2)
        parameter = size**2 / EARTH_GM_M3_S2
        rise = np.einsum("...i,...i->...", r, v) / radius
        e_cos, e_sin = parameter / radius - 1.0, np.sqrt(parameter / EARTH_GM_M3_S2) * rise
        e = np.hypot(e_cos, e_sin)
    bad = ~((a > 0.0) & np.isfinite(a) & (e < 1.0) & (size > 0.0))
    if bad.any():
        raise InputError(f"must be a closed orbit, state {int(np.argmax(bad))} is not", "position_m, velocity_m_s")
    flat = np.hypot(momentum[..., 0], momentum[..., 1])
    tilt = np.arctan2(flat, momentum[..., 2])
    equatorial = flat <= 1e-15 * size
    node = np.where(equatorial, 0.0, np.arctan2(momentum[..., 0], -momentum[..., 1]))
    tilt = np.where(equatorial, np.where(momentum[..., 2] >= 0.0, 0.0, np.pi), tilt)
    to_node, to_top = plane_axes(tilt, node, np.zeros_like(node))
    # From the node to the object; the anomaly is taken off, so perigee and anomaly add up exactly.
    along = np.arctan2(np.einsum("...i,...i->...", r, to_top), np.einsum("...i,...i->...", r, to_node))
    circular = e <= 1e-15
    true = np.where(circular, along, np.arctan2(e_sin, e_cos))
    mean = mean_anomaly_of_true_rad(true, e)
    angles = (tilt, *(np.mod(x, 2.0 * np.pi) for x in (node, along - true, mean, true)))
    return Elements(a, e, *(np.degrees(x) for x in angles))


def entries(value: Any) -> Any:
    """Arrays and Quantity arrays become tuples, so that their entries are checked one by one."""
    return tuple(value) if isinstance(value, np.ndarray) and value.ndim == 1 else value


@config_model
class StateVector:
    """Free flight from a state, on any conic."""

    position_m: Annotated[Vector, BeforeValidator(entries)]
    """Geocentric position at time_s, GCRS axes."""
    velocity_m_s: Annotated[Vector, BeforeValidator(entries)]
    """Velocity at time_s, GCRS axes (inertial)."""
    time_s: Number = 0.0
    """Time of the state after the scene's epoch, of either sign."""
    gravity: Gravity = "j2"
    """What moves it: J2, J2 to J4, or the point mass alone."""
    kind: Literal["state_vector"] = "state_vector"

    @model_validator(mode="after")
    def _above_ground(self) -> StateVector:
        if (speed_m_s := math.hypot(*self.velocity_m_s)) > LARGEST_SPEED_M_S:
            raise InputError(f"must be at most {LARGEST_SPEED_M_S:g} m/s", "velocity_m_s", speed_m_s, "g")
        _check_radius("position_m", np.array(self.position_m))
        return self

    def state(self) -> tuple[F64, F64]:
        """Return position [m] and velocity [m/s] at time_s, GCRS axes, each (1, 3)."""
        return np.array([self.position_m]), np.array([self.velocity_m_s])

    def states(self, epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
        """Return positions [m] and velocities [m/s], GCRS axes, each (n_time, 1, 3).

        Args:
            epoch: The scene's epoch; it sets the pole that J2 acts about.
            time_s: Times [s since epoch], shape (n_time,).

        Raises:
            InputError: The path falls through half the Earth's radius.
        """
        times = np.asarray(time_s, np.float64) - self.time_s
        return propagate(*self.state(), times, self.gravity, pole_of_date(epoch), self.time_s)


@config_model
class KeplerOrbit:
    """A closed orbit by its elements, osculating at the scene's epoch; give one of the three sizes."""

    inclination_deg: Annotated[Number, closed_interval(0, 180)]
    """To the GCRS equator."""
    altitude_km: Positive | None = None
    """Of a circular orbit, above the equatorial radius, 6378.137 km."""
    perigee_altitude_km: Number | None = None
    """Above the equatorial radius."""
    semi_major_axis_km: Positive | None = None
    """Half the longest diameter of the ellipse."""
    eccentricity: Annotated[Number, closed_interval(0, _MAX_ECCENTRICITY)] = 0.0
    """0 is a circle."""
    raan_deg: Number = 0.0
    """Right ascension of the ascending node."""
    argument_of_perigee_deg: Number = 0.0
    """From the ascending node to the perigee, in the direction of motion."""
    mean_anomaly_deg: Number | None = None
    """At the epoch, from the perigee; 0 if neither anomaly is given."""
    true_anomaly_deg: Number | None = None
    """At the epoch, from the perigee; instead of the mean anomaly."""
    gravity: Gravity = "j2"
    """What moves it: J2, J2 to J4, or the point mass alone."""
    kind: Literal["elements"] = "elements"

    @model_validator(mode="after")
    def _consistent(self) -> KeplerOrbit:
        exactly_one(self, "altitude_km", "perigee_altitude_km", "semi_major_axis_km")
        if self.altitude_km is not None and self.eccentricity:
            rule = "is that of a circular orbit; with an eccentricity, give perigee_altitude_km"
            raise InputError(rule, "altitude_km", self.altitude_km, "g")
        if self.mean_anomaly_deg is not None and self.true_anomaly_deg is not None:
            raise InputError("at most one may be given", "mean_anomaly_deg, true_anomaly_deg")
        if not 0.0 < self.semi_major_axis_m < 1e12:
            raise InputError("must give a semi-major axis in (0, 1e9] km", "size", self.semi_major_axis_m / 1000.0, "g")
        _check_radius("orbit", self.state()[0][0])
        return self

    @property
    def semi_major_axis_m(self) -> float:
        """Semi-major axis [m]."""
        if self.semi_major_axis_km is not None:
            return 1e3 * self.semi_major_axis_km
        altitude_km = self.altitude_km if self.altitude_km is not None else self.perigee_altitude_km or 0.0
        return (EARTH_EQUATORIAL_RADIUS_M + 1e3 * altitude_km) / (1.0 - self.eccentricity)

    def state(self) -> tuple[F64, F64]:
        """Return position [m] and velocity [m/s] at the epoch, GCRS axes, each (1, 3)."""
        mean_deg = self.mean_anomaly_deg or 0.0
        if self.true_anomaly_deg is not None:
            true_rad = np.radians(np.mod(self.true_anomaly_deg, 360.0))
            mean_deg = float(np.degrees(mean_anomaly_of_true_rad(true_rad, self.eccentricity)))
        position, velocity = elements_to_state(
            self.semi_major_axis_m,
            self.eccentricity,
            self.inclination_deg,
            self.raan_deg,
            self.argument_of_perigee_deg,
            mean_deg,
        )
        return position[None], velocity[None]

    def states(self, epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
        """Return positions [m] and velocities [m/s], GCRS axes, each (n_time, 1, 3).

        Args:
            epoch: The scene's epoch, at which the elements hold; it sets the pole that J2 acts about.
            time_s: Times [s since epoch], shape (n_time,).

        Raises:
            InputError: The path falls through half the Earth's radius.
        """
        return propagate(*self.state(), np.asarray(time_s, np.float64), self.gravity, pole_of_date(epoch))


def _check_radius(field: str, position_m: F64) -> None:
    """Refuse states inside the Earth: most often metres and kilometres are mixed up."""
    radius_km = float(np.linalg.norm(position_m)) / 1e3
    if radius_km < EARTH_POLAR_RADIUS_M / 1e3:
        least_km = EARTH_POLAR_RADIUS_M / 1e3
        rule = f"must start above the Earth's surface, at least {least_km:.3f} km from its centre, got {radius_km:g} km"
        raise InputError(rule, field)
