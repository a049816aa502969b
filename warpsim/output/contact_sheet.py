"""The contact sheet: satellites down, time across, one band; a run at a glance (the paper's Fig. 9)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.detector.levels import Levels
from warpsim.output.formats import Images
from warpsim.output.grey import CEILING_NEI, grey, window_about
from warpsim.output.image_files import write_grey
from warpsim.scene.description import SceneDescription
from warpsim.scene.provenance import provenance

TILE_PX = 128
GAP_PX = 6
LEFT_PX = 76
TOP_PX = 58
N_COLUMN = 10

_PAPER = 24
_NO_ACCESS = 40
_INK = (0.85, 0.85, 0.85)
_FAINT = (0.45, 0.45, 0.45)

_LETTER_PX = (9, 7)  # width of a letter, of title and words
_MOST_ROOM_PX = 1400

_MARK = np.array([79, 209, 255], np.uint8)
_MARK_PX = (3.0, 1.5)  # a tick above a target, from and to so many pixels of the image

Planes = Callable[[Images, list[int]], npt.NDArray[np.uint16]]
"""(images of a sensor, frame numbers) -> counts, shape (n, n_row, n_col)."""

Positions = Callable[[Images, list[int]], list[npt.NDArray[np.float64]]]
"""(images of a sensor, frame numbers) -> columns and rows of the targets with light, each of shape (n, 2) [px]."""

Label = tuple[int, int, str, int, tuple[float, float, float]]
"""Where, what, its size and colour."""


def draw_contact_sheet(
    scene: SceneDescription, rows: Sequence[Images], planes: Planes, path: Path, positions_px: Positions | None = None
) -> None:
    """Draw a PNG of some frames of every sensor.

    Args:
        scene: The scene.
        rows: What is shown, sensor by sensor.
        planes: Reads images.
        path: File to write.
        positions_px: Where targets are; tiles then show the part of an image about them, with a tick above each. Whole
            images when left out.
    """
    times_s = np.unique(np.concatenate([row.instrument.frame_time_s(row.frames) for row in rows]))
    picks = np.linspace(0, len(times_s) - 1, min(N_COLUMN, len(times_s))).round().astype(int)
    columns = times_s[np.unique(picks)].tolist()  # evenly spread over the frames that any sensor has
    height = TOP_PX + len(rows) * (TILE_PX + GAP_PX)
    title = f"{scene.name}   {_bands_text(rows)}   {scene.epoch_utc} UTC"
    words = f"white: {CEILING_NEI:g} NEI, asinh scale, times after the epoch   behind: {scene.background.summary}"
    room = max(_LETTER_PX[0] * len(title), _LETTER_PX[1] * len(words))  # for words above a few tiles
    width = max(LEFT_PX + len(columns) * (TILE_PX + GAP_PX), 16 + min(room, _MOST_ROOM_PX))
    canvas = np.full((height, width, 3), _PAPER, dtype=np.uint8)
    labels: list[Label] = [(8, 20, title, 15, _INK), (8, 38, words, 13, _FAINT), (8, TOP_PX - 6, "t [s]", 13, _INK)]
    labels += [(_left(i), TOP_PX - 6, f"{time_s:.1f}", 13, _INK) for i, time_s in enumerate(columns)]
    for number, row in enumerate(rows):
        labels += _draw_row(canvas, TOP_PX + number * (TILE_PX + GAP_PX), row, columns, planes, positions_px)
    write_grey(path, _with_labels(canvas, labels), provenance(scene), settings={})


def _left(column: int) -> int:
    return LEFT_PX + column * (TILE_PX + GAP_PX)


def _bands_text(rows: Sequence[Images]) -> str:
    """Band shown, by kind of sensor if there are several."""
    bands = {row.instrument.sensor.name: row.band for row in rows}
    if len(set(bands.values())) == 1:
        return f"band {rows[0].band}"
    return ", ".join(f"{kind} band {band}" for kind, band in bands.items())


def _draw_row(
    canvas: npt.NDArray[np.uint8], top: int, row: Images, columns: Sequence[float], planes: Planes,
    positions_px: Positions | None,
) -> list[Label]:  # fmt: skip
    """Draw the tiles of a sensor; the labels that belong to them."""
    middle = top + TILE_PX // 2
    name, _, kind = row.sensor.partition(".")
    labels: list[Label] = [(8, middle, name, 15, _INK), *([(8, middle + 18, kind, 13, _FAINT)] if kind else [])]
    row_s = row.instrument.frame_time_s(row.frames)
    shown = _nearest(row_s, columns)
    tiles: dict[int, npt.NDArray[np.uint16]] = {}
    points: dict[int, npt.NDArray[np.float64]] = {}
    if shown:
        numbers = [row.frames[index] for index in shown.values()]
        tiles = dict(zip(shown, planes(row, numbers), strict=True))
        points = dict(zip(shown, positions_px(row, numbers), strict=True)) if positions_px else {}
    for column, time_s in enumerate(columns):
        left = _left(column)
        if column not in tiles:
            canvas[top : top + TILE_PX, left : left + TILE_PX] = _NO_ACCESS
            labels.append((left + 34, middle + 4, "no access", 12, _FAINT))
            continue
        levels = row.instrument.levels[row.band]
        if column in points:
            tile = _marked_tile(tiles[column], levels, points[column])
        else:
            tile = np.repeat(grey_tile(tiles[column], levels)[..., None], 3, axis=2)
        canvas[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
        own_s = row_s[shown[column]]
        if own_s != time_s:
            labels.append((left + 4, top + 14, f"{own_s:.1f} s", 11, _INK))
    return labels


def _marked_tile(counts: npt.NDArray[np.uint16], levels: Levels, xy_px: npt.NDArray[np.float64]) -> npt.NDArray[Any]:
    """Return the part of an image about the targets, with a tick above each, shape (h, w, 3)."""
    rows, columns = window_about(xy_px, counts.shape)
    part = grey(counts[rows, columns], levels, TILE_PX)
    per_px = TILE_PX / max(rows.stop - rows.start, columns.stop - columns.start)
    size = [min(TILE_PX, round(n * TILE_PX / max(part.shape))) for n in part.shape]
    near = np.ix_(*(np.arange(n) * length // n for n, length in zip(size, part.shape, strict=True)))
    tile = np.repeat(part[near][..., None], 3, axis=2)
    for x, y in (xy_px - (columns.start, rows.start) + 0.5) * per_px:
        top, bottom = (min(max(round(y - away_px * per_px), 0), size[0]) for away_px in _MARK_PX)
        if 0 <= x < size[1]:
            tile[top:bottom, int(x)] = _MARK
    return tile


def grey_tile(counts: npt.NDArray[np.uint16], levels: Levels) -> npt.NDArray[np.uint8]:
    """Return an image as a grey tile of at most TILE_PX pixels a side, shape (h, w).

    Large images are reduced by the brightest pixel of each block, so that no point source is lost; small ones are
    enlarged pixel by pixel. Black is blank sky, white CEILING_NEI.
    """
    shade = grey(counts, levels, TILE_PX)
    enlarge = max(1, TILE_PX // max(shade.shape))
    return np.repeat(np.repeat(shade, enlarge, axis=0), enlarge, axis=1)


def _nearest(time_s: npt.NDArray[np.float64], columns: Sequence[float]) -> dict[int, int]:
    """For each column, the index of the frame nearest to it, if it is within half the distance to the next column."""
    gaps = np.diff(columns) / 2 if len(columns) > 1 else np.array([0.5])
    shown = {}
    for i, column in enumerate(columns):
        nearest = int(np.argmin(np.abs(time_s - column)))
        away_s = time_s[nearest] - column
        if abs(away_s) <= gaps[min(i, len(gaps) - 1) if away_s >= 0 else max(i - 1, 0)]:
            shown[i] = nearest
    return shown


def _with_labels(canvas: npt.NDArray[np.uint8], labels: list[Label]) -> npt.NDArray[np.uint8]:
    import OpenImageIO as oiio

    height, width, _ = canvas.shape
    image = oiio.ImageBuf(oiio.ImageSpec(width, height, 3, "uint8"))
    image.set_pixels(oiio.ROI(0, width, 0, height, 0, 1, 0, 3), canvas)
    for x, y, text, size, colour in labels:
        # A missing font is no reason to lose the figure.
        oiio.ImageBufAlgo.render_text(image, x, y, text, size, "", colour)
    image.geterror()
    return np.asarray(image.get_pixels(oiio.UINT8))
