"""Request and result of a render call: columns of its views, and their images."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.records import Observation, View

from warpsim.arguments import frame_numbers
from warpsim.launches import to_numpy, wait_on_current_stream
from warpsim.pool import Pool
from warpsim.render.device_scene import DeviceBodies, DeviceScene

StarList = tuple[npt.NDArray[Any], ...]


@dataclass(frozen=True)
class Inputs:
    """Inputs of views, each (n_view,).

    They are arrays of their own, not records: the compiler makes vector instructions of `read_out` for arrays without
    gaps only, even of those that it reads one number of.
    """

    time_s: wp.array
    """Middle of the exposure, after the epoch."""
    frame: wp.array
    sensor: wp.array
    """Index of the sensor among those of its kind."""

    def part(self, first: int, end: int) -> Inputs:
        """Inputs of some consecutive views."""
        return Inputs(self.time_s[first:end], self.frame[first:end], self.sensor[first:end])


@dataclass(frozen=True)
class Columns:
    """Results of views as device arrays; the first axis is that of views."""

    views: wp.array
    """View records, (n_view,)."""
    observations: wp.array
    """Observation records, (n_view, n_target + n_patch): targets, and behind them what is seen of their patches."""
    irradiance_w_cm2: wp.array
    """In-band irradiance of targets at the pupil, (n_view, n_band, n_target)."""
    offset_px: wp.array | None = None
    """Movement of targets during the exposure: Legendre coefficients, (n_view, n_target, n_path); None where still."""
    brightness: wp.array | None = None
    """Change of their brightness: Legendre coefficients over the mean, (n_view, n_band, n_target, n_profile)."""
    background_w_cm2: wp.array | None = None
    """Background in a target's pixel, (n_view, n_band, n_target); None where there is none."""
    row_time_s: wp.array | None = None
    """Mid-exposure of a target's row after the frame's time, (n_view, n_target); None where rows do not differ."""

    @property
    def arrays(self) -> tuple[wp.array, ...]:
        """All arrays that there are."""
        given = (getattr(self, field.name) for field in fields(self))
        return tuple(array for array in given if array is not None)

    def part(self, first: int, end: int) -> Columns:
        """Columns of some consecutive views."""
        return self._each(lambda array: some_views(array, first, end))

    def to(self, device: wp.Device) -> Columns:
        """Return the same on a device."""
        return self._each(lambda array: array.to(device))

    def _each(self, change: Callable[[wp.array], wp.array]) -> Columns:
        given = (getattr(self, field.name) for field in fields(self))
        return Columns(*(None if array is None else change(array) for array in given))


class HostColumns:
    """Columns as NumPy arrays, complete after an event; each is read when it is first asked for."""

    def __init__(self, columns: Columns, ready: wp.Event | None = None) -> None:
        self._columns, self._ready = columns, ready

    @property
    def columns(self) -> Columns:
        """The columns themselves; what is asked of their device's current stream from now on finds them complete."""
        wait_on_current_stream(self._ready, self._columns.views.device)
        return self._columns

    @cached_property
    def views(self) -> npt.NDArray[Any]:
        """View records by name of field, (n_view,)."""
        return to_numpy(self.columns.views)

    @cached_property
    def observations(self) -> npt.NDArray[Any]:
        """Observation records by name of field, (n_view, n_target)."""
        columns = self.columns
        return to_numpy(columns.observations)[:, : columns.irradiance_w_cm2.shape[-1]]

    @cached_property
    def irradiance_w_cm2(self) -> npt.NDArray[np.float32]:
        """In-band irradiance of targets at the pupil, (n_view, n_band, n_target)."""
        return to_numpy(self.columns.irradiance_w_cm2)

    @cached_property
    def offset_px(self) -> npt.NDArray[np.float32]:
        """Movement of targets: Legendre coefficients, (n_view, n_target, n_path, 2)."""
        if self.columns.offset_px is None:
            return np.zeros((*self.observations.shape, 0, 2), dtype=np.float32)
        return to_numpy(self.columns.offset_px)

    @cached_property
    def brightness(self) -> npt.NDArray[np.float32]:
        """Change of their brightness: Legendre coefficients over the mean, (n_view, n_band, n_target, n_profile)."""
        if self.columns.brightness is None:
            return np.zeros((*self.irradiance_w_cm2.shape, 0), dtype=np.float32)
        return to_numpy(self.columns.brightness)

    @cached_property
    def background_w_cm2(self) -> npt.NDArray[np.float32] | None:
        """Background in a target's pixel, (n_view, n_band, n_target); None where there is none."""
        return None if self.columns.background_w_cm2 is None else to_numpy(self.columns.background_w_cm2)

    @cached_property
    def row_time_s(self) -> npt.NDArray[np.float64] | None:
        """Mid-exposure of a target's row after the frame's time, (n_view, n_target); None where rows do not differ."""
        return None if self.columns.row_time_s is None else to_numpy(self.columns.row_time_s)


@dataclass(frozen=True)
class Batch:
    """Views, frame by frame and sensor by sensor within it, and what a render call makes of them."""

    time_s: npt.NDArray[np.float64]
    frame: npt.NDArray[np.uint32]
    sensor: npt.NDArray[np.uint32]
    columns: Columns
    counts: wp.array
    """(n_view, n_band, n_row, n_col)."""
    signal_w_cm2: wp.array | None
    stars: list[StarList] | None
    """Position, movement, irradiance and number of the stars of each view."""

    @property
    def inputs(self) -> tuple[npt.NDArray[Any], ...]:
        """Columns that pipelines read of the views."""
        return self.time_s, self.frame, self.sensor

    @property
    def n_view(self) -> int:
        """Views."""
        return len(self.time_s)


def new_batch(
    scene: DeviceScene,
    frames: Sequence[int],
    sensors: Sequence[str],
    pool: Pool,
    keep_signal: bool = False,
    keep_stars: bool = False,
) -> Batch:
    """Return a batch of frames and sensors with memory from the pool, uninitialised, on the pool's device."""
    n_sensor, instrument = len(sensors), scene.instrument
    n_view, numbers = len(frames) * n_sensor, frame_numbers(frames)
    rows = [instrument.index(name) for name in sensors]
    camera = instrument.sensor.camera
    shape = (n_view, scene.n_band, camera.n_row, camera.n_col)
    return Batch(
        np.repeat(instrument.frame_time_s(numbers), n_sensor),
        np.repeat(numbers.astype(np.uint32), n_sensor),
        np.tile(np.asarray(rows, dtype=np.uint32), len(frames)),
        Columns(**{name: pool.new(shape, dtype) for name, (shape, dtype) in _column_kinds(scene, n_view).items()}),
        pool.new(shape, wp.uint16),
        pool.new(shape, wp.float32) if keep_signal else None,
        [()] * n_view if keep_stars else None,
    )


def new_inputs(device: wp.Device, time_s: Any, frame: Any, sensor: Any) -> Inputs:
    """Return the inputs of views on a device; on the CPU without a copy."""
    return Inputs(
        wp.array(np.asarray(time_s, dtype=np.float64), dtype=wp.float64, device=device, copy=False),
        wp.array(np.asarray(frame, dtype=np.uint32), dtype=wp.uint32, device=device, copy=False),
        wp.array(np.asarray(sensor, dtype=np.uint32), dtype=wp.uint32, device=device, copy=False),
    )


def inputs_of_views(device: wp.Device, time_s: Any, sensors: Sequence[int], frames: Any = None) -> Inputs:
    """Return the inputs of views, time by time and sensor by sensor within it; without frames these are all 0."""
    frame = np.zeros(len(time_s)) if frames is None else frames
    n_sensor = len(sensors)
    return new_inputs(device, np.repeat(time_s, n_sensor), np.repeat(frame, n_sensor), np.tile(sensors, len(time_s)))


def some_views(array: wp.array, first: int, end: int) -> wp.array:
    """Return the part of an array that is of some consecutive views."""
    return array[first:end] if array.size else array  # Warp does not slice what is empty


def new_columns(scene: DeviceBodies, n_view: int) -> Columns:
    """Return columns for stages to write into, 0 where none writes."""
    kinds = _column_kinds(scene, n_view).items()
    return Columns(**{name: wp.zeros(shape, dtype=dtype, device=scene.device) for name, (shape, dtype) in kinds})


def _column_kinds(scene: DeviceBodies, n_view: int) -> dict[str, tuple[tuple[int, ...], Any]]:
    """Shape and type of each of the columns that there are."""
    n_band, n_target = scene.n_band, scene.n_target
    light = ((n_view, n_band, n_target), wp.float32)
    kinds: dict[str, tuple[tuple[int, ...], Any]] = {
        "views": ((n_view,), View),
        "observations": ((n_view, n_target + scene.field.n_patch), Observation),
        "irradiance_w_cm2": light,
    }
    if scene.streaks.enabled:
        kinds["offset_px"] = (n_view, n_target, scene.streaks.n_path), wp.vec2
        kinds["brightness"] = (n_view, n_band, n_target, scene.field.n_profile), wp.float32
    if isinstance(scene, DeviceScene) and scene.background is not None:
        kinds["background_w_cm2"] = light
    if scene.streaks.rolls:
        kinds["row_time_s"] = (n_view, n_target), wp.float64
    return kinds


def column_bytes(scene: DeviceBodies) -> int:
    """Return the memory that the columns of a view take."""
    return sum(
        math.prod(shape) * wp.types.type_size_in_bytes(dtype) for shape, dtype in _column_kinds(scene, 1).values()
    )


def copy_views(
    to: wp.array, to_first: int, source: wp.array, first: int, n_view: int, stream: wp.Stream | None = None
) -> None:
    """Copy consecutive views between contiguous arrays that are alike, of any devices."""
    if not n_view or not source.size:
        return
    if to.device.is_cpu and source.device.is_cpu:
        step = source.strides[0]  # a quarter of the Python that wp.copy is
        ctypes.memmove(to.ptr + to_first * step, source.ptr + first * step, n_view * step)
    else:
        length = source.size // source.shape[0]
        wp.copy(to, source, to_first * length, first * length, n_view * length, stream=stream)
