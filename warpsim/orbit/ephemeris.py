"""Motion along files of states: OEM, STK ephemerides and tables (`warpsim.exchange`).

Each segment is interpolated on its own, in the frame of its file and with the method that the file asks for (Hermite of
degree 7 where it asks for none and has velocities, Lagrange of degree 7 without), and then turned into GCRS axes. The
velocity is the derivative of the position's interpolant, so both describe one motion. Up to 60 s beyond the ends of the
file's span the motion goes on as free flight with J2. Where only the times of a scene matter (`states_within`), those
outside it are room for its node grid, and the motion goes on from the segment at the scene's end, file or none.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
import os
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, model_validator
from pydantic_core import ArgsKwargs

from warpsim.arrays import F64
from warpsim.config.fields import FileName, as_tuple
from warpsim.config.model import config_model
from warpsim.errors import InputError
from warpsim.exchange.instants import FileInstants, instants_of_time, later
from warpsim.exchange.read_files import ephemeris_of
from warpsim.exchange.segments import DEFAULT_DEGREE, EphemerisSegment, Frame, Interpolation, plain_name
from warpsim.exchange.source import SourceFile, read_source
from warpsim.orbit.earth import pole_of_date, states_to_gcrs
from warpsim.orbit.gravity import propagate
from warpsim.orbit.track import interpolate, sampling_error
from warpsim.tables.text import unlike

if TYPE_CHECKING:
    from warpsim.instant import Epoch


Span = tuple[float, float]
"""First and last time [s since the epoch]."""

LOWEST_HERMITE = 3
"""Lowest degree of Hermite's polynomials through two rows."""

FREE_FLIGHT_S = 60.0
"""How far beyond the ends of its span a motion goes on."""

MISSING_ROWS_M = 1e3
"""Interpolation that is off by more than this is refused, ..."""

SPARSE_ROWS_M = 1.0
"""... and by more than this is worth a note."""

_TOUCH_S = 1e-6
"""Segments whose ends are this close touch: rounding of dates."""


def _some_files(value: Any) -> Any:
    return (value,) if isinstance(value, os.PathLike) else as_tuple(value)


class _FileMotion:
    """Motion of the objects of files of states."""

    if TYPE_CHECKING:
        frame: Frame | None

        @property
        def _sources(self) -> Sequence[SourceFile]: ...
        @property
        def _all(self) -> Sequence[_Path]: ...

    @cached_property
    def checksum(self) -> str:
        """SHA-256 of the files' bytes, one file after the other, in hexadecimal."""
        return hashlib.sha256(b"".join(source.data for source in self._sources)).hexdigest()

    @cached_property
    def names(self) -> list[str]:
        """Names of the objects, in the order of the files: letters, digits, `_ . -`, unique."""
        return unlike(plain_name(path.name) for path in self._all)

    def span_s(self, epoch: Epoch) -> tuple[float, float]:
        """First and last time that all objects have in common [s since epoch]."""
        spans = [path.span_s(epoch) for path in self._all]
        return max(first for first, _ in spans), min(last for _, last in spans)

    def breaks_s(self, epoch: Epoch) -> list[float]:
        """Times at which segments begin, but for each object's first: a velocity may jump there [s since epoch]."""
        return sorted({start_s for path in self._all for start_s, _ in path.ends_s(epoch)[1:]})

    def gaps_s(self, epoch: Epoch) -> list[float]:
        """Times half-way between the end of an object's segment and the beginning of its next [s since epoch]."""
        pairs = [pair for path in self._all for pair in pairwise(path.ends_s(epoch))]
        return sorted({0.5 * (one[1] + other[0]) for one, other in pairs})

    def states(self, epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
        """Return positions [m] and velocities [m/s], GCRS axes, each (n_time, n_object, 3).

        Raises:
            InputError: A time is farther than 60 s from an object's span, or in a gap between its segments.
        """
        return _states(self._all, epoch, time_s, self.frame)

    def states_within(self, epoch: Epoch, time_s: ArrayLike, within_s: Span) -> tuple[F64, F64]:
        """Return states as `states` does; before and after `within_s` the motion goes on, in free flight if need be.

        Args:
            epoch: The scene's epoch.
            time_s: Times [s since epoch], shape (n_time,).
            within_s: The span that the files must cover, a scene's [s since epoch]. Before and after it the motion is
                that of the segment there, and free flight beyond that segment.

        Raises:
            InputError: As `states`, for times within the span.
        """
        return _states(self._all, epoch, time_s, self.frame, within_s)

    def notes(self, epoch: Epoch, duration_s: float) -> list[str]:
        """Return warnings, one per object: rows so far apart that positions between them are off by a metre or more.

        Raises:
            InputError: They are off by a kilometre or more.
        """
        return [note for note in (path.note(epoch, 0.0, duration_s) for path in self._all) if note]


@config_model
class EphemerisOrbit(_FileMotion):
    """Path of one object of a file of states.

    Args:
        file: OEM (text or XML), STK .e, or a table of states (CSV, ECSV).
        object: Name or number of the object; may be left out where the file has one only.
        frame: Axes of the file's states, instead of those that it states itself.
    """

    file: FileName
    object: str | None = None
    frame: Frame | None = None
    kind: Literal["ephemeris"] = "ephemeris"

    @cached_property
    def _sources(self) -> list[SourceFile]:
        return [read_source(self.file)]

    @cached_property
    def _all(self) -> list[_Path]:
        paths = _paths(ephemeris_of(self._sources[0], self.object))
        if len(paths) > 1:
            known = ", ".join(path.name for path in paths)
            raise InputError(f"must be given, the file holds {known}", "object").of(self.file)
        return paths


@config_model
class EphemerisSatellites(_FileMotion):
    """All objects of files of states. Segments of one object, by name and number, may come in several files.

    Args:
        files: Paths; see EphemerisOrbit. `file` is the same.
        frame: Axes of the files' states, instead of those that they state themselves.
    """

    files: Annotated[tuple[FileName, ...], BeforeValidator(_some_files)]
    frame: Frame | None = None
    kind: Literal["ephemeris_files", "ephemeris"] = "ephemeris_files"

    @model_validator(mode="before")
    @classmethod
    def _one_name(cls, data: Any) -> Any:
        """Take `file`, one or several, for `files`."""
        given = data if isinstance(data, dict) else data.kwargs or {}
        if "file" not in given:
            return data
        if "files" in given:
            raise InputError("must not both be given", "file, files")
        named = {"files" if name == "file" else name: value for name, value in given.items()}
        return named if isinstance(data, dict) else ArgsKwargs(data.args, named)

    @model_validator(mode="after")
    def _some(self) -> EphemerisSatellites:
        if not self.files:
            raise InputError("must name at least one file", "files")
        if len(set(self.files)) != len(self.files):
            raise InputError("must not repeat", "files")
        return self

    @cached_property
    def _sources(self) -> list[SourceFile]:
        return [read_source(file) for file in self.files]

    @cached_property
    def _all(self) -> list[_Path]:
        return _paths([segment for source in self._sources for segment in ephemeris_of(source)])

    def some(self, numbers: Iterable[int]) -> EphemerisSatellites:
        """Return the constellation of some of the objects, by their numbers."""
        rest = dataclasses.replace(self)
        rest.__dict__["_all"] = [self._all[number] for number in numbers]
        return rest


class _Path:
    """Segments of one object, in time order."""

    def __init__(self, segments: Sequence[EphemerisSegment]) -> None:
        self.name = segments[0].object_name
        self.file = segments[0].file
        if len({segment.instants.relative for segment in segments}) > 1:
            raise self.error("must all be dates, or all seconds since the scene's epoch", "times")
        first_segment = segments[0]
        first = first_segment.instants[0]

        def since_first(instants: FileInstants) -> F64:
            return instants.since_instant(first)

        self.segments = sorted(segments, key=lambda s: _useable_s(s, since_first)[0])
        for one, other in pairwise(self.segments):
            end_s, start_s = (_useable_s(s, since_first) for s in (one, other))
            if start_s[0] < end_s[1] - _TOUCH_S:
                early_s = end_s[1] - start_s[0]
                rule = f"segments must not overlap, this one begins {early_s:g} s before the one before ends"
                raise InputError(rule).of(self.name).of(f"line {other.line}").of(other.file)
        single = len(segments) == 1 and len(first_segment.instants) == 1 and first_segment.velocity_m_s is not None
        self.free_flight_s = math.inf if single else FREE_FLIGHT_S
        lonely = next((s for s in segments if len(s.instants) < 2 and s.velocity_m_s is None), None)
        if lonely is not None:
            raise self.error("must have two positions or more in a segment without velocities")

    def error(self, rule: str, field: str = "") -> InputError:
        """The error to raise about this object."""
        return InputError(rule, field).of(self.name).of(self.file)

    def ends_s(self, epoch: Epoch) -> list[tuple[float, float]]:
        """Useable span of each segment [s since epoch]."""
        return [_useable_s(segment, lambda instants: instants.since(epoch)) for segment in self.segments]

    def span_s(self, epoch: Epoch) -> tuple[float, float]:
        """First and last useable time [s since epoch]."""
        ends = self.ends_s(epoch)
        return ends[0][0], ends[-1][1]

    def note(self, epoch: Epoch, first_s: float, last_s: float) -> str | None:
        """One line if the rows within a span are so far apart that positions are off by a metre or more."""
        if math.isinf(self.free_flight_s):
            at = _shown(epoch, self.span_s(epoch)[0])
            return f"{self.file}: {self.name}: one state, at {at}, from which it flies freely with J2"
        worst = 0.0, first_s, last_s  # error [m], and the rows' times
        for segment in self.segments:
            row_s = segment.instants.since(epoch)
            rows = np.flatnonzero((row_s[1:] > first_s) & (row_s[:-1] < last_s))
            if rows.size and not segment.sampled:
                middle_s = 0.5 * (row_s[rows] + row_s[rows + 1])
                missed_m = sampling_error(row_s, *_table(segment), middle_s)
                at = rows[int(np.argmax(missed_m))]
                worst = max(worst, (float(missed_m.max()), float(row_s[at]), float(row_s[at + 1])))
        error_m, start_s, end_s = worst
        between = f"between rows at {_shown(epoch, start_s)} and {_shown(epoch, end_s)}"
        if error_m >= MISSING_ROWS_M:
            raise self.error(f"rows must be close enough to interpolate: {between} that is some {error_m:.1g} m off")
        return f"{self.file}: {self.name}: some {error_m:.1g} m off {between}" if error_m >= SPARSE_ROWS_M else None

    def segment_of(self, epoch: Epoch, time_s: F64, within_s: Span | None = None) -> NDArray[np.int64]:
        """Index of the segment of each time; the later one where two touch.

        Times before and after the span `within_s` belong to the segment at its beginning or end: the one within it,
        where two touch there.
        """
        now_s = time_s if within_s is None else np.clip(time_s, *within_s)
        ends = np.array(self.ends_s(epoch))
        first_s, last_s = ends[0, 0], ends[-1, 1]
        outside = ~((now_s >= first_s - self.free_flight_s) & (now_s <= last_s + self.free_flight_s))  # NaN too
        if outside.any():
            bad = float(now_s[np.argmax(outside)])
            raise self.error(f"time {_shown(epoch, bad)} must be in the file's span, {_span(epoch, first_s, last_s)}")
        asked_s = now_s if within_s is None else np.clip(now_s, within_s[0] + _TOUCH_S, within_s[1] - _TOUCH_S)
        index = np.clip(np.searchsorted(ends[:, 0], asked_s, side="right") - 1, 0, None)
        gap = (now_s > ends[index, 1] + _TOUCH_S) & (index < len(ends) - 1)
        if gap.any():
            at = int(np.argmax(gap))
            span = _span(epoch, ends[index[at], 1], ends[index[at] + 1, 0])
            raise self.error(f"time {_shown(epoch, float(now_s[at]))} must not be in a gap between segments, {span}")
        return index


def _useable_s(segment: EphemerisSegment, since: Callable[[FileInstants], F64]) -> tuple[float, float]:
    """First and last useable time of a segment, as `since` counts."""
    instants = segment.useable if segment.useable is not None else segment.instants[[0, -1]]
    time_s = since(instants)
    return float(time_s[0]), float(time_s[1])


def _table(segment: EphemerisSegment) -> tuple[F64, F64 | None, Interpolation, int]:
    """Positions, velocities, method and degree, as `interpolate` takes them."""
    usual: Interpolation = "lagrange" if segment.velocity_m_s is None else "hermite"
    method = segment.interpolation or usual
    degree = segment.degree or DEFAULT_DEGREE
    if method == "hermite":  # lower degrees go on from one row alone, whatever the next one says
        degree = max(degree, LOWEST_HERMITE)
    return segment.position_m, segment.velocity_m_s, method, degree


def _shown(epoch: Epoch, time_s: float) -> str:
    """A time for messages: seconds and UTC."""
    if not np.isfinite(time_s):
        return f"{time_s} s"
    utc = later(instants_of_time(epoch), np.array([time_s])).dates("UTC", 3)[0]
    return f"{time_s:.6f}".rstrip("0").rstrip(".") + f" s ({utc})"


def _span(epoch: Epoch, first_s: float, last_s: float) -> str:
    return f"{_shown(epoch, first_s)} to {_shown(epoch, last_s)}"


def _paths(segments: Sequence[EphemerisSegment]) -> list[_Path]:
    """Segments by object: name and number, or name and file where the file gives no number."""
    groups: dict[tuple[str, str, str], list[EphemerisSegment]] = {}
    for segment in segments:
        own = "" if segment.object_id else segment.file
        groups.setdefault((segment.object_name, segment.object_id, own), []).append(segment)
    paths = [_Path(group) for group in groups.values()]
    for path in paths:
        path.name = plain_name(path.name)
    return paths


def _states(
    paths: Sequence[_Path], epoch: Epoch, time_s: ArrayLike, frame: Frame | None, within_s: Span | None = None
) -> tuple[F64, F64]:
    """States of objects in GCRS axes, (n_time, n_object, 3) each."""
    times = np.atleast_1d(np.asarray(time_s, np.float64))
    position, velocity = (np.empty((len(times), len(paths), 3)) for _ in range(2))
    by_frame: dict[str, list[int]] = {}
    segments = [path.segment_of(epoch, times, within_s) for path in paths]
    for column, path in enumerate(paths):
        frames = {frame or segment.frame for segment in path.segments}
        if len(frames) > 1:
            raise path.error(f"must be the same in all segments, got {', '.join(sorted(frames))}", "frame")
        by_frame.setdefault(frames.pop(), []).append(column)
        position[:, column], velocity[:, column] = _along(path, epoch, times, segments[column])
    for name, columns in by_frame.items():  # one rotation serves all objects of a frame
        turned = states_to_gcrs(name, epoch, times, position[:, columns], velocity[:, columns])
        position[:, columns], velocity[:, columns] = turned
        for column in columns:
            states = position[:, column], velocity[:, column]
            _fly_on(paths[column], name, epoch, times, segments[column], *states)
    return position, velocity


def _along(path: _Path, epoch: Epoch, times: F64, which: NDArray[np.int64]) -> tuple[F64, F64]:
    """States in the file's own axes, (n_time, 3) each; beyond the segments given those of their ends."""
    position, velocity = np.empty((len(times), 3)), np.empty((len(times), 3))
    ends = path.ends_s(epoch)
    for index in np.unique(which).tolist():
        rows, segment = which == index, path.segments[index]
        within_s = np.clip(times[rows], *ends[index])
        position[rows], velocity[rows] = interpolate(segment.instants.since(epoch), *_table(segment), within_s)
    return position, velocity


def _fly_on(
    path: _Path, frame: str, epoch: Epoch, times: F64, which: NDArray[np.int64], position: F64, velocity: F64
) -> None:
    """Replace states beyond the segments by free flight from their ends, GCRS axes."""
    ends = np.array(path.ends_s(epoch))[which]
    for side, outside in enumerate((times < ends[:, 0], times > ends[:, 1])):
        for index in np.unique(which[outside]):
            beyond = outside & (which == index)
            end = ends[beyond][:1, side]
            state = states_to_gcrs(frame, epoch, end, *_along(path, epoch, end, which[beyond][:1]))
            pole = pole_of_date(epoch)
            try:
                flown = propagate(*state, times[beyond] - end[0], "j2", pole, float(end[0]))
            except InputError as error:
                beyond_s = _shown(epoch, float(end[0]))
                raise error.of(f"no free flight beyond {beyond_s}").of(path.name).of(path.file) from None
            position[beyond], velocity[beyond] = flown[0][:, 0], flown[1][:, 0]
