"""Arrays that only stages read and write: sources, instants of the exposure, signal."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.canvas import STRIP_PIXELS, n_flag
from warpsim_kernels.records import Sources, View
from warpsim_kernels.signature import N_TERM

if TYPE_CHECKING:
    from warpsim.render.device_scene import DeviceBodies, DeviceScene

SOURCE_ARRAYS = ("n_source", "xy_px", "irradiance_w_cm2", "star", "direction", "offset_px")


@dataclass(frozen=True)
class ExposureViews:
    """Views at the instants of the exposure at which positions are found; each array is (n_view, n_path)."""

    offset_s: wp.array
    """The instants, from the middle of the exposure [s], (n_path,)."""
    time_s: wp.array
    middle_s: wp.array
    sensor: wp.array
    views: wp.array
    """View records."""


@dataclass(frozen=True)
class Signal:
    """Noiseless images. Between frames they are 0, so that a frame touches those strips only that sources reach."""

    flat: wp.array
    """All images, and behind them a strip that stays 0; shape (n_view * n_band * n_pixel + STRIP_PIXELS,)."""
    images: wp.array
    """The images [W/cm2], shape (n_view, n_band, n_row, n_col)."""
    touched: wp.array
    """Flags of strips of neighbouring pixels with light, shape (n_view, n_band, n_flag): strips of whole blocks."""

    untouched: wp.array
    """The same without any light."""

    @property
    def zero_strip(self) -> int:
        """Index of the first pixel of the strip that stays 0."""
        return int(self.flat.size - STRIP_PIXELS)

    @property
    def arrays(self) -> list[wp.array]:
        """Arrays that take memory."""
        return [self.flat, self.touched, self.untouched]

    def part(self, n_view: int) -> Signal:
        """The images of the first views."""
        return Signal(self.flat, self.images[:n_view], self.touched[:n_view], self.untouched)


def new_signal(shape: tuple[int, int, int, int], device: wp.Device) -> Signal:
    """Return images of zeros of the shape (n_view, n_band, n_row, n_col)."""
    n_view, n_band, n_row, n_col = shape
    size = n_view * n_band * n_row * n_col
    flat = wp.zeros(size + STRIP_PIXELS, dtype=wp.float32, device=device)
    touched, untouched = (
        wp.zeros((n_view, n_band, n_flag(n_row * n_col)), dtype=wp.uint8, device=device) for _ in range(2)
    )
    return Signal(flat, flat[:size].reshape(shape), touched, untouched)


@dataclass(frozen=True)
class BackgroundNodes:
    """Background of views on coarse grids of nodes."""

    sky_w_cm2: wp.array
    """Light of the sky in a pixel, (n_view, n_band, n_node)."""
    earth_km: wp.array
    """Height of the line of sight, and cosine of the Sun's zenith angle there, (n_view, 2, n_node)."""
    stray_w_cm2_sr: wp.array
    """Stray light, (n_view, n_band)."""


def new_background_nodes(scene: DeviceScene, n_view: int) -> BackgroundNodes:
    """Return room for the background of views."""
    assert scene.background is not None
    n_node = scene.background.n_node
    shapes = (
        (n_view, scene.n_band, n_node),
        (n_view, 2, n_node if scene.background.earth else 1),
        (n_view, scene.n_band),
    )
    return BackgroundNodes(*(wp.zeros(shape, dtype=wp.float32, device=scene.device) for shape in shapes))


def new_exposure(device: wp.Device, offset_s: npt.NDArray[np.float64], n_view: int) -> ExposureViews:
    """Return room for views at instants from the middle of the exposure [s], (n_path,)."""
    shape = (n_view, len(offset_s))
    return ExposureViews(
        wp.array(offset_s, dtype=wp.float64, device=device),
        wp.empty(shape, dtype=wp.float64, device=device),
        wp.empty(shape, dtype=wp.float64, device=device),
        wp.empty(shape, dtype=wp.uint32, device=device),
        wp.zeros(shape, dtype=View, device=device),
    )


@dataclass(frozen=True)
class RowViews:
    """The targets' own views, each at the time of its row, and paths of sources over the times of all rows."""

    sources: Any
    """The kernels' Sources, whose series alone is of its own."""
    time_s: wp.array
    """After the epoch, (n_view, n_target), one where there is no target; the others are of the same shape."""
    middle_s: wp.array
    """The frame's time."""
    sensor: wp.array
    views: wp.array
    """View records."""

    @property
    def arrays(self) -> list[wp.array]:
        """Arrays that take memory."""
        return [self.sources.offset_px, self.time_s, self.middle_s, self.sensor, self.views]


def new_row_views(scene: DeviceBodies, sources: Any) -> RowViews:
    """Return room for what rows of their own times take, beside sources."""
    device, shape = scene.device, (len(sources.n_source), max(scene.n_target, 1))
    window: Any = Sources()
    for name in SOURCE_ARRAYS:
        setattr(window, name, getattr(sources, name))
    window.offset_px = wp.empty(sources.offset_px.shape, dtype=wp.vec2, device=device)
    return RowViews(
        window,
        wp.zeros(shape, dtype=wp.float64, device=device),
        wp.zeros(shape, dtype=wp.float64, device=device),
        wp.zeros(shape, dtype=wp.uint32, device=device),
        wp.zeros(shape, dtype=View, device=device),
    )


def new_sources(scene: DeviceBodies, n_view: int, n_slot: int) -> Any:
    """Return uninitialised source lists of n_view views, as the kernels' struct."""
    device, n_path = scene.device, scene.streaks.n_path
    sources: Any = Sources()
    sources.n_source = wp.empty(n_view, dtype=wp.int32, device=device)
    sources.xy_px = wp.empty((n_view, n_slot), dtype=wp.vec2d, device=device)
    sources.irradiance_w_cm2 = wp.empty((n_view, scene.n_band, n_slot), dtype=wp.float32, device=device)
    sources.star = wp.empty((n_view, n_slot), dtype=wp.int32, device=device)
    sources.direction = wp.empty((n_view, n_slot if n_path else 0), dtype=wp.vec3d, device=device)
    sources.offset_px = wp.empty((n_view, n_slot, n_path), dtype=wp.vec2, device=device)
    return sources


def new_spots(scene: DeviceScene, n_view: int, n_slot: int) -> wp.array:
    """Return room for the spots of sources, (n_view, n_band, n_slot)."""
    return wp.empty((n_view, scene.n_band, n_slot), dtype=scene.psf.spots.Spot, device=scene.device)


def new_area_series(scene: DeviceBodies, n_view: int) -> wp.array:
    """Return room for how areas change: Legendre coefficients, (n_view, n_target + n_patch, N_TERM, n_profile)."""
    shape = (n_view, scene.n_target + scene.field.n_patch, N_TERM, scene.field.n_profile)
    return wp.empty(shape, dtype=wp.float64, device=scene.device)


def part_of_sources(sources: Any, first: int, end: int) -> Any:
    """Return the source lists of some consecutive views."""
    part: Any = Sources()
    for name in SOURCE_ARRAYS:
        array = getattr(sources, name)
        setattr(part, name, array[first:end] if array.size else array)  # Warp does not slice what is empty
    return part


def bytes_of(arrays: Iterable[wp.array]) -> int:
    """Return the memory of arrays [bytes]."""
    return sum(int(array.capacity) for array in arrays if array.size)
