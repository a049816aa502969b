"""The label table: the truth of rendered images with what networks are trained on; tables as Parquet files."""

from __future__ import annotations

import importlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.arguments import above_zero
from warpsim.errors import InputError
from warpsim.files import plain_number, whole_file
from warpsim.labels.boxes import LEAST_BOX_PX, masks_to_rle, target_boxes
from warpsim.render.descriptions import DESCRIPTIONS, described
from warpsim.render.frameset import FrameSet

if TYPE_CHECKING:
    from astropy.table import Table

BOX_COLUMNS = ("box_x_px", "box_y_px", "box_w_px", "box_h_px")
"""A box as COCO has it."""

LEAST_NEI, LEAST_BOX = "LEAST_NEI", "LEAST_BOX_PX"
"""Keys of a label table's meta."""

META_KEY = b"warpsim"
"""Key of the file's metadata that holds the table's meta, as JSON."""


def write_parquet(table: Table, path: str | Path, meta: Mapping[str, Any] | None = None) -> None:
    """Write a table, whole or not at all; the same table gives the same bytes.

    Texts are coded by a dictionary, but for those of columns of Python objects. Each column carries its unit and what
    it means in the metadata of its field (keys `unit` and `description`); the table's meta is JSON in the file's
    metadata, key `warpsim`. Masked values are nulls.

    Args:
        table: Truth, stars, labels, or any table whose columns hold one number or text, or a fixed number of numbers.
        path: File to write; replaced if it is there.
        meta: Added to the table's meta; what JSON can hold.

    Raises:
        InputError: pyarrow is not installed, or a value of meta is nothing for JSON.
    """
    arrow, parquet = _pyarrow(path)
    fields, arrays = [], []
    for name in table.colnames:
        array = _array(arrow, table[name])
        arrays.append(array)
        fields.append(arrow.field(name, array.type, metadata=_field_meta(table[name])))
    try:
        text = json.dumps({**table.meta, **(meta or {})}, sort_keys=True, default=plain_number)
    except TypeError as error:
        raise InputError(str(error), "meta").of(path) from None
    schema = arrow.schema(fields, metadata={META_KEY: text.encode()})
    with whole_file(Path(path)) as partial:
        parquet.write_table(arrow.Table.from_arrays(arrays, schema=schema), partial, compression="zstd")


def read_parquet(path: str | Path) -> Table:
    """Read a table that `write_parquet` wrote, with units, descriptions and meta.

    Raises:
        InputError: pyarrow is not installed, or the file cannot be read.
    """
    from astropy.table import MaskedColumn, Table

    arrow, parquet = _pyarrow(path)
    try:
        source = parquet.read_table(Path(path))
    except (OSError, arrow.ArrowException) as error:
        raise InputError(f"cannot be read: {str(error).splitlines()[0]}").of(path) from None
    table = Table(meta=json.loads((source.schema.metadata or {}).get(META_KEY, b"{}")))
    for field, column in zip(source.schema, source.columns, strict=True):
        values, missing = _values(arrow, column.combine_chunks(), field.type)
        table[field.name] = MaskedColumn(values, mask=missing) if missing.any() else values
        meta = field.metadata or {}
        table[field.name].unit = meta[b"unit"].decode() if b"unit" in meta else None
        table[field.name].info.description = meta[b"description"].decode() if b"description" in meta else None
    return table


def _pyarrow(path: str | Path) -> tuple[Any, Any]:
    try:
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError:
        text = f"{path}: needs pyarrow, which the extra `parquet` brings: pip install 'warpsim[parquet]'"
        raise InputError(text) from None


def _array(arrow: Any, column: Any) -> Any:
    missing = np.ma.getmaskarray(column) if hasattr(column, "mask") else None
    values = np.asarray(column)
    if values.dtype.kind == "O":
        return arrow.array(values.tolist(), arrow.string(), mask=missing)
    if values.dtype.kind in "US":
        return arrow.array(values.astype(np.str_), arrow.string(), mask=missing).dictionary_encode()
    if values.dtype.byteorder == ">":  # tables that were read from FITS
        values = values.astype(values.dtype.newbyteorder("="))
    if values.ndim == 1:
        return arrow.array(values, mask=missing)
    flat = arrow.array(values.reshape(-1))
    return arrow.FixedSizeListArray.from_arrays(flat, int(np.prod(values.shape[1:])))


def _values(arrow: Any, array: Any, kind: Any) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Values of a column, of any kind where they are missing, and where they are."""
    missing = np.asarray(array.is_null())
    if arrow.types.is_fixed_size_list(kind):
        return np.asarray(array.flatten()).reshape(len(array), kind.list_size), missing
    if arrow.types.is_dictionary(kind):
        names = np.array([*array.dictionary.to_pylist(), ""], dtype=np.str_)  # the last one where it is missing
        return names[np.asarray(array.indices.fill_null(len(names) - 1))], missing
    if arrow.types.is_string(kind):
        return np.array(array.to_pylist(), dtype=object), missing
    if missing.any():
        array = array.fill_null(False if arrow.types.is_boolean(kind) else 0)
    return np.asarray(array), missing


def _field_meta(column: Any) -> dict[str, str]:
    meta = {}
    if column.unit is not None:
        meta["unit"] = str(column.unit)
    description = column.info.description or DESCRIPTIONS.get(column.info.name)
    if description:
        meta["description"] = str(description)
    return meta


def label_table(
    frames: FrameSet, least_nei: float = 1.0, with_masks: bool = False, least_box_px: float = LEAST_BOX_PX
) -> Table:
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
        least_box_px: Least width and height of a box [px] before the array's edge cuts it, which leaves a pixel or
            more; 1e-3 leaves boxes as narrow as the light.

    Returns:
        The table; its meta holds LEAST_NEI and LEAST_BOX_PX besides that of the truth.

    Raises:
        InputError: least_nei or least_box_px is not above 0, or masks are asked for without the extra `coco`
            (pycocotools).
    """
    least, least_px = above_zero("least_nei", least_nei), above_zero("least_box_px", least_box_px)
    table = frames.truth.copy()
    boxes = target_boxes(frames, least_px)
    visible = boxes.visible.ravel()
    table["visible"] = visible
    table["keypoint_visibility"] = keypoint_visibility(table, least)
    for name, values in zip(BOX_COLUMNS, boxes.box_px.reshape(-1, 4).T, strict=True):
        table[name] = np.ascontiguousarray(values)
        table[name].unit = "pix"
    if with_masks:
        table["mask_rle"] = target_masks(frames, boxes.visible, least).ravel()
    table.meta |= {LEAST_NEI: least, LEAST_BOX: least_px}
    return described(table)


def keypoint_visibility(table: Table, least_nei: float) -> npt.NDArray[np.uint8]:
    """Return COCO's visibility of the targets' centres, shape (n_row,).

    Where a background raises the noise of a pixel, light counts over that noise.
    """
    visible, in_fov = np.asarray(table["visible"]), np.asarray(table["in_fov"])
    noise_nei = np.asarray(table["noise_nei"]) if "noise_nei" in table.colnames else 1.0
    bright = in_fov & (np.asarray(table["snr_peak"]) >= least_nei * noise_nei)
    return np.where(visible, np.where(bright, 2, 1), 0).astype(np.uint8)


def target_masks(frames: FrameSet, requested: npt.NDArray[np.bool_], least_nei: float) -> npt.NDArray[np.object_]:
    """Return codes of the masks of the requested targets (view, band, target), '' where one reaches no pixel.

    A pixel belongs to a mask with least_nei NEI of the target's light. Codes are Python texts: in NumPy's every row
    would be as long as the longest.
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
