"""The label table: the truth of rendered images with what networks are trained on beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from warpsim.arguments import above_zero
from warpsim.labels.boxes import target_boxes
from warpsim.labels.column_meanings import DESCRIPTIONS
from warpsim.labels.parquet import read_parquet as read_parquet
from warpsim.labels.parquet import write_parquet as write_parquet
from warpsim.labels.rle import masks_to_rle
from warpsim.render.frameset import FrameSet

if TYPE_CHECKING:
    from astropy.table import Table

BOX_COLUMNS = ("box_x_px", "box_y_px", "box_w_px", "box_h_px")
"""A box as COCO has it."""

LEAST_NEI = "LEAST_NEI"
"""Key of a label table's meta."""


def label_table(frames: FrameSet, least_nei: float = 1.0, with_masks: bool = False) -> Table:
    """Return truth and labels, one row per frame x sensor x band x target, as in `frames.truth`.

    Besides the columns of the truth: visible (it gives light, and is on the array at some time of the exposure),
    keypoint_visibility (2: its own pixel gets at least least_nei times the NEI of its light; 1: visible, but less or
    off the array; 0: not visible), box_x_px, box_y_px, box_w_px, box_h_px (COCO's coordinates, in which pixel edges lie
    on whole numbers; NaN where not visible) and, with masks, mask_rle (COCO's compressed run lengths of the pixels that
    get least_nei times the NEI of its light, '' if none).

    Args:
        frames: Rendered frames.
        least_nei: Light of one target in one pixel that counts, over the NEI.
        with_masks: Whether masks are drawn.

    Returns:
        The table; its meta holds SCENE and LEAST_NEI.

    Raises:
        InputError: least_nei is not above 0, or masks are asked for without the extra `coco` (pycocotools).
    """
    least = above_zero("least_nei", least_nei)
    table = frames.truth.copy()
    boxes = target_boxes(frames)
    visible = boxes.visible.ravel()
    table["visible"] = visible
    table["keypoint_visibility"] = keypoint_visibility(table, least)
    for name, values in zip(BOX_COLUMNS, boxes.box_px.reshape(-1, 4).T, strict=True):
        table[name] = np.ascontiguousarray(values)
        table[name].unit = "pix"
    if with_masks:
        table["mask_rle"] = target_masks(frames, boxes.visible, least).ravel()
    table.meta |= {"SCENE": frames.scene.name, LEAST_NEI: least}
    for name in table.colnames:
        table[name].info.description = DESCRIPTIONS[name]
    return table


def keypoint_visibility(table: Table, least_nei: float) -> npt.NDArray[np.uint8]:
    """Return COCO's visibility of the targets' centres, shape (n_row,).

    Where a background raises the noise of a pixel, light counts over that noise.
    """
    visible, in_fov = np.asarray(table["visible"]), np.asarray(table["in_fov"])
    noise_nei = np.asarray(table["noise_nei"]) if "noise_nei" in table.colnames else 1.0
    bright = in_fov & (np.asarray(table["snr_peak"]) >= least_nei * noise_nei)
    return np.where(visible, np.where(bright, 2, 1), 0).astype(np.uint8)


def target_masks(frames: FrameSet, requested: npt.NDArray[np.bool_], least_nei: float) -> npt.NDArray[np.object_]:
    """Return codes of the targets' masks, '' where a target is not requested or reaches no pixel.

    They are Python texts: in NumPy's every row would be as long as the longest.

    Args:
        frames: Rendered frames.
        requested: Targets to draw, shape (view, band, target).
        least_nei: Light of the target in a pixel of its mask, over the NEI.
    """
    light = frames.target_light
    codes = np.full(requested.shape, "", dtype=object)
    for number, band in enumerate(frames.bands):
        least_w_cm2 = least_nei * frames.instrument.nei_w_cm2(band)
        view, target = np.nonzero(requested[:, number])
        for patches in light.patches(number, view, target, least_w_cm2):
            mask = patches.light_w_cm2 >= least_w_cm2
            (some,) = np.nonzero(mask.any(axis=(1, 2)))
            which = patches.number[some]
            codes[view[which], number, target[which]] = masks_to_rle(mask[some], patches.origin_px[some], light.shape)
    return codes
