"""Attitude from a table of quaternions: inline, or from a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from warpsim.arrays import F64
from warpsim.config.fields import FileName, Number, rows_in
from warpsim.config.model import config_model
from warpsim.errors import InputError
from warpsim.quaternion import in_one_hemisphere, rotation_between_rad, slerp, unit
from warpsim.target.attitude_rates import dense_rows, rates_fit, row_errors_rad
from warpsim.target.from_file import FromFile
from warpsim.target.timed_rows import DATE_ROUNDING_S, TimedRows

if TYPE_CHECKING:
    from warpsim.instant import Epoch


NORM_TOLERANCE = 1e-3
"""How far from 1 the norm of a given quaternion may be: three printed digits."""
LARGEST_STEP_DEG = 170.0
"""Between neighbouring rows; nearer to half a turn, the way round is not known."""
MOST_BREAKS = 2000
"""Rows that are looked at one by one where access is sought; of more, those that turn the body half a radian."""
SAME_ROTATION_RAD = 1e-6
"""How far the last row of a segment and the first of the next may differ."""


Times = Annotated[tuple[Number, ...], rows_in("s")]
Quaternions = Annotated[tuple[tuple[Number, Number, Number, Number], ...], rows_in("")]


@dataclass(frozen=True, eq=False)
class AttitudeRows(TimedRows):
    """A checked table: unit quaternions body -> GCRS, scalar last, all in one hemisphere with their neighbours."""

    time_s: F64
    """After the epoch, ascending [s], shape (n,)."""
    quaternion: F64
    """Shape (n, 4)."""
    source: str = ""
    """File and object that messages name; empty for inline rows."""
    error_rad: F64 | None = None
    """About how far the rows as given are off half-way between them [rad], (n_given - 1,); see `worst_error`."""
    given_s: F64 | None = None
    """Times of the rows as given [s], (n_given,): there are more in `time_s` where they have rates."""
    epoch: Any = None
    note: str = ""
    """How rates are used, or why not; empty where there are none."""

    _of = "attitude table"

    def worst_error(self, first_s: float, last_s: float) -> tuple[float, float]:
        """Return the largest estimated error within a span [rad], and the time that it is near [s]."""
        if self.error_rad is None or self.given_s is None or not len(self.error_rad):
            return 0.0, first_s
        within = (self.given_s[1:] > first_s) & (self.given_s[:-1] < last_s)
        error_rad = np.where(within, self.error_rad, 0.0)
        row = int(np.argmax(error_rad))
        return float(error_rad[row]), float(0.5 * (self.given_s[row] + self.given_s[row + 1]))

    def breaks_s(self) -> list[float]:
        """Return times at which the body turns at another rate, and times at most half a radian apart."""
        turned = np.concatenate([[0.0], np.cumsum(rotation_between_rad(self.quaternion[:-1], self.quaternion[1:]))])
        n_part = max(1, int(np.ceil(turned[-1] / 0.5)))
        given = self.time_s if self.given_s is None else self.given_s
        apart = np.interp(np.linspace(0.0, turned[-1], n_part + 1), turned, self.time_s)
        return [float(time) for time in np.union1d(apart, given if len(given) <= MOST_BREAKS else given[:0])]

    def at(self, time_s: npt.ArrayLike) -> F64:
        """Rotation body -> GCRS at times after the epoch [s]; scalar last, unit, shape (n, 4).

        Raises:
            InputError: A time lies more than a second outside the table.
        """
        time = self._times_within(time_s)
        if len(self.time_s) == 1:
            return np.tile(self.quaternion, (len(time), 1))
        row = np.clip(np.searchsorted(self.time_s, time, side="right") - 1, 0, len(self.time_s) - 2)
        start, end = self.time_s[row], self.time_s[row + 1]
        part = (np.clip(time, self.time_s[0], self.time_s[-1]) - start) / (end - start)
        return slerp(self.quaternion[row], self.quaternion[row + 1], part)


@config_model
class AttitudeTable(FromFile):
    """Rotation of a body from a table; give file, or time_s and quaternion.

    Between rows the body turns at a constant rate about one axis (slerp); where a file has angular velocities, along
    the cubic of the rotation vector that keeps them, so that rows far apart serve. A single row holds for all times;
    more must cover the scene.

    Args:
        file: An attitude file; read on first use, and then kept.
        object: Which object of the file, where it holds several.
        time_s: Times after the scene's epoch, strictly ascending [s].
        quaternion: A row (x, y, z, w) for each time: body -> GCRS, scalar last, of norm 1 within 1e-3 (then scaled to
            1). Signs are free. Neighbours may differ by 170 degrees of rotation at most.
    """

    file: FileName | None = None
    object: str | None = None
    time_s: Times | None = None
    quaternion: Quaternions | None = None
    kind: Literal["table"] = Field(default="table", kw_only=True)

    @model_validator(mode="after")
    def _one_source(self) -> AttitudeTable:
        inline = self._is_inline("time_s", "quaternion")
        if self.object is not None and self.file is None:
            raise InputError("names an object of a file, which is not given", "object", self.object)
        if inline:
            self._inline_rows  # noqa: B018  # checked here, where the scene's file is known
        return self

    @cached_property
    def _inline_rows(self) -> AttitudeRows:
        return checked_rows(np.array(self.time_s), np.array(self.quaternion).reshape(-1, 4))

    @cached_property
    def _segments(self) -> list[Any]:
        from warpsim.exchange.read_files import attitude_of

        return attitude_of(self._source)

    def rows(self, epoch: Epoch) -> AttitudeRows:
        """The checked table for a scene's epoch.

        Raises:
            InputError: The file cannot be read, or its rows are not valid as `quaternion` or `time_s`.
        """
        if self.file is None:
            return self._inline_rows
        from warpsim.orbit.earth import attitude_in_gcrs

        segments = self._segments
        try:
            chosen = _of_object(segments, self.object)
            rows = checked_rows(*_joined([attitude_in_gcrs(segment, epoch) for segment in chosen]))
        except InputError as error:
            raise error.of(self.file) from None
        dated = None if chosen[0].instants.relative else epoch
        return replace(rows, source=f"{self.file}: {chosen[0].object_name}", epoch=dated)

    def span_s(self, epoch: Epoch) -> tuple[float, float]:
        """First and last time of the table after epoch [s]; minus and plus infinity for a single row."""
        return self.rows(epoch).span_s


def checked_rows(time_s: F64, quaternion: F64, rate_rad_s: F64 | None = None) -> AttitudeRows:
    """A table as given, checked, with norms of 1 and neighbours in one hemisphere; with rates more rows between them.

    Raises:
        InputError: Lengths differ, times do not ascend, a norm is not 1, or neighbours differ by more than 170 degrees.
    """
    if len(time_s) != len(quaternion):
        raise InputError(f"must have a row for each of {len(time_s)} times", "quaternion", len(quaternion))
    if len(time_s) == 0:
        raise InputError("must hold at least one time", "time_s")
    if not (np.isfinite(time_s).all() and np.isfinite(quaternion).all()):
        raise InputError("must be finite", "time_s, quaternion")
    (back,) = np.nonzero(np.diff(time_s) <= 0)
    if len(back):
        row = int(back[0])
        rule = f"must ascend, got {time_s[row + 1]:.17g} after {time_s[row]:.17g}"
        raise InputError(rule, "time_s", row=row + 1)
    with np.errstate(over="ignore"):  # infinity is no norm of 1 either
        norm = np.sqrt(np.sum(quaternion**2, axis=1))
    (wrong,) = np.nonzero(~(np.abs(norm - 1) <= NORM_TOLERANCE))
    if len(wrong):
        row = wrong[0]
        raise InputError(f"norm must be 1 within {NORM_TOLERANCE:g}", "quaternion", norm[row], ".6g", row=int(row))
    rows = in_one_hemisphere(unit(quaternion))
    step_deg = np.degrees(rotation_between_rad(rows[:-1], rows[1:]))
    (far,) = np.nonzero(step_deg > LARGEST_STEP_DEG)
    if len(far):
        raise InputError(
            f"neighbours must differ by at most {LARGEST_STEP_DEG:g} deg of rotation (or the way round is not known), "
            f"got {step_deg[far[0]]:.4g} deg from row {far[0]} to {far[0] + 1}",
            "quaternion",
        )
    times, note = np.asarray(time_s, dtype=np.float64), ""
    if rate_rad_s is not None and not rates_fit(times, rows, rate_rad_s):
        rate_rad_s, note = None, "its angular velocities are not those of its rows, and not used"
    error_rad = row_errors_rad(times, rows, rate_rad_s)
    dense = (times, rows)
    if rate_rad_s is not None:
        dense, note = dense_rows(times, rows, rate_rad_s), "with its angular velocities"
    return AttitudeRows(*dense, error_rad=error_rad, given_s=times, note=note)


def _of_object(segments: Sequence[Any], name: str | None) -> list[Any]:
    """Segments of one object, in the order of the file."""
    names = sorted({segment.object_name for segment in segments})
    if name is None and len(names) > 1:
        raise InputError(f"must be given, the file holds {', '.join(names)}", "object")
    if name is not None and name not in names:
        raise InputError(f"must be one of {', '.join(names)}", "object", name)
    return [segment for segment in segments if name in (None, segment.object_name)]


def _joined(segments: Sequence[tuple[F64, F64, F64 | None]]) -> tuple[F64, F64, F64 | None]:
    """Segments that begin where the one before ends, as one table; rates where all have some.

    Raises:
        InputError: There is a gap, an overlap or a jump between two of them.
    """
    time, quaternion, _ = segments[0]
    rates = [rate if number == 0 or rate is None else rate[1:] for number, (_, _, rate) in enumerate(segments)]
    for next_time, next_quaternion, _ in segments[1:]:
        jump_rad = rotation_between_rad(unit(quaternion[-1]), unit(next_quaternion[0]))
        if abs(next_time[0] - time[-1]) > DATE_ROUNDING_S or jump_rad > SAME_ROTATION_RAD:
            raise InputError(
                f"segments of one object must join without a gap or a jump, got one that ends at {time[-1]:.9g} s and "
                f"one that begins at {next_time[0]:.9g} s"
            )
        time = np.concatenate([time, next_time[1:]])
        quaternion = np.concatenate([quaternion, next_quaternion[1:]])
    known = [rate for rate in rates if rate is not None]
    return time, quaternion, np.concatenate(known) if len(known) == len(rates) else None
