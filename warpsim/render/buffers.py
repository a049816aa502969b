"""Arrays that the stages write, allocated once and used again."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.emission import Seen
from warpsim_kernels.signature import N_TERM
from warpsim_kernels.strips import STRIP_PIXELS, n_flag

if TYPE_CHECKING:
    from warpsim.render.device_scene import DeviceBodies, DeviceScene

SIGNAL_BYTES_PER_CHUNK = 32 * 2**20
"""What the signal of a chunk's images would take on the CPU, so much that the Python of a chunk, 50 to 150 us, does not
count; and what its source lists take."""

SIGNAL_BYTES_AT_A_TIME = 2**20
"""Signal that one CPU worker holds at a time, but an image: it is to stay in the cache between deposit and read-out."""

SIGNAL_BYTES_PER_CHUNK_CUDA = 512 * 2**20
"""Both on CUDA, where a launch should be large."""


@dataclass(frozen=True)
class PathViews:
    """Views at the instants of the exposure at which places are found; each array is (n_view, n_path)."""

    time_s: wp.array
    middle_s: wp.array
    sensor: wp.array
    axes: wp.array
    position_m: wp.array
    velocity_m_s: wp.array
    flags: wp.array


@dataclass(frozen=True)
class Views:
    """Inputs and geometry of the views of one render call; each array's first axis is (n_view,)."""

    time_s: wp.array
    middle_s: wp.array
    """Middle of the exposure; here, the same as time_s."""
    frame: wp.array
    sensor: wp.array
    axes: wp.array
    position_m: wp.array
    velocity_m_s: wp.array
    flags: wp.array
    """What had to be replaced in the axes: bits of warpsim_kernels.aim."""
    n_wanted: wp.array
    """Source slots each view needs; compared with the slots there are after rendering."""
    reach: wp.array
    """How far stars move at most during the exposure [px] and [rad]; read where they do."""
    path: PathViews | None
    """None where nothing moves during the exposure."""


@dataclass(frozen=True)
class Observations:
    """What is known of each target in each view; shape (n_view, n_target), irradiance (n_view, n_band, n_target)."""

    xy_px: wp.array
    range_m: wp.array
    aspect_rad: wp.array
    area_m2: wp.array
    sun_area_m2: wp.array
    earth_area_m2: wp.array
    albedo_area_m2_sr: wp.array
    sunlit: wp.array
    temperature_k: wp.array
    flags: wp.array
    irradiance_w_cm2: wp.array
    offset_px: wp.array
    """Movement during the exposure: Legendre coefficients, (n_view, n_target, n_path)."""
    brightness: wp.array
    """Change of brightness: Legendre coefficients over the mean, (n_view, n_band, n_target, n_exposure)."""


@dataclass(frozen=True)
class Sources:
    """Point sources on the focal plane, stars and targets alike (structure of arrays)."""

    n_source: wp.array
    """Filled slots, shape (n_view,)."""
    xy_px: wp.array
    """Position; float64, so that the distance to a pixel's edge keeps its digits; shape (n_view, n_slot)."""
    irradiance_w_cm2: wp.array
    """In-band irradiance at the pupil, shape (n_view, n_band, n_slot)."""
    star: wp.array
    """Star in cell order, -1 for a target, shape (n_view, n_slot)."""
    direction: wp.array
    """Apparent direction of stars, shape (n_view, n_slot); none where nothing moves."""
    offset_px: wp.array
    """Movement during the exposure: Legendre coefficients, shape (n_view, n_slot, n_path)."""
    area_series: wp.array
    """How the areas of targets change: Legendre coefficients, shape (n_view, n_target, N_TERM, n_exposure)."""


@dataclass(frozen=True)
class Light:
    """Noiseless images. Between frames they are dark, so that a frame touches those strips only that sources reach."""

    flat: wp.array
    """All images, and behind them a strip that stays dark; shape (n_view * n_band * n_pixel + STRIP_PIXELS,)."""
    signal_w_cm2: wp.array
    """The images, shape (n_view, n_band, n_row, n_col)."""
    lit: wp.array
    """Which strips of neighbouring pixels have light, shape (n_view, n_band, n_flag): strips of whole blocks."""

    @property
    def dark_place(self) -> int:
        """Where the dark strip begins."""
        return int(self.flat.size - STRIP_PIXELS)


@dataclass(frozen=True)
class Chunk:
    """The arrays of some consecutive views: what one pass through the stages reads and writes."""

    views: Views
    observations: Observations
    sources: Sources
    light: Light
    counts: wp.array
    """Shape (n_view, n_band, n_row, n_col)."""
    keep_light: bool
    """Whether the read-out leaves the light where it is."""

    @property
    def n_view(self) -> int:
        """Views in the chunk."""
        return int(self.counts.shape[0])


def observation_columns(scene: DeviceBodies) -> dict[str, tuple[Any, tuple[int, ...]]]:
    """Warp type and shape within a view of each array of Observations."""
    number, n_target = (wp.float64, (scene.n_target,)), scene.n_target
    return {
        "xy_px": (wp.vec2d, (n_target,)),
        "range_m": number,
        "aspect_rad": number,
        "area_m2": number,
        "sun_area_m2": number,
        "earth_area_m2": number,
        "albedo_area_m2_sr": number,
        "sunlit": number,
        "temperature_k": number,
        "flags": (wp.int32, (n_target,)),
        "irradiance_w_cm2": (wp.float32, (scene.n_band, n_target)),
        "offset_px": (wp.vec2, (n_target, scene.streaks.n_path)),
        "brightness": (wp.float32, (scene.n_band, n_target, scene.field.n_profile)),
    }


def new_observations(scene: DeviceBodies, n_view: int) -> Observations:
    """Observations of n_view views, 0 where nothing writes."""
    columns = observation_columns(scene).items()
    return Observations(
        **{name: wp.zeros((n_view, *shape), dtype=dtype, device=scene.device) for name, (dtype, shape) in columns}
    )


SEEN = ("range_m", "area_m2", "sun_area_m2", "earth_area_m2", "albedo_area_m2_sr", "temperature_k", "flags")
"""Observations that brightness is made of."""


def seen_struct(observations: Observations) -> Any:
    """What brightness is made of, as the kernels' struct."""
    seen: Any = Seen()
    for name in SEEN:
        setattr(seen, name, getattr(observations, name))
    return seen


def new_light(shape: tuple[int, int, int, int], device: wp.Device) -> Light:
    """Dark images of the shape (n_view, n_band, n_row, n_col)."""
    n_view, n_band, n_row, n_col = shape
    size = n_view * n_band * n_row * n_col
    flat = wp.zeros(size + STRIP_PIXELS, dtype=wp.float32, device=device)
    lit = wp.zeros((n_view, n_band, n_flag(n_row * n_col)), dtype=wp.uint8, device=device)
    return Light(flat, flat[:size].reshape(shape), lit)


def part_of_light(light: Light, n_view: int) -> Light:
    """The light of the first views."""
    return Light(light.flat, light.signal_w_cm2[:n_view], light.lit[:n_view])


def new_sources(scene: DeviceScene, n_view: int, n_slot: int) -> Sources:
    """Uninitialised source lists of n_view views."""
    device, n_path = scene.device, scene.streaks.n_path
    return Sources(
        wp.empty(n_view, dtype=wp.int32, device=device),
        wp.empty((n_view, n_slot), dtype=wp.vec2d, device=device),
        wp.empty((n_view, scene.n_band, n_slot), dtype=wp.float32, device=device),
        wp.empty((n_view, n_slot), dtype=wp.int32, device=device),
        wp.empty((n_view, n_slot if n_path else 0), dtype=wp.vec3d, device=device),
        wp.empty((n_view, n_slot, n_path), dtype=wp.vec2, device=device),
        wp.empty((n_view, scene.n_target, N_TERM, scene.field.n_profile), dtype=wp.float64, device=device),
    )


def new_views(scene: DeviceBodies, time_s: Any, frame: Any, sensor: Any) -> Views:
    """Views of given times, frame numbers and sensor rows, each of shape (n_view,); geometry still to be aimed."""
    n_view, device = len(time_s), scene.device
    times = wp.array(time_s, dtype=wp.float64, device=device)
    return Views(
        times,
        times,
        wp.array(frame, dtype=wp.uint32, device=device),
        wp.array(sensor, dtype=wp.uint32, device=device),
        wp.empty(n_view, dtype=wp.mat33d, device=device),
        wp.empty(n_view, dtype=wp.vec3d, device=device),
        wp.empty(n_view, dtype=wp.vec3d, device=device),
        wp.empty(n_view, dtype=wp.int32, device=device),
        wp.empty(n_view, dtype=wp.int32, device=device),
        wp.empty(n_view, dtype=wp.vec2d, device=device),
        new_path_views(device, scene.streaks.offset_s, time_s, sensor) if scene.streaks.wanted else None,
    )


def new_path_views(device: wp.Device, offset_s: npt.NDArray[np.float64], time_s: Any, sensor: Any) -> PathViews:
    """Views at times before and after given ones [s], (n_path,), for views of given times and sensors, (n_view,)."""
    return path_views_of(path_inputs(device, offset_s, time_s, sensor))


def path_views_of(inputs: tuple[wp.array, wp.array, wp.array]) -> PathViews:
    """Views with given inputs, and room for their geometry."""
    shape, device = inputs[0].shape, inputs[0].device
    return PathViews(
        *inputs,
        wp.empty(shape, dtype=wp.mat33d, device=device),
        wp.empty(shape, dtype=wp.vec3d, device=device),
        wp.empty(shape, dtype=wp.vec3d, device=device),
        wp.empty(shape, dtype=wp.int32, device=device),
    )


def path_inputs(
    device: wp.Device, offset_s: npt.NDArray[np.float64], time_s: Any, sensor: Any
) -> tuple[wp.array, wp.array, wp.array]:
    """The first three arrays of these views: time, middle of the exposure, sensor."""
    shape = (len(time_s), len(offset_s))
    middle_s = np.broadcast_to(np.asarray(time_s, dtype=np.float64)[:, None], shape)
    sensors = np.broadcast_to(np.asarray(sensor, dtype=np.uint32)[:, None], shape)
    return (
        wp.array(middle_s + offset_s, dtype=wp.float64, device=device),
        wp.array(middle_s.copy(), dtype=wp.float64, device=device),
        wp.array(sensors.copy(), dtype=wp.uint32, device=device),
    )


def part_of(arrays: Any, first: int, end: int) -> Any:
    """The same dataclass of arrays, cut along the first axis."""

    def part(value: Any) -> Any:
        if value is None or is_dataclass(value):
            return value and part_of(value, first, end)
        return value[first:end] if value.size else value  # Warp does not slice what is empty

    return type(arrays)(*(part(getattr(arrays, field.name)) for field in fields(arrays)))


def images_at_a_time(scene: DeviceScene, n_pixel: int, n_view: int) -> int:
    """Views of a chunk whose images are drawn and read out together."""
    fitting = max(1, SIGNAL_BYTES_AT_A_TIME // (4 * scene.n_band * n_pixel))
    return n_view if scene.device.is_cuda else min(n_view, fitting)


def views_per_chunk(scene: DeviceScene, n_pixel: int, n_slot: int, chunk_bytes: int | None = None) -> int:
    """Views whose signal would fit the chunk's share of memory, and whose source lists and records do; at least one."""
    share = chunk_bytes or (SIGNAL_BYTES_PER_CHUNK_CUDA if scene.device.is_cuda else SIGNAL_BYTES_PER_CHUNK)
    signal_bytes = 4 * scene.n_band * n_pixel
    slot_bytes = 16 + 4 * scene.n_band + 4  # position, irradiance, star
    if scene.streaks.wanted:
        slot_bytes += 24 + 8 * scene.streaks.n_path  # direction, movement
    series_bytes = 8 * N_TERM * scene.field.n_profile * scene.n_target
    view_bytes = slot_bytes * n_slot + series_bytes + scene.observation_rows.n_byte
    return max(1, int(min(share // signal_bytes, share // view_bytes)))
