"""Masks as COCO's compressed run lengths.

Runs of pixels outside and inside take turns, beginning outside; pixels count down the columns, one column after the
other. From the fourth run on, the length of the last but one is taken away. Then each number is cut into groups of five
bits, the lowest first, with a sixth bit where another group follows; the highest bit of the last group is the sign. A
group is the letter 48 codes after it in ASCII. (The format of pycocotools; no code of theirs is used.)
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError

Ints = npt.NDArray[np.int64]


def mask_to_rle(mask: npt.ArrayLike) -> str:
    """Code of one mask.

    Args:
        mask: What is inside, shape (row, column).

    Returns:
        The `counts` of COCO's segmentation.

    Raises:
        InputError: The mask has not two axes, or is empty.
    """
    array = np.asarray(mask, dtype=bool)
    if array.ndim != 2 or array.size == 0:
        raise InputError("must have shape (row, column)", "mask", array.shape)
    return masks_to_rle(array[None], np.zeros((1, 2), dtype=np.int64), array.shape)[0]


def masks_to_rle(mask: npt.NDArray[np.bool_], origin_px: Ints, shape: tuple[int, ...]) -> list[str]:
    """Codes of many masks that are each inside a patch of the image.

    Args:
        mask: What is inside, in patches, shape (n, n_row_of_patch, n_col_of_patch).
        origin_px: Column and row of each patch's first pixel, shape (n, 2); patches lie within the image.
        shape: Rows and columns of the image.
    """
    if len(mask) == 0:
        return []
    owner, column, row = np.nonzero(mask.transpose(0, 2, 1))
    offset = (origin_px[owner, 0] + column) * shape[0] + origin_px[owner, 1] + row
    same = (owner[1:] == owner[:-1]) & (offset[1:] == offset[:-1] + 1)
    opens, closes = np.r_[True, ~same][: len(offset)], np.r_[~same, True][: len(offset)]
    start, end, owners = offset[opens], offset[closes] + 1, owner[opens]
    # Where runs end: each run outside at a start, each run inside at an end, and the last one outside at the image's.
    bound = np.concatenate([np.stack([start, end], axis=1).ravel(), np.full(len(mask), shape[0] * shape[1])])
    whose = np.concatenate([np.repeat(owners, 2), np.arange(len(mask))])
    order = np.argsort(whose, kind="stable")
    bound, whose = bound[order], whose[order]
    first = np.r_[True, whose[1:] != whose[:-1]]
    count = bound - np.where(first, 0, np.r_[0, bound[:-1]])
    last = np.r_[first[1:], True]
    kept = ~last | (count > 0) | first  # nothing lies behind a mask that ends with the image
    count, whose = count[kept], whose[kept]
    return _letters(count, whose, len(mask))


def _letters(count: Ints, whose: Ints, n_mask: int) -> list[str]:
    """Run lengths of several masks, one behind the other, as text."""
    run = np.arange(len(whose)) - np.searchsorted(whose, whose)  # within its mask
    number = count.copy()
    late = np.flatnonzero(run > 2)
    number[late] -= count[late - 2]
    n_letter = np.ones(len(number), dtype=np.int64)
    while (long := (number >> (5 * n_letter - 1) != 0) & (number >> (5 * n_letter - 1) != -1)).any():
        n_letter[long] += 1
    end = np.cumsum(n_letter)
    group = np.arange(end[-1]) - np.repeat(end - n_letter, n_letter)
    bits = (np.repeat(number, n_letter) >> (5 * group)) & 31
    more = group < np.repeat(n_letter, n_letter) - 1
    text = (bits + 32 * more + 48).astype(np.uint8).tobytes().decode("ascii")
    ends = end[np.searchsorted(whose, np.arange(n_mask), side="right") - 1].tolist()
    return [text[begin:stop] for begin, stop in zip([0, *ends[:-1]], ends, strict=True)]


def rle_to_mask(counts: str | bytes, shape: tuple[int, int]) -> npt.NDArray[np.bool_]:
    """The mask of a code; an empty code is an empty mask.

    Args:
        counts: COCO's compressed `counts`.
        shape: Rows and columns of the image.

    Returns:
        What is inside, shape (row, column).

    Raises:
        InputError: It is no such code, or of an image of another size.
    """
    runs = run_lengths(counts)
    if runs and sum(runs) != shape[0] * shape[1]:
        raise InputError(f"must be of {shape[0]} x {shape[1]} pixels, got {sum(runs)} pixels", "mask_rle")
    inside = np.zeros(shape[0] * shape[1], dtype=bool)
    end = 0
    for number, length in enumerate(runs):
        inside[end : end + length] = number % 2 == 1
        end += length
    return np.ascontiguousarray(inside.reshape(shape[1], shape[0]).T)


def rle_area(counts: str | bytes) -> int:
    """Pixels inside."""
    return sum(run_lengths(counts)[1::2])


def run_lengths(counts: Any) -> list[int]:
    """Lengths of the runs outside and inside, in turns.

    Raises:
        InputError: It is no such code.
    """
    letters = counts.encode("ascii", "replace") if isinstance(counts, str) else bytes(counts)
    runs: list[int] = []
    number = shift = 0
    for letter in letters:
        bits = letter - 48
        number |= (bits & 31) << shift
        shift += 5
        if bits & 32:
            continue
        if bits & 16:
            number -= 1 << shift
        runs.append(number + (runs[-2] if len(runs) > 2 else 0))
        number = shift = 0
    if shift or any(not 48 <= letter < 112 for letter in letters) or min(runs, default=0) < 0:
        raise InputError("must be COCO's compressed run lengths", "mask_rle", counts, ".60")
    return runs
