"""Common parts of all figures: axes, colours, files, texts, and labels that keep clear of one another."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.errors import InputError
from warpsim.files import whole_file
from warpsim.instant import Instant, instant_after

if TYPE_CHECKING:
    from matplotlib.axes import Axes

F64 = NDArray[np.float64]

FIGURE_SUFFIXES = (".png", ".pdf", ".svg")

# Okabe and Ito's palette, distinguishable with any colour vision.
BLUE, SKY_BLUE, GREEN, ORANGE, VERMILION, PURPLE, YELLOW = (
    "#0072B2", "#56B4E9", "#009E73", "#E69F00", "#D55E00", "#CC79A7", "#F0E442",
)  # fmt: skip
INK, GREY, FAINT = "0.15", "0.45", "0.75"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, SKY_BLUE, VERMILION, "0.3")
"""Colours of series, in this order; the fourth and later need more than colour to be distinguished in print."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "p")

MOST_LABELS = 40
"""More names than these are not written into a figure."""
N_PATH = 361
"""Points of a drawn path."""


def need_matplotlib(where: str) -> None:
    """Check that matplotlib is installed, before a figure is begun.

    Raises:
        InputError: matplotlib is not installed.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise InputError("needs matplotlib, which the extra `plot` brings: pip install 'warpsim[plot]'").of(where)


def new_axes(width: float, height: float) -> Axes:
    """Return the axes of a new pyplot figure [inch]."""
    need_matplotlib("plot")
    from matplotlib import pyplot as plt

    _, ax = plt.subplots(figsize=(width, height), layout="constrained")
    return ax


def save_figure(figure: Any, path: Path) -> None:
    """Write a figure, whole or not at all; the suffix says the format.

    The image is as large as what is drawn, and so holds titles and legends for which the layout found no room (it
    does not foresee axes that keep their proportions).
    """
    with whole_file(path) as partial:
        figure.savefig(partial, dpi=150, format=path.suffix[1:].lower(), bbox_inches="tight", pad_inches=0.08)


def annotate_points(ax: Axes, xy: ArrayLike, texts: Sequence[str], size: float = 8.0, **style: Any) -> list[Any]:
    """Write names beside points, each on the side where it covers the least of other names and points.

    The limits of the axes must be final. Sizes of texts are estimated, so that nothing needs to be drawn.

    Args:
        ax: Where to write.
        xy: Points in data coordinates, shape (n, 2).
        texts: A name for each.
        size: Of the letters [pt].
        style: Further arguments of `Axes.annotate`.
    """
    from matplotlib.patheffects import withStroke

    points = np.asarray(xy, np.float64).reshape(-1, 2)
    halo = [withStroke(linewidth=2, foreground="white", alpha=0.8)]
    ax.apply_aspect()
    per_px = 72 / ax.get_figure(root=True).dpi  # type: ignore[union-attr]
    anchors = ax.transData.transform(points) * per_px
    frame = np.asarray(ax.bbox.extents, np.float64) * per_px
    boxes: list[tuple[float, float, float, float]] = []
    written = []
    for anchor, point, text in zip(anchors, points, texts, strict=True):
        options = [_label_box(anchor, text, size, dx, dy) for dx, dy in _SIDES]
        costs = [_covered(box, boxes, anchors, frame) + 0.01 * number for number, (box, _) in enumerate(options)]
        box, offset = options[int(np.argmin(costs))]
        boxes.append(box)
        is_far = abs(offset[1]) > 1.8 * size  # a name that had to move away is joined to its point
        line = {"arrowstyle": "-", "color": FAINT, "linewidth": 0.6, "shrinkA": 0, "shrinkB": 2} if is_far else None
        written.append(
            ax.annotate(
                text, (point[0], point[1]), xytext=offset, textcoords="offset points", fontsize=size, va="center",
                ha="center", annotation_clip=True, arrowprops=line, path_effects=halo, **style,
            )
        )  # fmt: skip
    return written


_SIDES = (
    *((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)),
    *((0, 3), (0, -3), (1.3, 2.5), (-1.3, 2.5), (1.3, -2.5), (-1.3, -2.5), (1, 4), (-1, 4), (1, -4), (-1, -4)),
)
"""Where a label may stand about its point, in halves of its size; the first that is free is taken."""


def _label_box(
    anchor: F64, text: str, size: float, dx: float, dy: float
) -> tuple[tuple[float, float, float, float], tuple[float, float]]:
    """Left, bottom, right and top of a text on one side of a point, and the offset of its middle [pt]."""
    half_width, half_height = 0.29 * size * len(text), 0.55 * size
    offset = dx * (half_width + 7), dy * (half_height + 5)
    x, y = anchor[0] + offset[0], anchor[1] + offset[1]
    return (x - half_width, y - half_height, x + half_width, y + half_height), offset


def _covered(
    box: tuple[float, float, float, float], boxes: list[tuple[float, float, float, float]], points: F64, frame: F64
) -> float:
    """Area of other texts and points that a box covers [pt2]; a point counts 40, an end outside the axes 1000."""
    left, bottom, right, top = box
    margin = 3.0  # half a mark
    along, high = points.T
    hit = (along > left - margin) & (along < right + margin) & (high > bottom - margin) & (high < top + margin)
    outside = left < frame[0] or bottom < frame[1] or right > frame[2] or top > frame[3]
    cost = 40.0 * float(np.count_nonzero(hit)) + 1000.0 * outside
    for other in boxes:
        width, height = min(right, other[2]) - max(left, other[0]), min(top, other[3]) - max(bottom, other[1])
        cost += max(0.0, width) * max(0.0, height)
    return float(cost)


def pair(values: ArrayLike) -> tuple[float, float]:
    """Return two numbers as matplotlib's types want them."""
    x, y = np.asarray(values, np.float64)
    return float(x), float(y)


def plain(value: float, n_digit: int = 6) -> str:
    """Format a number to so many significant digits, without exponent and trailing zeros: 10800, 0.1667."""
    return np.format_float_positional(value, n_digit, unique=False, fractional=False, trim="-")


def utc_text(epoch: Instant, time_s: float) -> str:
    """Format an instant: 807.0 s (2025-01-01T14:13:27.000 UTC)."""
    return f"{time_s:.1f} s ({instant_after(epoch, time_s).isot} UTC)"


def checked_time_s(time_s: float, duration_s: float) -> float:
    """Return an instant of a scene [s after the epoch].

    Args:
        time_s: The instant.
        duration_s: Length of the scene [s].

    Raises:
        InputError: It is no number, or outside the scene.
    """
    if isinstance(time_s, bool) or not isinstance(time_s, int | float | np.number):
        raise InputError("must be a number", "time_s", time_s)
    if not 0 <= time_s <= duration_s:
        raise InputError(f"must be in the scene, 0 to {duration_s:g} s", "time_s", time_s, "g")
    return float(time_s)
