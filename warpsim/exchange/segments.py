"""Segments of orbits and of attitudes from files, checked, in SI units.

A segment is one uninterrupted run of states in one frame; an object may have several. Names of frames are warpsim's
(`FRAMES`); here is also what other programs call them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.arrays import F64
from warpsim.config.fields import MOST_LETTERS
from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.errors import InputError
from warpsim.exchange.instants import TIME_SYSTEMS, FileInstants, instants_of_time, later, parse_dates

if TYPE_CHECKING:
    from astropy.time import Time


Frame = Literal["GCRF", "EME2000", "ITRF", "TEME", "TOD", "MOD"]
"""Earth-centred axes: those of GCRS (and ICRS), the mean equator of J2000, the rotating Earth, SGP4's, and the true
and mean equator of date."""

FRAMES: tuple[str, ...] = get_args(Frame)

_CCSDS: dict[Frame, str] = {
    "GCRF": r"GCR[FS]|ICRS|ICRF([-_ ]?[123])?",
    "EME2000": r"EME2000|J2000",
    "ITRF": r"ITR[FS]([-_ ]?\d{2,4})?",
    "TEME": r"TEME(OFDATE)?",
    "TOD": r"TOD(_EARTH)?",
    "MOD": r"MOD(_EARTH)?",
}
CCSDS_NAME: dict[Frame, str] = {frame: "ITRF2000" if frame == "ITRF" else frame for frame in get_args(Frame)}
"""What writers of CCSDS files call the frames; realisations of ITRF agree within centimetres."""

STK_NAME: dict[Frame, str] = {
    "GCRF": "ICRF",
    "EME2000": "J2000",
    "ITRF": "Fixed",
    "TEME": "TEMEOfDate",
    "TOD": "TrueOfDate",
    "MOD": "MeanOfDate",
}

Interpolation = Literal["linear", "lagrange", "hermite"]

DEFAULT_DEGREE = 7
"""Degree of the polynomials where a file names none: Hermite's with velocities, Lagrange's without."""

LARGEST_DEGREE = 27
"""Highest degree of an interpolating polynomial."""

_LARGEST_M = 1e12
"""Farther positions are taken for mistakes of unit."""

NORM_SLACK = 1e-3
"""How far the norm of a quaternion may be from 1."""


@dataclass(frozen=True, eq=False)
class EphemerisSegment:
    """One run of states of one object.

    Raises:
        InputError: Shapes differ, a value is not finite, times do not ascend, or frame or time system is unknown.
    """

    object_name: str
    object_id: str
    """International designator or another number of the object; "" where the file has none."""

    frame: Frame
    """Axes of position and velocity."""

    instants: FileInstants
    position_m: F64
    """Geocentric positions [m], shape (n, 3)."""

    velocity_m_s: F64 | None = None
    """Velocities in the frame [m/s], shape (n, 3); relative to the turning axes in ITRF."""

    interpolation: Interpolation | None = None
    """Method that the file asks for."""

    degree: int | None = None
    """Degree of the polynomials that the file asks for."""

    useable: FileInstants | None = None
    """First and last useable instant; None: all of it."""

    sampled: bool = False
    """Whether the states are samples of a path known between them, as dense as it needs."""

    time_system: str = "UTC"
    """Of the file's dates; writers use it again."""

    file: str = ""
    line: int = 0
    """Where the segment begins in the file, counted from 1; 0 where it has no lines."""

    lines: NDArray[np.int64] | None = None
    """Line of each state, for messages."""

    def __post_init__(self) -> None:
        _check_common(self, "position_m", self.position_m, 3)
        if self.velocity_m_s is not None:
            _check_array("velocity_m_s", self.velocity_m_s, (len(self.instants), 3), self)
        if self.interpolation == "hermite" and self.velocity_m_s is None:
            raise _located(InputError("must not be Hermite for states without velocities", "interpolation"), self)
        if self.degree is not None and not 1 <= self.degree <= LARGEST_DEGREE:
            raise _located(InputError(f"must be 1 to {LARGEST_DEGREE}", "interpolation degree", self.degree), self)
        _check_size("position", self.position_m, _LARGEST_M, "m", self)
        if self.velocity_m_s is not None:
            _check_size("velocity", self.velocity_m_s, SPEED_OF_LIGHT_M_S, "m/s", self)

    @classmethod
    def of_states(
        cls,
        object_name: str,
        epoch: Time | str,
        time_s: ArrayLike,
        position_m: ArrayLike,
        velocity_m_s: ArrayLike | None = None,
        **fields: Any,
    ) -> EphemerisSegment:
        """Segment of states at SI seconds since an epoch (a Time, or an ISO 8601 UTC text).

        Args:
            object_name: Name of the object.
            epoch: What the times count from.
            time_s: Times [s since epoch], shape (n,).
            position_m: Positions [m], shape (n, 3).
            velocity_m_s: Velocities [m/s], shape (n, 3).
            fields: Others by name: frame (GCRF if left out), object_id, time_system of the dates when written, and
                interpolation and degree to ask readers for.
        """
        try:
            start = parse_dates([epoch], "UTC") if isinstance(epoch, str) else instants_of_time(epoch)
        except InputError as error:
            raise error.at_row("epoch") from None
        return cls(
            object_name=object_name,
            instants=later(start, np.atleast_1d(np.asarray(time_s, np.float64))),
            position_m=np.asarray(position_m, np.float64),
            velocity_m_s=None if velocity_m_s is None else np.asarray(velocity_m_s, np.float64),
            **{"frame": "GCRF", "object_id": "", **fields},
        )


@dataclass(frozen=True, eq=False)
class AttitudeSegment:
    """One run of attitudes of one object.

    Raises:
        InputError: Shapes differ, a value is not finite, a norm is not 1, times do not ascend, or the frame is unknown.
    """

    object_name: str
    object_id: str
    frame: Frame
    """The reference axes."""

    body_frame: str
    """What the file calls the body's axes."""

    instants: FileInstants
    quaternion: F64
    """Unit quaternions (x, y, z, scalar), Hamilton's, shape (n, 4): they turn a vector's components in body axes into
    those in the reference axes, as scipy's Rotation.from_quat(q).apply does."""

    interpolation: Interpolation | None = None
    degree: int | None = None
    rate_rad_s: F64 | None = None
    """Angular velocities relative to the reference axes, in the body's axes [rad/s], shape (n, 3)."""

    useable: FileInstants | None = None
    time_system: str = "UTC"
    file: str = ""
    line: int = 0
    lines: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        _check_common(self, "quaternion", self.quaternion, 4)
        if self.rate_rad_s is not None:
            _check_array("rate_rad_s", self.rate_rad_s, (len(self.instants), 3), self)
        with np.errstate(over="ignore", under="ignore"):  # infinity and 0 are no norm of 1 either
            norm = np.linalg.norm(self.quaternion, axis=1)
        bad = np.abs(norm - 1.0) > NORM_SLACK
        if bad.any():
            row = int(np.argmax(bad))
            raise _located(InputError("must have norm 1", "quaternion", norm[row], ".6g"), self, row)
        object.__setattr__(self, "quaternion", self.quaternion / norm[:, None])


Segment = EphemerisSegment | AttitudeSegment

_SAME_TIME_S = 0.5e-9
"""Times this close are one: files are kept to 1e-9 s."""


def _located(error: InputError, segment: Segment, row: int | None = None) -> InputError:
    """Return the error with the file and line of a segment, or of one of its rows."""
    line = segment.line if row is None or segment.lines is None else int(segment.lines[row])
    unknown = f"row {row}" if row is not None and not segment.file else ""
    return error.of(f"line {line}" if line else unknown).of(segment.file)


def _check_common(segment: Segment, name: str, value: F64, n_column: int) -> None:
    """Check what both kinds of segments have, and the shape of their values."""
    for what, got, known in (("frame", segment.frame, FRAMES), ("time_system", segment.time_system, TIME_SYSTEMS)):
        if got not in known:
            raise _located(InputError(f"must be one of {', '.join(known)}", what, got), segment)
    instants = segment.instants
    _check_array(name, value, (len(instants), n_column), segment)
    finite = np.isfinite(instants.second) & np.isfinite(instants.day)
    if not finite.all():
        raise _located(InputError("must be finite", "time"), segment, int(np.argmin(finite)))
    step_s = instants.steps_s()
    bad = ~(step_s > _SAME_TIME_S)
    if bad.any():
        row = int(np.argmax(bad))
        got = "the same" if abs(step_s[row]) <= _SAME_TIME_S else f"{-step_s[row]:g} s earlier"
        raise _located(InputError("must come after the time before it", "time", got, "s"), segment, row + 1)
    if segment.useable is not None:
        first_s, last_s = segment.useable.since_instant(instants[0])
        if not (len(segment.useable) == 2 and first_s <= last_s):
            raise _located(InputError("must not end before it begins", "useable span"), segment)
        if first_s < -1e-6 or last_s > instants[-1:].since_instant(instants[0])[0] + 1e-6:
            raise _located(InputError("must lie within the times of the data", "useable span"), segment)


def _check_array(name: str, value: F64, shape: tuple[int, int], segment: Segment) -> None:
    if shape[0] == 0:
        raise _located(InputError("must hold at least one row, got none", name), segment)
    if np.shape(value) != shape:
        raise _located(InputError(f"must have shape {shape}", name, np.shape(value)), segment)
    bad = ~np.isfinite(value).all(axis=1)
    if bad.any():
        row = int(np.argmax(bad))
        raise _located(InputError("must be finite", name, value[row].tolist()), segment, row)


def _check_size(name: str, value: F64, largest: float, unit: str, segment: Segment) -> None:
    size = np.abs(value).max(axis=1)
    row = int(np.argmax(size))
    if size[row] > largest:
        raise _located(InputError(f"must be below {largest:g} {unit}", name, size[row], "g"), segment, row)


def ccsds_frame(name: str) -> Frame | None:
    """The frame of a CCSDS name, also in a table's metadata; None where it is none that is read."""
    return next((frame for frame, pattern in _CCSDS.items() if re.fullmatch(pattern, name.strip().upper())), None)


def known_ccsds_frame(name: str) -> Frame:
    """The frame of a CCSDS name; one that is not read is an error."""
    frame = ccsds_frame(name)
    if frame is None:
        raise InputError(f"must be one of {', '.join(FRAMES)} (or ICRF, J2000, ITRF-97, ...)", value=name)
    return frame


def plain_name(name: str, otherwise: str = "object") -> str:
    """Letters, digits and `_ . -`: each run of others becomes one `_`, none at the ends. `otherwise` if none is left.

    `ISS (ZARYA)` becomes `ISS_ZARYA`. Of very long names the first MOST_LETTERS are taken.
    """
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", name).strip("_.-")[:MOST_LETTERS] or otherwise
