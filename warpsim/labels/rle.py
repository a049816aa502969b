"""Masks as COCO's compressed run lengths: pixels count down the columns, one column after the other (pycocotools)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError

Ints = npt.NDArray[np.int64]


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


def masks_to_rle(mask: npt.NDArray[np.bool_], origin_px: Ints, shape: tuple[int, ...]) -> list[str]:
    """Return codes of many masks that are each inside a patch of the image.

    Args:
        mask: What is inside, in patches, shape (n, n_row_of_patch, n_col_of_patch).
        origin_px: Column and row of each patch's first pixel, shape (n, 2); patches lie within the image.
        shape: Rows and columns of the image.
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
