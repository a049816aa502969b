"""Recordings of the page: one HTML file with the scene in three dimensions and its images, or a film of the images."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.directions import normalised
from warpsim.errors import InputError
from warpsim.files import check_new_file, whole_file
from warpsim.live.globe import quaternion_wxyz
from warpsim.live.shown_images import ShownImage
from warpsim.live.view import View
from warpsim.output.grey import animation, check_preview, grey

TILE_PX = 256
"""Images are enlarged to about so many pixels a side."""

FPS = 10.0
"""Frames a second of recordings."""

_BOX = np.array([79, 209, 255], np.uint8)
_WALL = (17.0, 13.0)  # most width and height of the wall of images beside the Earth, 1000 km

Picture = npt.NDArray[np.uint8]


def record(
    view: View, path: str | os.PathLike[str], frames: Sequence[int], fps: float = FPS, overwrite: bool = False
) -> None:
    """Write what a page shows of some frames to a file, whole or not at all.

    Args:
        view: The page; what it shows otherwise in the meantime gets into the recording.
        path: .html: the Earth, bodies, lines of sight and a wall of images, which any browser plays without Python;
            .mp4 (extra `video`) or .gif: the images alone, with boxes.
        frames: Frame numbers.
        fps: Frames a second.
        overwrite: Whether an existing file is replaced.

    Raises:
        InputError: Another suffix, a rate out of range, no frames, or the path cannot be written.
    """
    path = Path(path)
    check_new_file(path, (".html", ".mp4", ".gif"), overwrite)
    if not frames:
        raise InputError("must be one or more", "frames", 0)
    if path.suffix.lower() != ".html":
        check_preview(path, fps)
        with animation(path, fps) as add:
            _play(view, frames, lambda picture: add(picture.max(axis=2)))
        return
    if not 0.1 <= fps <= 60:
        raise InputError("must be in [0.1, 60]", "fps", fps, "g")
    serializer = view.server.get_scene_serializer()
    wall = _Wall(view.server, np.array(view.server.initial_camera.position))

    def show(picture: Picture) -> None:
        wall.show(picture, f"{view.time_s:g} s: {', '.join(view.sensors)}")
        serializer.insert_sleep(1 / fps)

    _play(view, frames, show)
    wall.remove()
    with whole_file(path) as partial:
        partial.write_text(serializer.as_html(dark_mode=True))


def _play(view: View, frames: Sequence[int], add: Callable[[Picture], None]) -> None:
    size: tuple[int, ...] = ()
    for frame in frames:
        view.show(frame)
        picture = wall_of(view.shown, len(view.sensors))
        size = size or picture.shape
        add(picture)


class _Wall:
    """A picture beside the Earth, upright before the first camera."""

    def __init__(self, server: Any, camera: npt.NDArray[np.float64]) -> None:
        towards = normalised(camera)
        right = normalised(np.cross([0.0, 0.0, 1.0], towards))
        up = np.cross(towards, right)
        self._scene, self._right, self._up = server.scene, right, up
        self._wxyz = quaternion_wxyz(np.stack([right, -up, -towards], axis=1))
        self._image: Any = None
        self._caption: Any = None

    def show(self, picture: Picture, caption: str) -> None:
        shape = np.array(picture.shape[1::-1])
        width, height = shape * min(_WALL[0] / shape[0], _WALL[1] / shape[1])
        place = -self._right * (8.0 + width / 2)
        self._image = self._scene.add_image(
            "/images", picture, width, height, wxyz=self._wxyz, position=tuple(place), format="jpeg"
        )
        top = place + self._up * (0.6 + height / 2)
        if self._caption is None:
            self._caption = self._scene.add_label("/caption", caption, position=tuple(top), anchor="bottom-center")
        self._caption.text = caption

    def remove(self) -> None:
        if self._image is not None:
            self._image.remove()
            self._caption.remove()


def wall_of(images: Sequence[ShownImage], n_tile: int) -> Picture:
    """Return images in rows of up to three with boxes about the targets, RGB; grey where a sensor has none."""
    tiles = [_tile(image) for image in images] or [np.full((TILE_PX, TILE_PX, 3), 40, np.uint8)]
    n_col = min(3, n_tile)
    n_row = -(-n_tile // n_col)
    height, width = (max(tile.shape[axis] for tile in tiles) + 4 for axis in (0, 1))
    wall = np.full((n_row * height, n_col * width, 3), 40, np.uint8)
    for number, tile in enumerate(tiles):
        top, left = height * (number // n_col), width * (number % n_col)
        wall[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    return wall[: wall.shape[0] // 2 * 2, : wall.shape[1] // 2 * 2]  # films have even sizes


def _tile(image: ShownImage) -> Picture:
    picture = grey(image.counts, image.levels, TILE_PX)
    scale = max(TILE_PX // max(picture.shape), 1)
    tile = np.repeat(np.repeat(picture, scale, 0), scale, 1)[..., None] * np.ones(3, np.uint8)
    per_px = tile.shape[1] / image.counts.shape[1]
    for mark in image.marks:
        left, top, width, height = (np.array(mark.box_px) * per_px).round().astype(int)
        columns = np.clip((left, left + width), 0, tile.shape[1] - 1)
        rows = np.clip((top, top + height), 0, tile.shape[0] - 1)
        tile[rows[0] : rows[1] + 1, columns] = _BOX
        tile[rows, columns[0] : columns[1] + 1] = _BOX
    return tile
