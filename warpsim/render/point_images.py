"""Images of point sources and their derivatives, on a device, of arrays and of rendered views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.records import BEHIND

from warpsim.arrays import F64, I64
from warpsim.errors import InputError
from warpsim.launches import to_numpy
from warpsim.optics.psf_bank import PsfBank, paths_struct
from warpsim.render.batch import HostColumns, StarList, some_views
from warpsim.render.device import rows_per_block
from warpsim.render.device_scene import DeviceScene

MOST_VALUES = 2**27
"""Pixels of all windows of a Jacobian (4 GB)."""


EDGE_PX = 0.01
"""Margin of windows: the ends of stamps are found in float32, and sources stand on edges of pixels."""


@dataclass(frozen=True)
class Gathered:
    """Gradients by sources, for a cotangent of their images; float64."""

    by_light: F64
    """(n_view, n_band, n_slot)."""
    by_xy: F64
    """(n_view, n_band, n_slot, 2), per pixel."""
    by_sigma: F64
    """(n_view, n_band, n_slot), per pixel width; 0 unless asked for, and of patterns."""
    by_path: F64
    """By the Legendre coefficients of paths, (n_view, n_band, n_slot, n_path, 2), per pixel; no paths, none."""


@dataclass(frozen=True)
class JacobianStamps:
    """Derivatives of images by each source, where they are not 0: a window of pixels for every source.

    Windows are cut to the image. Sources that touch it nowhere have windows without pixels.
    """

    shape: tuple[int, int]
    """Rows and columns of an image."""
    view: I64
    """Number of the view of each window, (n,)."""
    band: I64
    """Number of its band."""
    source: I64
    """Number of its source in the view."""
    window: I64
    """First column, one past the last, first row, one past the last, (n, 4)."""
    first: I64
    """Row of values of its first pixel, (n,); pixels follow row by row."""
    values: F64
    """By light, x, y and sigma, of the pixels of all windows, (n_value, 4); sigma's are 0 for patterns."""

    def image(self, number: int) -> F64:
        """Values of a window as images, (4, n_row, n_col): by light, x, y and sigma."""
        left, right, top, bottom = self.window[number].tolist()
        n_pixel = (right - left) * (bottom - top)
        part = self.values[self.first[number] : self.first[number] + n_pixel]
        return np.moveaxis(part.reshape(bottom - top, right - left, 4), -1, 0)

    def matrix(self, view: int = 0, band: int = 0, by: Sequence[str] = ("x", "y", "light")) -> Any:
        """Return the Jacobian of one image as a sparse matrix (scipy, CSC), n_pixel rows.

        Args:
            view: Number of the view.
            band: Number of the band.
            by: Parameters, "light", "x", "y" or "sigma". Columns are parameter by parameter, and of each source by
                source, in the order of windows.
        """
        from scipy.sparse import csc_array

        numbers = np.flatnonzero((self.view == view) & (self.band == band)).tolist()
        pixels = [self._pixels(number) for number in numbers]
        columns = [PARAMETERS.index(name) for name in by]
        values = [self.values[self.first[n] : self.first[n] + len(own)] for n, own in zip(numbers, pixels, strict=True)]
        value = np.concatenate([*values, np.zeros((0, len(PARAMETERS)))])[:, columns].T.ravel()
        row = np.tile(np.concatenate([*pixels, np.zeros(0, np.int64)]), len(columns))
        length = np.tile([len(own) for own in pixels], len(columns))
        pointer = np.concatenate([[0], np.cumsum(length)]).astype(np.int64)
        return csc_array((value, row, pointer), shape=(self.shape[0] * self.shape[1], len(length)))

    def _pixels(self, number: int) -> I64:
        """Pixels of a window, counted along the rows of the image."""
        left, right, top, bottom = self.window[number].tolist()
        rows, columns = np.arange(top, bottom)[:, None], np.arange(left, right)
        return np.asarray((rows * self.shape[1] + columns).ravel())


PARAMETERS = ("light", "x", "y", "sigma")
"""Order of values of Jacobians."""


@dataclass(frozen=True)
class PointImages:
    """Sources on images, as the kernels take them.

    Gradients are those of the images that are drawn: of the same stamps, tables and nodes of streaks. Where a stamp
    ends, where the count of a streak's nodes changes, and between cells of tables they are one-sided.
    """

    bank: PsfBank
    sources: Sequence[wp.array]
    """n_source (n_view,), xy_px (n_view, n_slot), irradiance_w_cm2 (n_view, n_band, n_slot)."""
    rule: Any
    """StampRule."""
    shape: tuple[int, int]
    """Rows and columns of an image."""
    paths: Any = None
    """The kernels' Paths; None where nothing moves."""

    @property
    def device(self) -> wp.Device:
        """Where the sources are."""
        return self.sources[1].device

    @property
    def xy_px(self) -> F64:
        """Positions on the host, (n_view, n_slot, 2)."""
        return np.asarray(to_numpy(self.sources[1]).reshape(*self.sources[1].shape, 2))

    def of_view(self, view: int) -> PointImages:
        """Return the sources of one view."""
        lists, paths = [some_views(array, view, view + 1) for array in self.sources], None
        if self.paths is not None:
            offset_px, brightness = self.paths.offset_px, self.paths.brightness
            offset_px, brightness = (some_views(array, view, view + 1) for array in (offset_px, brightness))
            paths = paths_struct(offset_px, brightness, self.paths.n_target)
        return replace(self, sources=lists, paths=paths)

    def draw(self) -> wp.array:
        """Return the images, float32, (n_view, n_band, n_row, n_col)."""
        images = wp.zeros((*self.sources[2].shape[:2], *self.shape), dtype=wp.float32, device=self.device)
        n_row = rows_per_block(self.device, self.shape[0], images.shape[0] * images.shape[1])
        self.bank.deposit(self.sources, self.rule, n_row, images, self.paths).run()
        return images

    def gather(self, cotangent: wp.array, with_sigma: bool = False) -> list[wp.array]:
        """Return gradients by light, x, y and sigma, (n_view, n_band, n_slot) vec4d, and by the coefficients of paths.

        Args:
            cotangent: Derivatives of a number by the pixels, float32, (n_view, n_band, n_row, n_col).
            with_sigma: Whether Gaussians have gradients by sigma, which costs more.
        """
        shape, n_path = self.sources[2].shape, 0 if self.paths is None else self.paths.offset_px.shape[2]
        outputs = [wp.empty(shape, dtype=wp.vec4d, device=self.device)]
        outputs.append(wp.zeros((*shape, n_path), dtype=wp.vec2d, device=self.device))
        if outputs[0].size:
            self.bank.gather(self.sources, self.rule, cotangent, outputs, self.paths, with_sigma).run()
        return outputs

    def gathered(self, cotangent: npt.NDArray[np.float32], with_sigma: bool = False) -> Gathered:
        """Return the same on the host, for a cotangent there."""
        here = wp.array(np.ascontiguousarray(cotangent), dtype=wp.float32, device=self.device)
        both = self.gather(here, with_sigma)
        gradient, paths = (to_numpy(array).reshape(*array.shape, n) for array, n in zip(both, (4, 2), strict=True))
        return Gathered(gradient[..., 0], gradient[..., 1:3], gradient[..., 3], paths)

    def jacobian(self) -> JacobianStamps:
        """Return the derivatives of the images by each source.

        Raises:
            InputError: They would take more than 4 GB.
        """
        window = self._windows()
        n_pixel = (window[..., 1] - window[..., 0]) * (window[..., 3] - window[..., 2])
        n_source = to_numpy(self.sources[0])
        there = np.arange(window.shape[2]) < n_source[:, None, None]
        view, band, source = np.nonzero(np.broadcast_to(there, n_pixel.shape))
        window, n_pixel = window[view, band, source], n_pixel[view, band, source]
        n_value = int(n_pixel.sum())
        if n_value > MOST_VALUES:
            rule = f"stamps must have at most {MOST_VALUES} pixels in all; draw fewer sources or smaller stamps"
            raise InputError(rule, "jacobian", n_value)
        first = np.cumsum(n_pixel) - n_pixel
        values = wp.zeros(n_value, dtype=wp.vec4d, device=self.device)
        if n_value:
            item = np.stack([view, band, source], axis=1)
            kinds = ((item, wp.vec3i), (window, wp.vec4i), (first, wp.int64))
            given = [wp.array(np.ascontiguousarray(array), dtype=dtype, device=self.device) for array, dtype in kinds]
            size = wp.vec2i(self.shape[1], self.shape[0])
            self.bank.jacobian(self.sources, self.rule, [*given, size], values, self.paths).run()
        host = to_numpy(values).reshape(-1, 4)
        return JacobianStamps(self.shape, view, band, source, window, first, host)

    def _windows(self) -> I64:
        """Pixels that each stamp may touch, (n_view, n_band, n_slot, 4): first and end of columns, then of rows."""
        light = to_numpy(self.sources[2])
        n_view, n_band, n_slot = light.shape
        width_px = wp.empty((n_band, n_view * n_slot), dtype=wp.int32, device=self.device)
        by_band = np.ascontiguousarray(light.swapaxes(0, 1).reshape(n_band, -1))
        if by_band.size:
            strengths = wp.array(by_band, dtype=wp.float32, device=self.device)
            self.bank.size_stamps(strengths, self.rule, width_px)
        margin_px = to_numpy(width_px).reshape(n_band, n_view, n_slot).swapaxes(0, 1)[..., None].astype(np.float64)
        if self.paths is not None:
            moves = to_numpy(self.paths.offset_px).reshape(*self.paths.offset_px.shape, 2)
            margin_px = margin_px + np.abs(moves).sum(axis=2, dtype=np.float64)[:, None]
        middle = np.nan_to_num(self.xy_px, nan=-1e9)[:, None]
        low, high = touched_pixels(middle, margin_px + 0.5 + EDGE_PX, self.shape)
        return np.stack([low[..., 0], high[..., 0], low[..., 1], high[..., 1]], axis=-1)


def touched_pixels(middle_px: F64, half_px: F64, shape: tuple[int, int]) -> tuple[I64, I64]:
    """First pixels within so much of positions, and those past the last, cut to an image; (..., 2), column and row."""
    size = np.array(shape[::-1])
    low = np.clip(np.ceil(middle_px - half_px), 0, size).astype(np.int64)
    return low, np.clip(np.floor(middle_px + half_px) + 1, low, size).astype(np.int64)


def sources_of_views(scene: DeviceScene, seen: HostColumns, stars: Sequence[StarList] | None) -> PointImages:
    """Return the sources of views as they were drawn: targets, in their order, and stars behind them, if given.

    Paths of stars are straight: of these only the ends are kept. Their bend over an exposure is below 1e-3 px where
    cameras turn evenly.
    """
    camera, device = scene.instrument.sensor.camera, scene.device
    behind = (seen.observations["flags"] & int(BEHIND)) != 0
    n_view, n_target = behind.shape
    n_star = [len(one[0]) for one in stars] if stars else [0] * n_view
    n_slot = n_target + max(n_star, default=0)
    xy_px = np.full((n_view, n_slot, 2), -1e9)
    light = np.zeros((n_view, scene.n_band, n_slot), dtype=np.float32)
    offset_px = np.zeros((n_view, n_slot, scene.streaks.n_path, 2), dtype=np.float32)
    xy_px[:, :n_target], offset_px[:, :n_target] = seen.observations["xy_px"], seen.offset_px
    light[..., :n_target] = np.where(behind[:, None], np.float32(0.0), seen.irradiance_w_cm2)
    for view, (xy, moved, irradiance, _) in enumerate(stars or ()):
        own = slice(n_target, n_target + len(xy))
        xy_px[view, own], light[view, :, own] = xy, irradiance.T
        if scene.streaks.enabled:
            offset_px[view, own, 1] = 0.5 * moved
    given = ((np.array(n_star) + n_target, wp.int32), (xy_px, wp.vec2d), (light, wp.float32))
    lists = [wp.array(np.ascontiguousarray(values), dtype=dtype, device=device) for values, dtype in given]
    paths = None
    if scene.streaks.enabled:
        moving = wp.array(offset_px, dtype=wp.vec2, device=device)
        brightness = seen.columns.to(device).brightness
        assert brightness is not None
        paths = paths_struct(moving, brightness, n_target)
    return PointImages(scene.psf, lists, scene.stamp_rule, (camera.n_row, camera.n_col), paths)
