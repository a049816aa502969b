"""Images with the labels of their targets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.arrays import F64
from warpsim.labels.boxes import CORNER_PX, paths_px, rle_to_mask
from warpsim.labels.table import BOX_COLUMNS, label_table
from warpsim.output.grey import CEILING_NEI, SOFTENING_NEI
from warpsim.plot.figure import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    VERMILION,
    YELLOW,
    legend_below,
    literal,
    new_axes,
    plain,
)
from warpsim.plot.image_figure import inset, set_frame

if TYPE_CHECKING:
    from astropy.table import Table
    from matplotlib.axes import Axes

    from warpsim.render.frameset import FrameSet

Mask = NDArray[np.bool_]
Paths = dict[str, F64]
"""Columns and rows of targets during the exposure by name [px]."""

_ON_BLACK = (ORANGE, SKY_BLUE, GREEN, YELLOW, PURPLE, VERMILION, BLUE)
_WIDE_PX = 500  # a pixel of the image is about one of the screen
_INSET_BELOW = 0.1  # of a wide field: targets in a smaller part are drawn a second time, enlarged
_LEAST_EXTENT_PX = 16.0  # of the part that is enlarged


def plot_labels(
    frames: FrameSet, frame: int, sensor: str, band: str, ax: Axes | None = None, least_nei: float = 1.0
) -> Axes:
    """Draw an image with the labels of its visible targets.

    Boxes are rectangles, masks the dotted edges of their pixels, centres crosses (slanted where the target's own
    pixel gets less than least_nei), and movement during the exposure a line. Axes are in pixels whose centres lie on
    whole numbers, row 0 on top; set their limits to look closer. Where the targets are in less than a tenth of an
    image of 500 pixels or more, that part is drawn a second time, enlarged.

    Args:
        frames: Rendered frames.
        frame: Number of the frame.
        sensor: Name of the sensor.
        band: Name of the band.
        ax: Where to draw.
        least_nei: Light of one target in one pixel that counts, over the NEI.

    Raises:
        InputError: The image was not rendered, or matplotlib is not installed.
    """
    frames.image_numbers("plot_labels", frame, sensor, band)
    ax = ax or new_axes(7.2, 7.4)
    scenario, instrument, row = frames.scenario, frames.instrument, frames.frames.index(frame)
    camera, levels = instrument.sensor.camera, instrument.levels[band]
    counts = frames.counts.numpy()[row, frames.sensors.index(sensor), frames.bands.index(band)]
    level_nei = (counts.astype(np.float32) - levels.blank_counts) / levels.counts_per_nei
    one = frames.one_frame(row)
    rows = label_table(one, least_nei, with_masks=True)
    paths = dict(zip(scenario.target_names, paths_px(one, frames.sensors.index(sensor)), strict=True))
    rows = rows[(rows["sensor"] == sensor) & (rows["band"] == band) & rows["visible"]]
    classes = list(dict.fromkeys(target.spec.class_name for target in scenario.targets))
    _draw_image(ax, level_nei, rows, paths, classes)
    set_frame(ax, camera)
    for number, name in enumerate(classes):
        if count := np.count_nonzero(rows["class"] == name):
            colour = _ON_BLACK[number % len(_ON_BLACK)]
            ax.plot([], [], "s", markerfacecolor="none", color=colour, label=f"{name} ({count})")
    if len(rows):
        xy_px = np.stack([np.asarray(rows[name], np.float64) for name in ("x_px", "y_px")], axis=1)
        spread_px = float((np.ptp(xy_px, axis=0) * [1, camera.pixel_aspect]).max())
        side_px = min(camera.n_col, camera.n_row * camera.pixel_aspect)
        if side_px >= _WIDE_PX and spread_px < _INSET_BELOW * side_px:
            detail = inset(ax, camera, xy_px, max(spread_px, _LEAST_EXTENT_PX))
            limits = detail.get_xlim(), detail.get_ylim()
            _draw_image(detail, level_nei, rows, paths, classes)
            detail.set(xlim=limits[0], ylim=limits[1], aspect=camera.pixel_aspect)
        legend_below(ax, -0.09, 4)
    ax.set_title(
        f"{literal(frames.scene.name)}: {sensor}, band {band}, frame {frame} at {plain(float(one.time_s[0]))} s\n"
        f"masks: at least {plain(least_nei, 3)} NEI of the target's own light; white: {CEILING_NEI:g} NEI",
        fontsize=10,
    )
    return ax


def _draw_image(ax: Axes, level_nei: Any, rows: Table, paths: Paths, classes: list[str]) -> None:
    """The image, and what is drawn about its targets."""
    from matplotlib.colors import AsinhNorm

    norm = AsinhNorm(SOFTENING_NEI, 0, CEILING_NEI)
    ax.imshow(level_nei, cmap="gray", norm=norm, origin="upper", interpolation="nearest")
    for number, name in enumerate(classes):
        of_class = rows[rows["class"] == name]
        if len(of_class):
            _draw_class(ax, of_class, paths, _ON_BLACK[number % len(_ON_BLACK)], level_nei.shape)


def _draw_class(ax: Axes, rows: Table, paths: Paths, colour: str, shape: tuple[int, int]) -> None:
    """Boxes, centres, movement and edges of the masks of targets."""
    from matplotlib.collections import LineCollection
    from matplotlib.patches import Rectangle

    edges: list[Any] = []
    for row in rows:
        x, y, width, height = (float(row[name]) for name in BOX_COLUMNS)
        box = Rectangle((x - CORNER_PX, y - CORNER_PX), width, height, fill=False, edgecolor=colour, linewidth=1.2)
        ax.add_patch(box)
        mark = "+" if row["keypoint_visibility"] == 2 else "x"
        ax.plot(row["x_px"], row["y_px"], mark, color=colour, markersize=6, markeredgewidth=0.8)
        ax.plot(*paths[row["target"]], color=colour, linewidth=0.7)
        edges += mask_edges(rle_to_mask(row["mask_rle"], shape)).tolist() if row["mask_rle"] else []
    ax.add_collection(LineCollection(edges, colors=colour, linewidths=0.9, linestyles="dotted"))


def mask_edges(mask: Mask) -> F64:
    """Return the edges between pixels inside and outside, as pairs of points (x, y), shape (n, 2, 2)."""
    padded = np.pad(mask, 1)
    row, column = np.nonzero(padded[:, 1:] != padded[:, :-1])
    upright = np.stack([column - 0.5, row - 1.5, column - 0.5, row - 0.5], axis=1)
    row, column = np.nonzero(padded[1:] != padded[:-1])
    level = np.stack([column - 1.5, row - 0.5, column - 0.5, row - 0.5], axis=1)
    return np.concatenate([upright, level]).reshape(-1, 2, 2)
