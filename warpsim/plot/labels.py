"""Figure of an image with the labels of its targets: boxes, centres, paths and the edges of their masks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.labels.boxes import CORNER_PX, paths_px
from warpsim.labels.rle import rle_to_mask
from warpsim.labels.table import BOX_COLUMNS, label_table
from warpsim.plot.figure import BLUE, GREEN, ORANGE, PURPLE, SKY_BLUE, VERMILION, YELLOW, new_axes, plain

if TYPE_CHECKING:
    from astropy.table import Table
    from matplotlib.axes import Axes

    from warpsim.render.frameset import FrameSet

F64 = npt.NDArray[np.float64]

WHITE_NEI = 60.0
SOFTENING_NEI = 2.0
"""Grey is linear below, logarithmic above, as in contact sheets."""

_ON_BLACK = (ORANGE, SKY_BLUE, GREEN, YELLOW, PURPLE, VERMILION, BLUE)


def plot_labels(
    frames: FrameSet, frame: int, sensor: str, band: str, ax: Axes | None = None, least_nei: float = 1.0
) -> Axes:
    """Draw an image with the labels of its visible targets.

    Boxes are rectangles, masks the dotted edges of their pixels, centres crosses (slanted where the target's own
    pixel gets less than least_nei), and movement during the exposure a line. Axes are in pixels whose centres lie on
    whole numbers, row 0 on top; set their limits to look closer.

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
    level = (counts.astype(np.float32) - levels.blank_counts) / levels.counts_per_nei
    shade = np.arcsinh(np.maximum(level, 0) / SOFTENING_NEI) / np.arcsinh(WHITE_NEI / SOFTENING_NEI)
    ax.imshow(shade, cmap="gray", vmin=0, vmax=1, origin="upper", interpolation="nearest", aspect=camera.pixel_aspect)
    one = frames.one_frame(row)
    rows = label_table(one, least_nei, with_masks=True)
    paths = dict(zip(scenario.target_names, paths_px(one, frames.sensors.index(sensor)), strict=True))
    rows = rows[(rows["sensor"] == sensor) & (rows["band"] == band) & rows["visible"]]
    classes = list(dict.fromkeys(target.spec.class_name for target in scenario.targets))
    for number, name in enumerate(classes):
        of_class = rows[rows["class"] == name]
        if len(of_class):
            colour = _ON_BLACK[number % len(_ON_BLACK)]
            _draw_class(ax, of_class, paths, colour, (camera.n_row, camera.n_col))
            ax.plot([], [], "s", markerfacecolor="none", color=colour, label=f"{name} ({len(of_class)})")
    right, bottom = camera.n_col - 0.5, camera.n_row - 0.5
    ax.set(xlim=(-0.5, right), ylim=(bottom, -0.5), xlabel="column [px]", ylabel="row [px]")
    time_s = float(one.time_s[0])
    ax.set_title(
        f"{frames.scene.name}: {sensor}, band {band}, frame {frame} at {plain(time_s)} s\n"
        f"masks: at least {plain(least_nei, 3)} NEI of the target's own light; white: {WHITE_NEI:g} NEI",
        fontsize=10,
    )
    if len(rows):
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.09), ncols=4, fontsize=8, frameon=False)
    return ax


def _draw_class(ax: Axes, rows: Table, paths: dict[str, F64], colour: str, shape: tuple[int, int]) -> None:
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


def mask_edges(mask: npt.NDArray[np.bool_]) -> F64:
    """Return the edges between pixels inside and outside, as pairs of points (x, y), shape (n, 2, 2)."""
    padded = np.pad(mask, 1)
    row, column = np.nonzero(padded[:, 1:] != padded[:, :-1])
    upright = np.stack([column - 0.5, row - 1.5, column - 0.5, row - 0.5], axis=1)
    row, column = np.nonzero(padded[1:] != padded[:-1])
    level = np.stack([column - 1.5, row - 0.5, column - 0.5, row - 0.5], axis=1)
    return np.concatenate([upright, level]).reshape(-1, 2, 2)
