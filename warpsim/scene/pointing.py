"""Config models of pointing by kind, and of pointing errors."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, Tag, model_validator

from warpsim.arguments import some_names
from warpsim.config.fields import (
    FileName,
    NonNegative,
    Number,
    Positive,
    Vector,
    as_tuple,
    closed_interval,
    rule_error,
)
from warpsim.config.model import config_model, exactly_one, one_of
from warpsim.errors import InputError
from warpsim.quaternion import rotated
from warpsim.scene.groups import kind_or

Up = Literal["zenith", "north", "orbit_normal"]
Declination = Annotated[Number, closed_interval(-90, 90)]
"""An angle from a plane [deg]: of the equator, or horizontal."""


def _pair(value: Any) -> Any:
    """Arrays and Quantity arrays become tuples, so that their entries are checked one by one."""
    return tuple(value) if isinstance(value, np.ndarray) and value.ndim == 1 else value


Direction = Annotated[tuple[Number, Declination], BeforeValidator(_pair)]
Pixels = Annotated[tuple[Number, Number], BeforeValidator(_pair)]

TRACKED, ANY = "tracked", "any"
"""Words for a scene's access_target: what a sensor tracks, any target at all."""

ALL = "all"
"""Word for every satellite, or every sensor."""


SATELLITE = "{satellite}"
"""Stands for the name of a satellite in that of its attitude file."""


def _patterns(value: Any) -> Any:
    names = as_tuple(value)
    if not names or not all(isinstance(name, str) and name for name in names):
        raise rule_error("must be 'all', or names of satellites, with * and ? as wild cards")
    return names


Satellites = Annotated[tuple[str, ...], BeforeValidator(_patterns)]
"""Satellites: "all", or names, in which * and ? are wild cards."""


def satellites_of(patterns: Sequence[str], names: Sequence[str]) -> list[int]:
    """Return the positions of the satellites that patterns choose, in the order of the names."""
    for number, pattern in enumerate(patterns):
        if pattern != ALL and not any(fnmatchcase(name, pattern) for name in names):
            field = "on" if len(patterns) == 1 else f"on[{number}]"
            raise InputError(f"must be satellites of the constellation ({some_names(names)})", field, pattern)
    chosen = [ALL in patterns or any(fnmatchcase(name, pattern) for pattern in patterns) for name in names]
    return [index for index, is_chosen in enumerate(chosen) if is_chosen]


@config_model
class Jitter:
    """Random motion of the camera about its x and y axes: independent, of zero mean, smooth, seeded by the scene.

    Its autocorrelation is (1 + 2 u) exp(-2 u), u = lag / correlation_s.

    Args:
        rms_urad: Standard deviation of each of the two angles [urad].
        correlation_s: Correlation time: the integral of the autocorrelation over positive lags [s].
    """

    rms_urad: Annotated[NonNegative, closed_interval(0, 1e5)]
    correlation_s: Annotated[Positive, closed_interval(1e-6, 1e6)]


@config_model
class Bias:
    """Constant pointing error about the camera's x and y axes; give one of the two.

    Args:
        rms_urad: Standard deviation of each of the two angles, drawn for each sensor [urad].
        urad: The two angles themselves, the same for all sensors [urad].
    """

    rms_urad: Annotated[NonNegative, closed_interval(0, 1e5)] | None = None
    urad: Pixels | None = None

    _one = one_of("rms_urad", "urad")


@config_model
class Drift:
    """Pointing error that grows linearly about the camera's x and y axes, as a gyroscope's drift.

    Args:
        rms_urad_s: Standard deviation of each of the two rates, drawn for each sensor and each period [urad/s].
        urad_s: The two rates themselves, the same for all sensors and periods [urad/s].
        reset_s: Period after which the error is taken out and begins anew, as by a star tracker [s]; it grows from the
            scene's epoch on when left out. Periods count from the epoch.
    """

    rms_urad_s: Annotated[NonNegative, closed_interval(0, 1e5)] | None = None
    urad_s: Pixels | None = None
    reset_s: Annotated[Positive, closed_interval(1e-3, 1e9)] | None = None

    _one = one_of("rms_urad_s", "urad_s")


@config_model
class Slew:
    """Slew from one direction to the next: constant acceleration, constant rate, constant deceleration.

    Args:
        max_rate_deg_s: Greatest rate [deg/s].
        max_acceleration_deg_s2: Greatest acceleration [deg/s2].
        settle_s: Time after the turn until the camera is settled [s].
    """

    max_rate_deg_s: Positive
    max_acceleration_deg_s2: Positive
    settle_s: NonNegative = 0.0


@config_model
class _AnyPointing:
    """Fields of every kind of pointing.

    Args:
        on: Satellites that point so: "all", names, or patterns with * and ?. Of several entries, a satellite takes the
            first that chooses it.
        up: Which way is up in the image: "zenith", "north" (ICRS) or "orbit_normal".
        roll_deg: Turn of the camera about its line of sight after that, right-handed: up moves to the right [deg].
        bias: Constant error about these axes; none when left out.
        drift: Error that grows; none when left out.
        jitter: Random motion; none when left out.
    """

    on: Satellites = Field(default=(ALL,), kw_only=True)
    up: Up = Field(default="zenith", kw_only=True)
    roll_deg: Number = Field(default=0.0, kw_only=True)
    bias: Bias | None = Field(default=None, kw_only=True)
    drift: Drift | None = Field(default=None, kw_only=True)
    jitter: Jitter | None = Field(default=None, kw_only=True)


@config_model
class TrackPointing(_AnyPointing):
    """Cameras that track targets; further fields are those of every kind of pointing.

    Args:
        track: "main" tracks the first group's main target, "group" the mean apparent direction of all of that group, a
            group's name that of its targets, a target's name that target.
        offset_px: Where it appears, from the image's centre: columns to the right, rows downwards [px].
    """

    track: str = "main"
    offset_px: Pixels = (0.0, 0.0)
    kind: Literal["track"] = Field(default="track", kw_only=True)


@config_model
class FixedPointing(_AnyPointing):
    """Cameras that look in one direction; give one of the two. Further fields are those of every kind of pointing.

    Args:
        ra_dec_deg: Apparent right ascension and declination of the boresight, ICRS axes [deg].
        azimuth_elevation_deg: Direction in the satellite's local frame: azimuth from its motion, 90 to the right of it
            (clockwise seen from above); elevation above the plane perpendicular to its geocentric position [deg].
    """

    ra_dec_deg: Direction | None = None
    azimuth_elevation_deg: Direction | None = None
    kind: Literal["fixed"] = Field(default="fixed", kw_only=True)

    _one_direction = one_of("ra_dec_deg", "azimuth_elevation_deg")


@config_model
class PointingStep:
    """A step of a schedule: a target to track, or a direction; give one of the three.

    Args:
        start_s: From when on, after the scene's epoch [s]; until the next step.
        track: As in TrackPointing.
        ra_dec_deg: As in FixedPointing.
        azimuth_elevation_deg: As in FixedPointing.
        offset_px: Position of the tracked direction from the image's centre [px].
        roll_deg: Roll, added to that of the schedule [deg].
    """

    start_s: Number
    track: str | None = None
    ra_dec_deg: Direction | None = None
    azimuth_elevation_deg: Direction | None = None
    offset_px: Pixels = (0.0, 0.0)
    roll_deg: Number = 0.0

    @model_validator(mode="after")
    def _one(self) -> PointingStep:
        exactly_one(self, "track", "ra_dec_deg", "azimuth_elevation_deg")
        if self.track is None and self.offset_px != (0.0, 0.0):
            raise InputError("belongs to track", "offset_px", self.offset_px)
        return self


@config_model
class SchedulePointing(_AnyPointing):
    """Cameras that track one target or direction after another; further fields are those of every kind of pointing.

    Args:
        steps: What they look at, in the order of time; the first at the first frame or before.
        slew: How they turn from step to step; at once when left out. A turn begins when its step does.
    """

    steps: Annotated[tuple[PointingStep, ...], BeforeValidator(as_tuple)]
    slew: Slew | None = None
    kind: Literal["schedule"] = Field(default="schedule", kw_only=True)

    @model_validator(mode="after")
    def _ordered(self) -> SchedulePointing:
        if not self.steps:
            raise InputError("must hold at least one", "steps")
        for number, (before, step) in enumerate(itertools.pairwise(self.steps), start=1):
            if step.start_s <= before.start_s:
                rule = f"must be above that of the step before ({before.start_s:g})"
                raise InputError(rule, f"steps[{number}].start_s", step.start_s, "g")
            if self.slew is not None and step.start_s < 0.0:
                raise InputError("must be >= 0 where cameras slew to it", f"steps[{number}].start_s", step.start_s, "g")
        return self


@config_model
class PointingRow:
    """A row of a table of directions: ra_deg and dec_deg, or azimuth_deg and elevation_deg, as in FixedPointing.

    Args:
        time_s: When the camera looks there, after the scene's epoch [s].
        ra_deg: Right ascension [deg].
        dec_deg: Declination [deg].
        azimuth_deg: Azimuth in the satellite's local frame [deg].
        elevation_deg: Elevation there [deg].
        roll_deg: Roll, added to that of the table [deg].
        sensor: The sensor or satellite it is for; when left out, every one without individual rows.
    """

    time_s: Number
    ra_deg: Number | None = None
    dec_deg: Declination | None = None
    azimuth_deg: Number | None = None
    elevation_deg: Declination | None = None
    roll_deg: Number = 0.0
    sensor: str | None = None

    @model_validator(mode="after")
    def _one_direction(self) -> PointingRow:
        given = [value is not None for value in (self.ra_deg, self.dec_deg, self.azimuth_deg, self.elevation_deg)]
        if given not in ([True, True, False, False], [False, False, True, True]):
            raise InputError("must have ra_deg and dec_deg, or azimuth_deg and elevation_deg")
        return self


@config_model
class TablePointing(_AnyPointing):
    """Cameras that step or scan over the sky; give rows or a file. Further fields are those of every kind of pointing.

    Args:
        mode: "stare" holds each row until the next, "scan" moves from row to row along great circles, at a constant
            rate, and rolls the short way.
        rows: The rows.
        file: A CSV or ECSV file whose columns have the names of PointingRow's fields.
        slew: How a stare turns from row to row, at once when left out; and what rate a scan may have at most.
    """

    mode: Literal["stare", "scan"]
    rows: Annotated[tuple[PointingRow, ...], BeforeValidator(as_tuple)] | None = None
    file: FileName | None = None
    slew: Slew | None = None
    kind: Literal["table"] = Field(default="table", kw_only=True)

    @model_validator(mode="after")
    def _one_source(self) -> TablePointing:
        exactly_one(self, "rows", "file")
        if self.rows is not None and not self.rows:
            raise InputError("must hold at least one", "rows")
        return self


@config_model
class BodyPointing(_AnyPointing):
    """Cameras fixed in a body whose attitude a file gives; further fields are those of every kind of pointing.

    Args:
        file: An attitude file (AEM, STK .a, CSV, ECSV); `{satellite}` in its name stands for that of the satellite.
        object: Which object of the file, where it holds several; `{satellite}` as well.
        boresight: Where the camera looks, in the body's axes.
        image_up: What is up in its image, in the body's axes; any direction off the boresight.
        mounting: Instead of these two, the quaternion (x, y, z, w) that turns components in camera axes (x to the
            right, y down, z the boresight) into those in the body's.
    """

    file: FileName
    object: str | None = None
    boresight: Vector | None = None
    image_up: Vector | None = None
    mounting: tuple[Number, Number, Number, Number] | None = None
    kind: Literal["body"] = Field(default="body", kw_only=True)

    @model_validator(mode="after")
    def _mounted(self) -> BodyPointing:
        if self.up != "zenith":
            raise InputError("must be left out: image_up says it in the body's axes", "up", self.up)
        if (self.boresight is None) != (self.image_up is None):
            raise InputError("both must be given, or none", "boresight, image_up")
        if self.mounting is not None and self.boresight is not None:
            raise InputError("must be left out where mounting is given", "boresight, image_up")
        _ = self.axes_in_body
        return self

    @property
    def axes_in_body(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Camera axes x, y, z as rows, in the body's axes, shape (3, 3).

        Raises:
            InputError: The quaternion has not norm 1, or a vector has no direction of its own.
        """
        if self.mounting is not None:
            norm = float(np.linalg.norm(self.mounting))
            if not abs(norm - 1.0) <= 1e-3:
                raise InputError("must have norm 1", "mounting", norm, ".6g")
            return rotated(np.array(self.mounting) / norm, np.eye(3))
        if self.boresight is None or self.image_up is None:
            return np.eye(3)
        z, up = np.array(self.boresight), np.array(self.image_up)
        if not np.linalg.norm(z) > 0.0:
            raise InputError("must not be 0", "boresight", self.boresight)
        z = z / np.linalg.norm(z)
        y = z * (z @ up) - up
        if not np.linalg.norm(y) > 1e-6 * np.linalg.norm(up):
            raise InputError("must not be along the boresight, or 0", "image_up", self.image_up)
        y = y / np.linalg.norm(y)
        return np.stack([np.cross(y, z), y, z])


Pointing = Annotated[
    Annotated[TrackPointing, Tag("track")]
    | Annotated[FixedPointing, Tag("fixed")]
    | Annotated[SchedulePointing, Tag("schedule")]
    | Annotated[TablePointing, Tag("table")]
    | Annotated[BodyPointing, Tag("body")],
    kind_or("track"),
]
"""Any kind of pointing; a table of a scene file that names no kind tracks."""


def _one_or_some(value: Any) -> Any:
    return tuple(value) if isinstance(value, list | tuple) else (value,)


Pointings = Annotated[tuple[Pointing, ...], BeforeValidator(_one_or_some)]
"""How the cameras of a kind of sensor point: one kind of pointing, or several, each for some satellites."""
