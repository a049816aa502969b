"""Arrays that stages read and write: inputs and columns of views, sources, instants of the exposure, signal."""

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

from warpsim.launches import struct_of
from warpsim.render.batch import Columns, Inputs, new_columns, some_views

if TYPE_CHECKING:
    from warpsim.render.device_scene import DeviceBodies, DeviceScene

SOURCE_ARRAYS = ("n_source", "xy_px", "irradiance_w_cm2", "star", "direction", "offset_px")


@dataclass(frozen=True)
class TimedViews:
    """Views at times of their own; arrays of one shape, views first."""

    time_s: wp.array
    """After the epoch."""
    middle_s: wp.array
    """The frame's time."""
    sensor: wp.array
    views: wp.array
    """View records."""


@dataclass(frozen=True)
class ExposureViews(TimedViews):
    """Views at the instants of the exposure at which positions are found, (n_view, n_path)."""

    offset_s: wp.array
    """The instants, from the middle of the exposure [s], (n_path,)."""


@dataclass(frozen=True)
class RowViews(TimedViews):
    """The targets' own views, each at the time of its row, (n_view, n_target), one where there is no target."""

    sources: Any
    """The kernels' Sources, whose series alone is of its own: paths over the times of all rows."""


@dataclass(frozen=True)
class ViewArrays:
    """What the stages of views read and write."""

    inputs: Inputs
    columns: Columns
    sources: Any
    """The kernels' Sources."""
    area_series: wp.array
    """How areas change: Legendre coefficients, (n_view, n_target + n_patch, N_TERM, n_profile)."""
    exposure: ExposureViews | None
    """Where light moves."""
    rows: RowViews | None
    """Where rows have times of their own."""

    @property
    def arrays(self) -> list[wp.array]:
        """Arrays that take memory."""
        own = [*vars(self.inputs).values(), *self.columns.arrays, self.area_series]
        own += [getattr(self.sources, name) for name in SOURCE_ARRAYS]
        if self.exposure is not None:
            own += vars(self.exposure).values()
        if self.rows is not None:
            own += (vars(self.rows) | {"sources": self.rows.sources.offset_px}).values()
        return own


def new_view_arrays(scene: DeviceBodies, inputs: Inputs, n_slot: int, columns: Columns | None = None) -> ViewArrays:
    """Return arrays for views whose inputs are there, with source lists of n_slot."""
    n_view, device, streaks = len(inputs.frame), scene.device, scene.streaks
    sources = new_sources(scene, n_view, n_slot)
    return ViewArrays(
        inputs,
        new_columns(scene, n_view) if columns is None else columns,
        sources,
        new_area_series(scene, n_view),
        new_exposure(device, streaks.offset_s, n_view) if streaks.enabled else None,
        _new_rows(scene, sources) if streaks.rolls else None,
    )


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


def _timed(device: wp.Device, shape: tuple[int, int]) -> dict[str, wp.array]:
    """Arrays of TimedViews by name."""
    kinds = {"time_s": wp.float64, "middle_s": wp.float64, "sensor": wp.uint32, "views": View}
    return {name: wp.zeros(shape, dtype=dtype, device=device) for name, dtype in kinds.items()}


def new_exposure(device: wp.Device, offset_s: npt.NDArray[np.float64], n_view: int) -> ExposureViews:
    """Return room for views at instants from the middle of the exposure [s], (n_path,)."""
    instants = wp.array(offset_s, dtype=wp.float64, device=device)
    return ExposureViews(**_timed(device, (n_view, len(offset_s))), offset_s=instants)


def _new_rows(scene: DeviceBodies, sources: Any) -> RowViews:
    """Return room for what rows of their own times take, beside sources."""
    window = part_of_sources(sources, 0, len(sources.n_source))
    window.offset_px = wp.empty(sources.offset_px.shape, dtype=wp.vec2, device=scene.device)
    shape = (len(sources.n_source), max(scene.n_target, 1))
    return RowViews(**_timed(scene.device, shape), sources=window)


def new_sources(scene: DeviceBodies, n_view: int, n_slot: int) -> Any:
    """Return uninitialised source lists of n_view views, as the kernels' struct."""
    n_path = scene.streaks.n_path
    kinds: dict[str, tuple[tuple[int, ...], Any]] = {
        "n_source": ((n_view,), wp.int32),
        "xy_px": ((n_view, n_slot), wp.vec2d),
        "irradiance_w_cm2": ((n_view, scene.n_band, n_slot), wp.float32),
        "star": ((n_view, n_slot), wp.int32),
        "direction": ((n_view, n_slot if n_path else 0), wp.vec3d),
        "offset_px": ((n_view, n_slot, n_path), wp.vec2),
    }
    arrays = {name: wp.empty(shape, dtype=dtype, device=scene.device) for name, (shape, dtype) in kinds.items()}
    return struct_of(Sources, **arrays)


def new_spots(scene: DeviceScene, n_view: int, n_slot: int) -> wp.array:
    """Return room for the spots of sources, (n_view, n_band, n_slot)."""
    return wp.empty((n_view, scene.n_band, n_slot), dtype=scene.psf.spots.Spot, device=scene.device)


def new_area_series(scene: DeviceBodies, n_view: int) -> wp.array:
    """Return room for how areas change: Legendre coefficients, (n_view, n_target + n_patch, N_TERM, n_profile)."""
    shape = (n_view, scene.n_target + scene.field.n_patch, N_TERM, scene.field.n_profile)
    return wp.empty(shape, dtype=wp.float64, device=scene.device)


def part_of_sources(sources: Any, first: int, end: int) -> Any:
    """Return the source lists of some consecutive views."""
    return struct_of(Sources, **{name: some_views(getattr(sources, name), first, end) for name in SOURCE_ARRAYS})


def bytes_of(arrays: Iterable[wp.array]) -> int:
    """Return the memory of arrays [bytes]."""
    return sum(int(array.capacity) for array in arrays if array.size)
