"""Light of each target alone: the images of a frame set once more, every target on a separate plane.

A plane is drawn as the image was: by the same kernel, from the same numbers, with the same stamps and streaks. So the
planes of all targets, and the stars, add up to the noiseless image. Where only pixels above some level are required,
a plane is a patch about the target, which is far smaller than the image.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.records import BEHIND

from warpsim.arrays import F64, I64
from warpsim.launches import to_numpy
from warpsim.optics.psf_bank import paths_struct, rule_of_band, stamp_rule
from warpsim.render.batch import HostColumns
from warpsim.render.device_scene import DeviceScene
from warpsim.render.point_images import PointImages, touched_pixels

F32 = npt.NDArray[np.float32]

CHUNK_BYTES = 32 * 2**20
"""Planes drawn at a time, at least one."""

LEAST_SIDE_PX = 8
"""Smallest side of a patch; the sides of larger ones are powers of two, so that few shapes serve all targets."""

MOST_TARGETS = 2**16 - 1
"""Targets that a mask can distinguish."""


@dataclass(frozen=True)
class Patches:
    """Planes of some targets, each cut out about its target."""

    number: I64
    """Number among the requested targets, shape (n,)."""
    origin_px: I64
    """Column and row of the first pixel on the array, shape (n, 2); patches lie within the array."""
    light_w_cm2: F32
    """Light of the target alone, shape (n, n_row, n_col)."""


class TargetLight:
    """Draws targets of rendered views, each alone."""

    def __init__(self, scene: DeviceScene, seen: HostColumns, shape: tuple[int, int]) -> None:
        self._device_scene, self.shape = scene, shape
        self.xy_px: F64 = np.ascontiguousarray(seen.observations["xy_px"])
        """Position in the middle of the exposure, shape (n_view, n_target, 2)."""
        self.irradiance_w_cm2: F32 = seen.irradiance_w_cm2
        """Shape (n_view, n_band, n_target)."""
        self.offset_px: F32 = seen.offset_px
        """Movement about that position: Legendre coefficients, shape (n_view, n_target, n_path, 2)."""
        self.is_behind: npt.NDArray[np.bool_] = (seen.observations["flags"] & int(BEHIND)) != 0
        """Whether the target is behind the camera, shape (n_view, n_target)."""
        self._brightness: F32 = seen.brightness

    def planes(
        self, band: int, view: Sequence[int] | I64, target: Sequence[int] | I64, origin_px: I64, shape: Any
    ) -> F32:
        """Planes of targets in one launch, shape (n, *shape).

        Args:
            band: Index of the band in the images.
            view: Number of the view of each plane, shape (n,).
            target: Number of its target, shape (n,).
            origin_px: Column and row at which each plane begins, shape (n, 2).
            shape: Rows and columns of every plane.
        """
        scene, n_plane = self._device_scene, len(view)
        if n_plane == 0:
            return np.zeros((0, *shape), dtype=np.float32)

        def upload(values: Any, dtype: Any) -> wp.array:
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=scene.device)

        sources = [
            wp.full(n_plane, 1, dtype=wp.int32, device=scene.device),
            upload((self.xy_px[view, target] - origin_px)[:, None], wp.vec2d),
            upload(self.irradiance_w_cm2[view, band, target][:, None, None], wp.float32),
        ]
        paths = None
        if scene.streaks.enabled:
            moving = upload(self.offset_px[view, target][:, None], wp.vec2)
            brightness = upload(self._brightness[view, band, target][:, None, None], wp.float32)
            paths = paths_struct(moving, brightness, n_target=1)
        rule = rule_of_band(scene.stamp_rule, band)
        return to_numpy(PointImages(scene.psf.of_band(band), sources, rule, shape, paths).draw())[:, 0]

    def contributions(self, band: int, view: int, chunk_bytes: int = CHUNK_BYTES) -> F32:
        """Light of every target over a whole image, shape (n_target, n_row, n_col)."""
        n_target = self.xy_px.shape[1]
        light = np.zeros((n_target, *self.shape), dtype=np.float32)
        bright = np.flatnonzero(self.irradiance_w_cm2[view, band])
        at_a_time = max(1, chunk_bytes // (4 * self.shape[0] * self.shape[1]))
        for first in range(0, len(bright), at_a_time):
            target = bright[first : first + at_a_time]
            origin_px = np.zeros((len(target), 2), dtype=np.int64)
            light[target] = self.planes(band, np.full(len(target), view), target, origin_px, self.shape)
        return light

    def patches(
        self, band: int, view: I64, target: I64, least_w_cm2: float, chunk_bytes: int = CHUNK_BYTES
    ) -> Iterator[Patches]:
        """Planes of targets, cut to where a pixel may hold a given light; targets that reach no pixel are left out.

        Args:
            band: Index of the band in the images.
            view: Number of the view of each target asked for, shape (n,).
            target: Its number, shape (n,).
            least_w_cm2: Pixels outside a patch hold less than this of the target's light.
            chunk_bytes: Light drawn at a time; at least one patch.
        """
        low, high = self._windows(band, view, target, least_w_cm2)
        (number,) = np.nonzero((high > low).all(axis=1))
        n_px = np.array(self.shape[::-1])
        side = np.maximum(high[number] - low[number], LEAST_SIDE_PX)
        side = np.minimum(2 ** np.ceil(np.log2(side)).astype(np.int64), n_px)
        origin_px = np.minimum(low[number], n_px - side)
        for n_col, n_row in np.unique(side, axis=0).tolist():
            (alike,) = np.nonzero((side == (n_col, n_row)).all(axis=1))
            at_a_time = max(1, chunk_bytes // (4 * n_row * n_col))
            for first in range(0, len(alike), at_a_time):
                some = alike[first : first + at_a_time]
                which = number[some]
                light = self.planes(band, view[which], target[which], origin_px[some], (n_row, n_col))
                yield Patches(which, origin_px[some], light)

    def _windows(self, band: int, view: I64, target: I64, least_w_cm2: float) -> tuple[I64, I64]:
        """First pixels, and those past the last, that may hold least_w_cm2 of a target; (n, 2), column and row."""
        light = self.irradiance_w_cm2[view, band, target]
        has_light = (light != 0.0) & ~self.is_behind[view, target]
        margin_px = np.abs(self.offset_px[view, target]).sum(axis=1, dtype=np.float64)
        margin_px = margin_px + self._reach_px(light, band, least_w_cm2)[:, None]
        middle = np.where(has_light[:, None], self.xy_px[view, target], -1e9)
        return touched_pixels(middle, np.where(has_light[:, None], margin_px, 0.0) + 0.5, self.shape)

    def _reach_px(self, irradiance_w_cm2: F32, band: int, least_w_cm2: float) -> npt.NDArray[np.int32]:
        """Largest distance from a target at which pixels may hold least_w_cm2, shape (n,): as stamps are sized."""
        scene, n = self._device_scene, len(irradiance_w_cm2)
        if n == 0:
            return np.zeros(0, dtype=np.int32)
        light = wp.array(irradiance_w_cm2[None], dtype=wp.float32, device=scene.device)
        reach_px = wp.empty((1, n), dtype=wp.int32, device=scene.device)
        scene.psf.of_band(band).size_stamps(light, stamp_rule([least_w_cm2], 0.0, scene.device), reach_px)
        return np.asarray(to_numpy(reach_px)[0])


def brightest_targets(light: TargetLight, band: int, views: I64, least_w_cm2: float) -> npt.NDArray[np.uint16]:
    """Number, from 1, of the target that gives most of a pixel's light, 0 where none gives least_w_cm2.

    Args:
        light: Of the targets.
        band: Index of the band in the images.
        views: Numbers of views, shape (n,).
        least_w_cm2: Light in a pixel that counts.

    Returns:
        Shape (n, n_row, n_col); of equals the first target is taken.
    """
    n_target = light.xy_px.shape[1]
    image, target = (part.ravel() for part in np.indices((len(views), n_target)))
    most = np.zeros((len(views), *light.shape), dtype=np.float32)
    mask = np.zeros(most.shape, dtype=np.uint16)
    for patches in light.patches(band, views[image], target, least_w_cm2):
        n_row, n_col = patches.light_w_cm2.shape[1:]
        bright = patches.light_w_cm2 >= least_w_cm2
        some = bright.any(axis=(1, 2))
        for number, (column, row), plane, enough in zip(
            patches.number[some].tolist(),
            patches.origin_px[some].tolist(),
            patches.light_w_cm2[some],
            bright[some],
            strict=True,
        ):
            part = image[number], slice(row, row + n_row), slice(column, column + n_col)
            label = target[number] + 1
            more = enough & ((plane > most[part]) | ((plane == most[part]) & (label < mask[part])))
            most[part][more], mask[part][more] = plane[more], label
    return mask
