"""Arguments of a render call: sensors of one kind, bands, frames."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.arguments import chosen_names
from warpsim.detector.pixel_maps import check_maps_files
from warpsim.errors import InputError
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario

MOST_SURE_FRAMES = 2**20
"""Frames of a call that is looked at whole, whatever it asks for."""

MOST_FRAMES = 2**32
"""Frame numbers are 32 bits of random keys."""

LEAST_RATE_HZ = 1e-6
"""A frame in twelve days."""


@dataclass(frozen=True)
class Request:
    """Arguments of a render call, checked: labels of the axes of its images."""

    scenario: Scenario
    instrument: Instrument
    """Kind of the sensors."""
    frames: Sequence[int]
    """Frame numbers, a range or a list."""
    sensors: list[str]
    """Names."""
    bands: list[str]
    """Names."""
    keep_signal: bool = False
    """Whether the noiseless irradiance per pixel is kept."""
    keep_stars: bool = False
    """Whether the stars in each view are listed."""

    @property
    def time_s(self) -> npt.NDArray[np.float64]:
        """Times of the frames after the epoch [s], (n_frame,)."""
        return self.instrument.frame_time_s(self.frames)

    @property
    def nei_w_cm2(self) -> npt.NDArray[np.float64]:
        """Noise equivalent irradiance in each band [W/cm2], (n_band,)."""
        return np.array([self.instrument.nei_w_cm2(band) for band in self.bands])

    @property
    def bytes_per_frame(self) -> int:
        """Bytes of the counts of a frame of all sensors."""
        camera = self.instrument.sensor.camera
        return 2 * len(self.sensors) * len(self.bands) * camera.n_row * camera.n_col


def checked_request(
    scenario: Scenario,
    frames: Iterable[int] | None,
    sensors: str | Sequence[str] | None,
    bands: str | Sequence[str] | None,
    keep: tuple[bool, bool] = (False, False),
) -> Request:
    """Return the arguments of a render call.

    Args:
        scenario: What the scene gives.
        frames: Frame numbers; all of the scene when left out.
        sensors: As in checked_names.
        bands: As in checked_names.
        keep: Whether to keep the signal, and the stars.

    Raises:
        InputError: As in checked_names; a frame outside the scene.
    """
    instrument, sensor_list, band_list = checked_names(scenario, sensors, bands)
    check_maps_files(instrument.sensor.detector.maps_file, sensor_list)
    numbers = range(instrument.frames.count) if frames is None else frames
    frame_list = checked_frames(numbers, instrument, scenario.scene.duration_s)
    return Request(scenario, instrument, frame_list, sensor_list, band_list, *keep)


def checked_rate(rate_hz: float | None) -> float | None:
    """Return the frames per second of a stream; None for as many as can be."""
    is_number = isinstance(rate_hz, int | float | np.integer | np.floating) and not isinstance(rate_hz, bool)
    if rate_hz is not None and not (is_number and LEAST_RATE_HZ <= rate_hz < np.inf):
        raise InputError(f"must be a number of at least {LEAST_RATE_HZ:g}", "rate_hz", rate_hz)
    return rate_hz


def checked_names(
    scenario: Scenario, sensors: str | Sequence[str] | None, bands: str | Sequence[str] | None
) -> tuple[Instrument, list[str], list[str]]:
    """Return the kind of the sensors to render, the sensors and the bands."""
    chosen = scenario.sensors_with_access if sensors is None else scenario.select_sensors(sensors)
    if not chosen:
        raise InputError(
            "none has access to a target under the access_rules; name sensors to render them all the same", "sensors"
        )
    instrument = scenario.instrument_of(chosen[0])
    others = {scenario.instrument_of(name).sensor.name: name for name in chosen if name not in instrument.names}
    if others:
        kinds = [instrument.sensor.name, *others]
        shapes = [scenario.instruments[kind].sensor.camera for kind in kinds]
        sizes = ", ".join(f"{kind} {c.n_row} x {c.n_col}" for kind, c in zip(kinds, shapes, strict=True))
        rule = f"must be of one kind, got several ({sizes} pixels); call once for each, as in sensors={kinds[0]!r}"
        raise InputError(rule, "sensors")
    return instrument, chosen, chosen_names("bands", bands, list(instrument.sensor.bands))


def checked_frames(frames: Iterable[int], instrument: Instrument, duration_s: float) -> Sequence[int]:
    """Return frame numbers as a range, or a list of int where they are not evenly spaced."""
    if frames is None or isinstance(frames, int | np.integer | str | bytes | bytearray):
        raise InputError("must be a list or range of frame numbers", "frames", frames)
    numbers = frames if isinstance(frames, range) else _whole_numbers(frames)
    is_range = isinstance(numbers, range)
    ends = [numbers[0], numbers[-1]] if is_range and numbers else list(numbers)
    if ends and not 0 <= min(ends) <= max(ends) < MOST_FRAMES:
        wrong = next(number for number in ends if not 0 <= number < MOST_FRAMES)
        raise InputError("must be whole numbers from 0 to 2**32 - 1", "frames", wrong)
    if len(numbers) > MOST_SURE_FRAMES:  # else to look at all of them may take all memory
        _checked_times(ends, instrument, duration_s)
    instrument.check_frames(_checked_times(numbers, instrument, duration_s))
    return numbers


def _checked_times(numbers: Sequence[int], instrument: Instrument, duration_s: float) -> npt.NDArray[np.float64]:
    """Return the times of frames after the epoch [s], shape (n,), none of them after the scene's end."""
    times = instrument.frame_time_s(numbers)
    late = np.flatnonzero(times > duration_s)
    if late.size:
        first = late[0]
        raise InputError(
            f"frame {numbers[first]} is at {times[first]:g} s, after the scene's end (duration_s = {duration_s:g})",
            "frames",
        )
    return times


def _whole_numbers(numbers: Iterable[Any]) -> Sequence[int]:
    """Numbers as a range, or a list of int; quick looks first, as this is done in every call."""
    if isinstance(numbers, np.ndarray) and numbers.ndim == 1 and numbers.dtype.kind in "iu":
        return _as_range(numbers.tolist())
    try:
        listed = list(numbers)
    except TypeError:  # as of an array without axes
        raise InputError("must be a list or range of frame numbers", "frames", numbers) from None
    if not set(map(type, listed)) <= {int}:
        for number in listed:
            if isinstance(number, bool) or not isinstance(number, int | np.integer):
                raise InputError("must be whole numbers from 0 to 2**32 - 1", "frames", number)
        listed = [int(number) for number in listed]
    return _as_range(listed)


def _as_range(numbers: list[int]) -> Sequence[int]:
    """Return the same numbers as a range, which takes no time afterwards, if they are one."""
    if len(numbers) < 2 or numbers[0] == numbers[1]:
        return numbers
    step = numbers[1] - numbers[0]
    even = range(numbers[0], numbers[0] + step * len(numbers), step)
    return even if numbers[-1] == even[-1] and numbers == list(even) else numbers
