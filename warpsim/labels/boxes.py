"""Boxes about the targets of rendered images, and masks as COCO's compressed run lengths.

Pixels of a mask count down the columns, one column after the other (pycocotools).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64, I64
from warpsim.errors import InputError
from warpsim.legendre import series_at
from warpsim.render.frameset import FrameSet
from warpsim.render.resolution import blur_half_px

Bools = npt.NDArray[np.bool_]

LEAST_BOX_PX = 3.0
"""Of boxes, unless another size is asked for: some readers drop what is narrower than a pixel, silently."""

LEAST_CUT_PX = 1.0
"""A box that the array's edge cuts reaches at least so far inward."""

CORNER_PX = 0.5
"""Our pixel centres lie on whole numbers, COCO's pixel corners: its coordinates are larger by this."""

_STEPS_PER_TERM = 8
"""Instants at which a path is looked at, for each of its coefficients; between them goes a parabola."""

_VALUES_AT_A_TIME = 2_000_000
"""Of paths, to bound memory (16 MB per temporary)."""


class Boxes(NamedTuple):
    """Boxes of all targets in all images; the leading axes are (view, band, target), view = frame x sensor."""

    visible: Bools
    """The target gives light, and is on the array at some time of the exposure."""
    box_px: F64
    """x, y, width and height in COCO's coordinates [px]; NaN where not visible; shape (..., 4)."""


def target_boxes(frames: FrameSet, least_px: float) -> Boxes:
    """Return boxes that hold most of the light of each target.

    A box is the rectangle about the target's path from the start to the end of the exposure, wider on each side by half
    the box that holds BOX_FRACTION of a point's light, at least least_px wide and high, and cut at the array's edges.
    """
    light, camera = frames.target_light, frames.instrument.sensor.camera
    low_px, high_px, on_array = path_extent(frames)
    visible = (light.irradiance_w_cm2 != 0.0) & on_array[:, None]
    half_px = np.array([blur_half_px(frames.instrument, band) for band in frames.bands])
    size_px = np.array([camera.n_col, camera.n_row])
    box_px = box_around(low_px[:, None], high_px[:, None], half_px[:, None], size_px, least_px)
    return Boxes(visible, np.where(visible[..., None], box_px, np.nan))


def box_around(low_px: F64, high_px: F64, half_px: F64, size_px: I64, least_px: float) -> F64:
    """Return COCO's box of a path, (..., 2) as x and y, widened by half_px, to least_px if need be, and cut."""
    return cut_box(low_px - half_px + CORNER_PX, high_px + half_px + CORNER_PX, size_px, least_px)


def cut_box(left_top_px: F64, right_bottom_px: F64, size_px: I64, least_px: float) -> F64:
    """Return COCO's box between two corners, (..., 2) as x and y.

    It is widened about its centre to least_px, and cut at the array; what is left is at least LEAST_CUT_PX wide, or
    least_px if that is less.
    """
    wider_px = 0.5 * np.maximum(least_px - (right_bottom_px - left_top_px), 0.0)
    inward_px = np.minimum(min(least_px, LEAST_CUT_PX), size_px)
    left_top = np.clip(left_top_px - wider_px, 0.0, size_px - inward_px)
    right_bottom = np.clip(right_bottom_px + wider_px, inward_px, size_px)
    return np.concatenate([left_top, right_bottom - left_top], axis=-1)


def path_extent(frames: FrameSet) -> tuple[F64, F64, Bools]:
    """Return the lowest and highest x and y of paths, (view, target, 2), and whether any of it is on the array."""
    light, camera = frames.target_light, frames.instrument.sensor.camera
    n_view, n_target, n_term = light.offset_px.shape[:3]
    low_px, high_px = light.xy_px.copy(), light.xy_px.copy()
    on_array = _is_on(light.xy_px, camera.n_row, camera.n_col)
    t = np.linspace(-1.0, 1.0, _STEPS_PER_TERM * n_term + 1) if n_term else np.zeros(0)
    at_a_time = max(1, _VALUES_AT_A_TIME // max(1, 2 * n_target * len(t)))
    for first in range(0, n_view if n_term else 0, at_a_time):
        some = slice(first, first + at_a_time)
        series = np.moveaxis(light.offset_px[some].astype(np.float64), 2, -1)
        path_px = light.xy_px[some, ..., None] + series_at(series, t)  # (view, target, 2, instant)
        high_px[some], low_px[some] = _highest(path_px), -_highest(-path_px)
        on_array[some] |= _is_on(np.moveaxis(path_px, -1, 2), camera.n_row, camera.n_col).any(axis=2)
    return low_px, high_px, on_array & ~light.is_behind


def paths_px(frames: FrameSet, view: int) -> F64:
    """Return positions of the targets of a view from the start of the exposure to its end, (target, 2, instant)."""
    light = frames.target_light
    series = np.moveaxis(light.offset_px[view].astype(np.float64), 1, -1)
    t = np.linspace(-1.0, 1.0, _STEPS_PER_TERM * max(series.shape[-1], 1) + 1)
    if not series.shape[-1]:
        return np.repeat(light.xy_px[view][..., None], len(t), axis=-1)
    return np.asarray(light.xy_px[view][..., None] + series_at(series, t))


def _highest(values: F64) -> F64:
    """Highest value of curves that are known at even steps along the last axis."""
    top = values.argmax(axis=-1)[..., None]
    inner = np.clip(top, 1, values.shape[-1] - 2)
    before, here, after = (np.take_along_axis(values, inner + step, axis=-1)[..., 0] for step in (-1, 0, 1))
    curvature = before - 2.0 * here + after
    is_peak = (top[..., 0] == inner[..., 0]) & (curvature < 0.0)
    over = np.divide((after - before) ** 2, -8.0 * curvature, out=np.zeros_like(curvature), where=is_peak)
    return np.asarray(values.max(axis=-1) + over)


def _is_on(xy_px: F64, n_row: int, n_col: int) -> Bools:
    return np.asarray(((xy_px >= -0.5) & (xy_px < np.array([n_col, n_row]) - 0.5)).all(axis=-1))


def _coco() -> Any:
    try:
        from pycocotools import mask
    except ImportError:
        rule = "masks need pycocotools, which the extra `coco` brings: pip install 'warpsim[coco]'"
        raise InputError(rule) from None
    return mask


def mask_to_rle(mask: npt.ArrayLike) -> str:
    """Return the code of one mask.

    Args:
        mask: What is inside, shape (row, column).

    Returns:
        The `counts` of COCO's segmentation.

    Raises:
        InputError: The mask has not two axes, or is empty; or pycocotools is not installed.
    """
    array = np.asarray(mask, dtype=bool)
    if array.ndim != 2 or array.size == 0:
        raise InputError("must have shape (row, column)", "mask", array.shape)
    return str(_coco().encode(np.asfortranarray(array.astype(np.uint8)))["counts"].decode())


def masks_to_rle(mask: npt.NDArray[np.bool_], origin_px: I64, shape: tuple[int, ...]) -> list[str]:
    """Return codes of many masks that are each inside a patch (n, row, column) of an image of a shape (rows, columns).

    origin_px is column and row of each patch's first pixel, (n, 2); patches lie within the image.
    """
    runs = []
    for inside, (first_column, first_row) in zip(mask, origin_px.tolist(), strict=True):
        column, row = np.nonzero(inside.T)
        offset = (first_column + column) * shape[0] + first_row + row
        jumps = np.diff(offset, prepend=-2) > 1
        starts, ends = offset[jumps], offset[np.roll(jumps, -1)] + 1
        lengths = np.diff(np.stack([starts, ends], axis=1).ravel(), prepend=0, append=shape[0] * shape[1]).tolist()
        runs.append({"size": list(shape), "counts": lengths if lengths[-1] else lengths[:-1]})
    codes = _coco().frPyObjects(runs, *shape) if runs else []
    return [code["counts"].decode() for code in codes]


def rle_to_mask(counts: str | bytes, shape: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """Return the mask of a code; an empty code is an empty mask.

    Args:
        counts: COCO's compressed `counts`.
        shape: Rows and columns of the image.

    Returns:
        What is inside, shape (row, column).

    Raises:
        InputError: It is no such code, or of an image of another size; or pycocotools is not installed.
    """
    if not counts:
        return np.zeros(shape, dtype=bool)
    coco, text = _coco(), counts if isinstance(counts, bytes) else counts.encode("ascii", "replace")
    try:
        image = coco.decode({"size": list(shape), "counts": text})
        whole = coco.encode(image)["counts"] == text  # a code of another size leaves pixels unwritten
    except ValueError:
        whole = False
    if not whole:
        rule = f"must be COCO's compressed run lengths of {shape[0]} x {shape[1]} pixels"
        raise InputError(rule, "mask_rle", counts, ".60")
    return np.ascontiguousarray(image, dtype=bool)


def rle_area(counts: str | bytes, shape: tuple[int, int]) -> int:
    """Return the pixels inside."""
    return int(_coco().area({"size": list(shape), "counts": counts}))
