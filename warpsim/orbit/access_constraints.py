"""Access constraints: signed margins of the geometry between sensor, target, Earth and Sun.

All geometry is instantaneous (light time shifts a target by at most 0.15 km at 6,000 km). Only the field of view may
take the apparent direction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated, NamedTuple, Protocol

import numpy as np
from pydantic import AfterValidator, model_validator

from warpsim.arrays import F64, I64
from warpsim.config.fields import Interval, Number, Positive, Switch, closed_interval
from warpsim.config.model import config_model
from warpsim.errors import InputError
from warpsim.orbit.earth import earth_clearance_m, grazing_altitude_m
from warpsim.orbit.sun import sunlit_depth

Elevation = Annotated[Number, closed_interval(-90, 90)]
HalfTurn = Annotated[Number, closed_interval(0, 180)]
Fraction = Annotated[Number, AfterValidator(Interval(0, 1, open_low=True))]


@config_model
class AccessConstraints:
    """Constraints for observing a target; None leaves one out. The paper's Table 4: 6000, -32, 250 and 60."""

    max_range_km: Positive | None = None
    """Longest distance sensor to target."""
    min_elevation_deg: Elevation | None = None
    """Lowest elevation of the line of sight above the plane perpendicular to the sensor's geocentric position."""
    min_grazing_altitude_km: Number | None = None
    """Lowest WGS84 altitude on the segment between sensor and target, its ends included."""
    min_solar_exclusion_deg: HalfTurn | None = None
    """Smallest angle at the sensor between target and Sun."""
    min_range_km: Positive | None = None
    """Shortest distance sensor to target."""
    max_elevation_deg: Elevation | None = None
    """Highest elevation of the line of sight."""
    min_background_altitude_km: Number | None = None
    """Lowest WGS84 altitude on the whole ray from the sensor through the target and beyond: seen against space."""
    min_target_sunlit: Fraction | None = None
    """Smallest fraction of the Sun's disc that the target sees past the Earth."""
    in_fov: Switch = False
    """Whether the target must lie within the camera's frame."""

    @model_validator(mode="after")
    def _ordered(self) -> AccessConstraints:
        for low, high in (("min_range_km", "max_range_km"), ("min_elevation_deg", "max_elevation_deg")):
            least, most = getattr(self, low), getattr(self, high)
            if least is not None and most is not None and least > most:
                raise InputError(f"must be at most {high} ({most:g})", low, least, "g")
        return self


AxesFunction = Callable[[int, F64], F64]
"""number of the sensor, time_s (n,) -> camera axes as rows x, y, z, GCRS axes, (n, 3, 3)."""
DirectionFunction = Callable[[int, F64], F64]
"""number of the sensor, time_s (n,) -> direction of the target, GCRS axes, (n, 3)."""


class Framing(Protocol):
    """A camera, as far as the constraint `in_fov` needs it."""

    def frame_margin_deg(self, direction: F64) -> F64:
        """Angle of directions in camera axes, (n, 3), to the nearest edge of the frame [deg], positive inside."""
        ...


@dataclass(frozen=True, eq=False)
class CameraGeometry:
    """Camera and its axes, for the constraint `in_fov`."""

    camera: Framing
    axes: AxesFunction
    direction: DirectionFunction | None = None
    """Apparent direction of the target; the geometric one when None, up to 30 arcsec away."""


@dataclass(frozen=True, eq=False)
class AccessGeometry:
    """Positions of sensors, target and Sun at some times: the input of a constraint.

    Arrays broadcast together to `shape`, (n_row, n_time), vectors with a further axis of 3; positions are geocentric,
    GCRS axes. A row belongs to the sensor of the number `sensor`; which rows and times there are differs from call to
    call.
    """

    sensor_m: F64
    """Positions of the sensors [m], (n_row, n_time, 3)."""
    target_m: F64
    """Positions of the target [m], broadcastable."""
    sun_m: F64
    """Positions of the Sun [m], broadcastable."""
    pole_icrs: F64
    """Unit vector of the ellipsoid's axis, the pole of date, (3,)."""
    time_s: F64
    """Times [s after the scene's epoch], broadcastable to (n_row, n_time)."""
    sensor: I64
    """Numbers of the sensors, (n_row, 1): indices into the sensors asked for."""
    fov: CameraGeometry | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape that a margin must broadcast to."""
        return np.broadcast_shapes(self.sensor_m.shape, self.target_m.shape)[:-1]

    @cached_property
    def sight_m(self) -> F64:
        """Vectors from sensor to target [m]."""
        return np.asarray(self.target_m - self.sensor_m)

    @cached_property
    def range_m(self) -> F64:
        """Distance from sensor to target [m]."""
        return np.asarray(np.sqrt(np.einsum("...i,...i->...", self.sight_m, self.sight_m)))

    @cached_property
    def elevation_deg(self) -> F64:
        """Elevation of the line of sight [deg]; 0 where the target is in the sensor."""
        length = np.maximum(self.range_m, 1e-9) * np.linalg.norm(self.sensor_m, axis=-1)
        sine = np.einsum("...i,...i->...", self.sight_m, self.sensor_m) / length
        return np.asarray(np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0))))

    @cached_property
    def solar_angle_deg(self) -> F64:
        """Angle at the sensor between target and Sun [deg]."""
        to_sun = self.sun_m - self.sensor_m
        along = np.einsum("...i,...i->...", self.sight_m, to_sun)
        across = np.linalg.norm(np.cross(self.sight_m, to_sun), axis=-1)  # atan2: exact near 0 and 180 degrees as well
        return np.asarray(np.degrees(np.arctan2(across, along)))

    @cached_property
    def grazing_altitude_m(self) -> F64:
        """Lowest WGS84 altitude between sensor and target [m]."""
        return grazing_altitude_m(self.sensor_m, self.target_m, self.pole_icrs)

    @cached_property
    def background_altitude_m(self) -> F64:
        """Lowest WGS84 altitude from the sensor through the target and beyond [m]."""
        return grazing_altitude_m(self.sensor_m, self.target_m, self.pole_icrs, beyond=True)

    @cached_property
    def target_sunlit_depth(self) -> F64:
        """Fraction of the Sun's disc that the target sees; runs on above 1 in full light and below 0 in the umbra."""
        return sunlit_depth(self.target_m, self.sun_m, self.pole_icrs)

    @cached_property
    def frame_margin_deg(self) -> F64:
        """Angle from the nearest edge of the camera's frame [deg], positive inside.

        Raises:
            InputError: Nothing is known about the camera.
        """
        if self.fov is None:
            raise InputError("needs to know how the camera stands, got no axes", "in_fov")
        shape = self.shape
        time_s = np.broadcast_to(self.time_s, shape)
        sensor = np.broadcast_to(self.sensor, shape).ravel()
        line_m = np.broadcast_to(self.sight_m, (*shape, 3)).reshape(-1, 3)
        times, margin = time_s.ravel(), np.empty(time_s.size)
        order = np.argsort(sensor, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(sensor[order])) + 1) if len(order) else []:
            number, at = int(sensor[rows[0]]), times[rows]
            axes = self.fov.axes(number, at)
            direction = line_m[rows] if self.fov.direction is None else self.fov.direction(number, at)
            margin[rows] = self.fov.camera.frame_margin_deg(np.einsum("nij,nj->ni", axes, direction))
        return margin.reshape(shape)


MarginFunction = Callable[[AccessGeometry], F64]


class Constraint(NamedTuple):
    """An active constraint."""

    name: str
    margin: MarginFunction
    """Signed, >= 0 where the constraint holds."""


# By field: the margin's name, and the margin for a limit; the costly ones last.
_BUILT_IN: dict[str, tuple[str, Callable[..., F64]]] = {
    "max_range_km": ("range_km", lambda view, limit: limit - 1e-3 * view.range_m),
    "min_range_km": ("min_range_km", lambda view, limit: 1e-3 * view.range_m - limit),
    "min_elevation_deg": ("elevation_deg", lambda view, limit: view.elevation_deg - limit),
    "max_elevation_deg": ("max_elevation_deg", lambda view, limit: limit - view.elevation_deg),
    "min_solar_exclusion_deg": ("solar_exclusion_deg", lambda view, limit: view.solar_angle_deg - limit),
    "min_grazing_altitude_km": ("grazing_altitude_km", lambda view, limit: 1e-3 * view.grazing_altitude_m - limit),
    "min_background_altitude_km": (
        "background_altitude_km",
        lambda view, limit: 1e-3 * view.background_altitude_m - limit,
    ),
    "min_target_sunlit": ("target_sunlit", lambda view, limit: view.target_sunlit_depth - limit),
    "in_fov": ("fov_deg", lambda view, limit: view.frame_margin_deg),
}

MARGIN_NAMES = ("earth_km", *(name for name, _ in _BUILT_IN.values()))
"""Names of the margins of warpsim's own constraints."""


def active_constraints(
    constraints: AccessConstraints, custom: Mapping[str, MarginFunction] | None = None
) -> list[Constraint]:
    """Return the active constraints, cheap ones first, custom ones last; the Earth's, "earth_km", is not in it."""
    active = []
    for field, (name, margin) in _BUILT_IN.items():
        limit = getattr(constraints, field)
        if limit is not None and limit is not False:
            active.append(Constraint(name, partial(margin, limit=float(limit))))
    if custom is not None and not isinstance(custom, Mapping):
        raise InputError(f"must be a dict of names and functions, got {type(custom).__name__}", "custom")
    for name, function in (custom or {}).items():
        if not isinstance(name, str) or not name or name in MARGIN_NAMES:
            raise InputError("must have names other than warpsim's own constraints", "custom", name)
        if not callable(function):
            raise InputError("must be a function of an AccessGeometry", f"custom[{name!r}]", function)
        active.append(Constraint(name, _checked(name, function)))
    return active


def _checked(name: str, function: MarginFunction) -> MarginFunction:

    def margin(view: AccessGeometry) -> F64:
        got = np.asarray(function(view))
        if got.dtype == np.bool_:  # true where the constraint holds
            got = np.where(got, 1.0, -1.0)
        if got.dtype.kind not in "iuf":
            raise InputError("must give numbers or booleans", f"custom[{name!r}]", str(got.dtype), "s")
        try:
            whole = np.broadcast_to(got.astype(np.float64), view.shape)
        except ValueError:
            raise InputError(f"must give an array of shape {view.shape}", f"custom[{name!r}]", got.shape) from None
        bad = np.isnan(whole)
        if bad.any():
            when_s = np.broadcast_to(view.time_s, view.shape)[bad][0]
            raise InputError(f"must give a number everywhere, got NaN at {when_s:g} s", f"custom[{name!r}]")
        return np.clip(whole, -1e300, 1e300)  # infinite margins have no differences

    return margin


def earth_margin_km(view: AccessGeometry) -> F64:
    """Cheap margin of occultation by the Earth: its sign is that of the lowest altitude between sensor and target."""
    return 1e-3 * earth_clearance_m(view.sensor_m, view.target_m, view.pole_icrs)
