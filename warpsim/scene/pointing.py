"""Where cameras look: parts of a scene that say it, by their kind, and the jitter about it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Discriminator, Tag, model_validator

from warpsim.config.fields import FileName, NonNegative, Number, Positive, as_tuple, closed_interval
from warpsim.config.model import config_model
from warpsim.errors import InputError

Up = Literal["zenith", "north", "orbit_normal"]
Declination = Annotated[Number, closed_interval(-90, 90)]
"""An angle from a plane [deg]: of the equator, or horizontal."""


def _pair(value: Any) -> Any:
    """Arrays and Quantity arrays become tuples, so that their entries are checked one by one."""
    return tuple(value) if isinstance(value, np.ndarray) and value.ndim == 1 else value


Direction = Annotated[tuple[Number, Declination], BeforeValidator(_pair)]
Place = Annotated[tuple[Number, Number], BeforeValidator(_pair)]


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
class TrackPointing:
    """Cameras that follow targets.

    Args:
        track: "main" follows the main target, "group" the mean apparent direction of all, a target's name that target.
        offset_px: Where it appears, from the image's centre: columns to the right, rows downwards [px].
        up: Which way is up in the image: "zenith", "north" (ICRS) or "orbit_normal".
        roll_deg: Turn of the camera about its line of sight after that, right-handed: up moves to the right [deg].
        jitter: Random motion about these axes; none when left out.
    """

    track: str = "main"
    up: Up = "zenith"
    offset_px: Place = (0.0, 0.0)
    roll_deg: Number = 0.0
    jitter: Jitter | None = None
    kind: Literal["track"] = "track"


@config_model
class FixedPointing:
    """Cameras that look in one direction; give one of the two.

    Args:
        ra_dec_deg: Apparent right ascension and declination of the boresight, ICRS axes [deg].
        azimuth_elevation_deg: Direction in the satellite's local frame: azimuth from its motion, 90 to the right of it
            (clockwise seen from above); elevation above the plane perpendicular to its geocentric position [deg].
        up: Which way is up in the image: "zenith", "north" (ICRS) or "orbit_normal".
        roll_deg: Turn of the camera about its boresight after that, right-handed: up moves to the right [deg].
        jitter: Random motion about these axes; none when left out.
    """

    ra_dec_deg: Direction | None = None
    azimuth_elevation_deg: Direction | None = None
    up: Up = "zenith"
    roll_deg: Number = 0.0
    jitter: Jitter | None = None
    kind: Literal["fixed"] = "fixed"

    @model_validator(mode="after")
    def _one_direction(self) -> FixedPointing:
        if (self.ra_dec_deg is None) == (self.azimuth_elevation_deg is None):
            raise InputError("exactly one must be given", "ra_dec_deg, azimuth_elevation_deg")
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
        sensor: The sensor it is for; when left out, every sensor that has no rows of its own.
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
class TablePointing:
    """Cameras that step or scan over the sky; give rows or a file.

    Args:
        mode: "stare" holds each row until the next, "scan" moves from row to row along great circles, at a constant
            rate, and rolls the short way.
        rows: The rows.
        file: A CSV or ECSV file whose columns have the names of PointingRow's fields.
        up: Which way is up in the image: "zenith", "north" (ICRS) or "orbit_normal".
        roll_deg: Turn of the camera about its boresight after that, right-handed: up moves to the right [deg].
        jitter: Random motion about these axes; none when left out.
    """

    mode: Literal["stare", "scan"]
    rows: Annotated[tuple[PointingRow, ...], BeforeValidator(as_tuple)] | None = None
    file: FileName | None = None
    up: Up = "zenith"
    roll_deg: Number = 0.0
    jitter: Jitter | None = None
    kind: Literal["table"] = "table"

    @model_validator(mode="after")
    def _one_source(self) -> TablePointing:
        if (self.rows is None) == (self.file is None):
            raise InputError("exactly one must be given", "rows, file")
        if self.rows is not None and not self.rows:
            raise InputError("must hold at least one", "rows")
        return self


def _kind_of(value: Any) -> Any:
    """The kind that a table of a scene file states; "track" where it states none."""
    return value.get("kind", "track") if isinstance(value, dict) else getattr(value, "kind", "track")


Pointing = Annotated[
    Annotated[TrackPointing, Tag("track")]
    | Annotated[FixedPointing, Tag("fixed")]
    | Annotated[TablePointing, Tag("table")],
    Discriminator(_kind_of),
]
