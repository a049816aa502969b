"""The contact sheet: satellites down, time across, one band; a run at a glance (the paper's Fig. 9)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.files import whole_file_by_memory
from warpsim.output.grey import CEILING_NEI, grey
from warpsim.scene.scene import Scene

TILE_PX = 128
GAP_PX = 6
LEFT_PX = 76
TOP_PX = 58
N_COLUMN = 10

_PAPER = 24
_NO_ACCESS = 40
_INK = (0.85, 0.85, 0.85)
_FAINT = (0.45, 0.45, 0.45)

Planes = Callable[[str, list[int]], npt.NDArray[np.uint16]]
"""(sensor, frame numbers) -> counts, shape (n, n_row, n_col)."""


def draw_contact_sheet(
    scene: Scene, band: str, frames_of: dict[str, list[int]], planes: Planes, path: Path
) -> None:
    """Draw a PNG of some frames of every sensor.

    Args:
        scene: The scene.
        band: Band that is shown.
        frames_of: Rendered frame numbers of each sensor.
        planes: Reads images.
        path: File to write.
    """
    sensors = [name for name, frames in frames_of.items() if frames]
    columns = _column_frames(frames_of)
    height = TOP_PX + max(1, len(sensors)) * (TILE_PX + GAP_PX)
    width = LEFT_PX + max(1, len(columns)) * (TILE_PX + GAP_PX)
    canvas = np.full((height, width, 3), _PAPER, dtype=np.uint8)
    labels: list[tuple[int, int, str, int, tuple[float, float, float]]] = [
        (8, 20, f"{scene.name}   band {band}   {scene.epoch_utc} UTC", 15, _INK),
        (8 + 440, 20, f"white: {CEILING_NEI:g} NEI, asinh scale, times after the epoch", 13, _FAINT),
        (8, TOP_PX - 6, "t [s]", 13, _INK),
    ]
    labels += [
        (LEFT_PX + i * (TILE_PX + GAP_PX), TOP_PX - 6, f"{scene.frame_time_s([frame])[0]:.1f}", 13, _INK)
        for i, frame in enumerate(columns)
    ]
    for row, sensor in enumerate(sensors):
        top = TOP_PX + row * (TILE_PX + GAP_PX)
        labels.append((8, top + TILE_PX // 2, sensor, 15, _INK))
        shown = _nearest_frames(frames_of[sensor], columns)
        images = dict(zip(shown, planes(sensor, list(shown.values())), strict=True)) if shown else {}
        for column, frame in enumerate(columns):
            left = LEFT_PX + column * (TILE_PX + GAP_PX)
            if frame not in images:
                canvas[top : top + TILE_PX, left : left + TILE_PX] = _NO_ACCESS
                labels.append((left + 34, top + TILE_PX // 2 + 4, "no access", 12, _FAINT))
                continue
            tile = grey_tile(images[frame], scene, band)
            canvas[top : top + tile.shape[0], left : left + tile.shape[1]] = tile[..., None]
            if shown[frame] != frame:
                labels.append((left + 4, top + 14, f"{scene.frame_time_s([shown[frame]])[0]:.1f} s", 11, _INK))
    _write_png(canvas, labels, path)


def grey_tile(counts: npt.NDArray[np.uint16], scene: Scene, band: str) -> npt.NDArray[np.uint8]:
    """An image as a grey tile of at most TILE_PX pixels a side, shape (h, w).

    Large images are reduced by the brightest pixel of each block, so that no point source is lost; small ones are
    enlarged pixel by pixel. Black is blank sky, white CEILING_NEI.
    """
    shade = grey(counts, scene.levels[band], TILE_PX)
    enlarge = max(1, TILE_PX // max(shade.shape))
    return np.repeat(np.repeat(shade, enlarge, axis=0), enlarge, axis=1)


def _column_frames(frames_of: dict[str, list[int]]) -> list[int]:
    """Frame numbers of the columns: evenly spread over all frames that any sensor has."""
    numbers = sorted({frame for frames in frames_of.values() for frame in frames})
    picks = np.linspace(0, len(numbers) - 1, min(N_COLUMN, len(numbers))).round().astype(int)
    return [numbers[i] for i in sorted(set(picks.tolist()))]


def _nearest_frames(frames: list[int], columns: list[int]) -> dict[int, int]:
    """For each column, the sensor's frame nearest to it, where one lies within half the way to the next column."""
    available = np.asarray(frames)
    gaps = np.diff(columns) / 2 if len(columns) > 1 else np.array([0.5])
    shown = {}
    for i, column in enumerate(columns):
        nearest = int(available[np.argmin(np.abs(available - column))])
        if abs(nearest - column) <= gaps[min(i, len(gaps) - 1) if nearest >= column else max(i - 1, 0)]:
            shown[column] = nearest
    return shown


def _write_png(canvas: npt.NDArray[np.uint8], labels: list[Any], path: Path) -> None:
    import OpenImageIO as oiio

    height, width, _ = canvas.shape
    image = oiio.ImageBuf(oiio.ImageSpec(width, height, 3, "uint8"))
    image.set_pixels(oiio.ROI(0, width, 0, height, 0, 1, 0, 3), canvas)
    for x, y, text, size, colour in labels:
        # A missing font is no reason to lose the picture.
        oiio.ImageBufAlgo.render_text(image, x, y, text, size, "", colour)
    image.geterror()
    with whole_file_by_memory(path) as name:
        if not image.write(name, "uint8", "png"):
            raise OSError(f"{path}: cannot be written: {image.geterror()}")
