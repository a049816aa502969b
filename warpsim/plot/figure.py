"""Common parts of all figures: axes, colours, texts, names that keep clear of one another, kinds of targets, the Earth.

matplotlib's own axes in three dimensions have no depth test. Here everything is projected straight onto a plane
(orthographically), and lines are cut where they pass behind the limb of the WGS84 ellipsoid.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.arrays import F64
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M
from warpsim.directions import normalised, perpendicular, unit_vectors
from warpsim.errors import InputError, printable_lines
from warpsim.files import whole_file
from warpsim.instant import Instant
from warpsim.orbit.earth import EARTH_POLAR_RADIUS_M, geodetic_to_gcrs_m
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario

if TYPE_CHECKING:
    from matplotlib.axes import Axes


FIGURE_SUFFIXES = (".png", ".pdf", ".svg")

# Okabe and Ito's palette, distinguishable with any colour vision.
BLUE, SKY_BLUE, GREEN, ORANGE, VERMILION, PURPLE, YELLOW = (
    "#0072B2", "#56B4E9", "#009E73", "#E69F00", "#D55E00", "#CC79A7", "#F0E442",
)  # fmt: skip
INK, GREY, PALE, FAINT = "0.15", "0.45", "0.6", "0.75"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, SKY_BLUE, VERMILION, "0.3")
"""Colours of series, in this order; the fourth and later need more than colour to be distinguished in print."""
DASHES = ("-", "--", ":", "-.")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "p")

MOST_LABELS = 40
"""More names than these are not written into a figure."""
N_PATH = 361
"""Points of a drawn path."""

_SIDES = np.array([
    *((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)),
    *((0, 3), (0, -3), (1.3, 2.5), (-1.3, 2.5), (1.3, -2.5), (-1.3, -2.5), (1, 4), (-1, 4), (1, -4), (-1, -4)),
])  # fmt: skip
"""Where a label may stand about its point, in halves of its size; the first that is free is taken."""

SCALE_M = 1e6
"""Drawn as one: the axes are in thousands of km."""

_STRETCH = EARTH_EQUATORIAL_RADIUS_M / EARTH_POLAR_RADIUS_M
_N_SHADE = 241  # pixels across the shaded disc
_DAY, _NIGHT = np.array([0.87, 0.93, 0.98]), np.array([0.55, 0.60, 0.68])


def need_matplotlib(where: str) -> None:
    """Raise an InputError about `where` if matplotlib is not installed."""
    if importlib.util.find_spec("matplotlib") is None:
        raise InputError("needs matplotlib, which the extra `plot` brings: pip install 'warpsim[plot]'").of(where)


def new_axes(width: float, height: float, n_row: int = 1, n_col: int = 1) -> Any:
    """Return the axes of a new pyplot figure [inch]; an array of them for several."""
    need_matplotlib("plot")
    from matplotlib import pyplot as plt

    return plt.subplots(n_row, n_col, figsize=(width, height), layout="constrained")[1]


def save_figure(figure: Any, path: Path) -> None:
    """Write a figure, whole or not at all; the suffix says the format.

    The image is as large as what is drawn, and so holds titles and legends for which the layout found no room (it
    does not foresee axes that keep their proportions).
    """
    with whole_file(path) as partial:
        figure.savefig(partial, dpi=150, format=path.suffix[1:].lower(), bbox_inches="tight", pad_inches=0.08)


def legend_below(ax: Axes, y: float, ncols: int) -> None:
    """Draw a legend of some columns below the axes, at a height in axes' heights."""
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, y), ncols=ncols, fontsize=8, frameon=False)


def draw_arrow(ax: Axes, begin: ArrayLike, end: ArrayLike, zorder: float, **style: Any) -> None:
    """Draw an arrow between points in data coordinates, in a style of `FancyArrowPatch`."""
    ax.annotate("", pair(end), pair(begin), arrowprops=style, zorder=zorder)


def annotate_points(ax: Axes, xy: ArrayLike, texts: Sequence[str], size: float = 8.0, **style: Any) -> list[Any]:
    """Write names beside points (n, 2), each on the side where it covers the least of other names and points.

    The limits of the axes must be final. Sizes of texts are estimated, so that nothing needs to be drawn.
    """
    from matplotlib.patheffects import withStroke

    points = np.asarray(xy, np.float64).reshape(-1, 2)
    halo = [withStroke(linewidth=2, foreground="white", alpha=0.8)]
    ax.apply_aspect()
    pt_per_px = 72 / ax.get_figure(root=True).dpi  # type: ignore[union-attr]
    anchors = ax.transData.transform(points) * pt_per_px
    frame = np.asarray(ax.bbox.extents, np.float64) * pt_per_px
    lows, highs = np.empty((0, 2)), np.empty((0, 2))  # of the texts written so far
    written = []
    for anchor, point, text in zip(anchors, points, texts, strict=True):
        half = size * np.array([0.29 * len(text), 0.55])
        offset = _SIDES * (half + np.array([7.0, 5.0]))
        low, high = anchor + offset - half, anchor + offset + half
        margin = 3.0  # half a mark
        n_hit = ((anchors > low[:, None] - margin) & (anchors < high[:, None] + margin)).all(axis=2).sum(axis=1)
        outside = ((low < frame[:2]) | (high > frame[2:])).any(axis=1)
        common = np.maximum(np.minimum(high[:, None], highs) - np.maximum(low[:, None], lows), 0).prod(axis=2)
        # Points and the edge count as areas of text [pt2].
        best = np.argmin(40.0 * n_hit + 1000.0 * outside + common.sum(axis=1) + 0.01 * np.arange(len(_SIDES)))
        lows, highs = np.vstack([lows, low[best]]), np.vstack([highs, high[best]])
        is_far = abs(offset[best, 1]) > 1.8 * size  # a name that had to move away is joined to its point
        line = {"arrowstyle": "-", "color": FAINT, "linewidth": 0.6, "shrinkA": 0, "shrinkB": 2} if is_far else None
        written.append(
            ax.annotate(
                text, pair(point), xytext=pair(offset[best]), textcoords="offset points", fontsize=size, va="center",
                ha="center", annotation_clip=True, arrowprops=line, path_effects=halo, **style,
            )
        )  # fmt: skip
    return written


def pair(values: ArrayLike) -> tuple[float, float]:
    """Return two numbers as matplotlib's types want them."""
    x, y = np.asarray(values, np.float64)
    return float(x), float(y)


def literal(name: str) -> str:
    """Return a name as matplotlib draws it letter by letter: no formula begins at a dollar sign."""
    return printable_lines(name).replace("$", r"\$")


def plain(value: float, n_digit: int = 6) -> str:
    """Format a number to so many significant digits, without exponent and trailing zeros: 10800, 0.1667."""
    return np.format_float_positional(value, n_digit, unique=False, fractional=False, trim="-")


def checked_time_s(time_s: float, duration_s: float) -> float:
    """Return an instant of a scene of some length [s after the epoch]; an InputError if it is none."""
    if isinstance(time_s, bool) or not isinstance(time_s, int | float | np.number):
        raise InputError("must be a number", "time_s", time_s)
    if not 0 <= time_s <= duration_s:
        raise InputError(f"must be in the scene, 0 to {duration_s:g} s", "time_s", time_s, "g")
    return float(time_s)


@dataclass(frozen=True)
class TargetKind:
    """Targets of one entry of a group; a main target is a kind of its own."""

    number: int
    """Counts through all groups."""
    name: str
    group: int
    targets: list[int]
    is_main: bool
    """Whether it is the main target of its group, which the others leave."""

    @property
    def label(self) -> str:
        """Name, and how many there are."""
        return self.name if len(self.targets) == 1 else f"{self.name} ({len(self.targets)})"

    @property
    def colour(self) -> str:
        """Colour; the first kind is vermilion, which no other is."""
        others = [colour for colour in SERIES if colour != VERMILION]
        return VERMILION if self.number == 0 else others[(self.number - 1) % len(others)]

    @property
    def style(self) -> dict[str, Any]:
        """Mark and colour as arguments of `Axes.plot`; main targets are stars."""
        if self.is_main:
            mark = {"marker": "*", "markersize": 13, "markeredgecolor": INK, "zorder": 5}
        else:
            mark = {"marker": MARKERS[(self.number - 1) % len(MARKERS)], "markersize": 5.5, "markeredgecolor": "white",
                    "markeredgewidth": 0.4, "zorder": 3}  # fmt: skip
        return {"linestyle": "none", "color": self.colour, **mark}


def target_kinds(scenario: Scenario) -> list[TargetKind]:
    """Return the kinds of targets of all groups, in the order of the targets."""
    members: dict[tuple[int, int], list[int]] = {}
    for index, target in enumerate(scenario.targets):
        members.setdefault((target.group, target.entry), []).append(index)
    kinds = []
    for number, ((group, entry), targets) in enumerate(members.items()):
        config = scenario.scene.groups[group]
        is_main = entry == 0 and config.orbits is None
        kinds.append(TargetKind(number, config.targets[entry].name, group, targets, is_main))
    return kinds


def counted_targets(instrument: Instrument, sensor: int, time_s: float) -> Sequence[int]:
    """Return the targets that a sensor's access counts by at a time; none before the first step of its program."""
    begun = [targets for start_s, targets in instrument.access_targets(sensor) if start_s <= time_s]
    return begun[-1] if begun else ()


def observed_targets(scenario: Scenario, instrument: Instrument, sensor: int, time_s: float) -> list[int]:
    """Return the targets at the ends of a sensor's lines of sight while it has access.

    They are those that its access counts by and that it can observe: the ones that are on the paths of their groups;
    one of the others where it can observe none of these.
    """
    counted = counted_targets(instrument, sensor, time_s)
    if len(counted) < 2:
        return list(counted)
    can_observe = instrument.can_observe([sensor], np.array([time_s]))[0, 0]
    seen = [target for target in counted if can_observe[target]]
    leading = [target for target in seen if not scenario.targets[target].is_released]
    return leading or seen[:1] or list(counted[:1])  # at the very end of an access none may be left


def stretched(vectors: ArrayLike, pole: F64) -> F64:
    """Return vectors (..., 3) in axes stretched along the pole, in which the WGS84 ellipsoid is a sphere."""
    array = np.asarray(vectors, np.float64)
    return np.asarray(array + (array @ pole)[..., None] * pole * (_STRETCH - 1))


@dataclass(frozen=True)
class Globe:
    """A direction from which the Earth is seen, from infinitely far; unit vectors (3,) in GCRS axes."""

    towards: F64
    """From the Earth to the viewer."""
    up: F64
    """Upwards in the drawn plane, perpendicular to towards."""
    pole: F64
    """Axis of the ellipsoid."""

    @property
    def right(self) -> F64:
        """Unit vector to the right in the drawn plane, shape (3,)."""
        return np.asarray(np.cross(self.up, self.towards))

    def project(self, position_m: ArrayLike) -> F64:
        """Return points of the drawn plane [1000 km], shape (..., 2), of positions [m], shape (..., 3)."""
        return np.asarray(np.asarray(position_m, np.float64) @ np.stack([self.right, self.up], axis=1) / SCALE_M)

    def is_hidden(self, position_m: ArrayLike, on_surface: bool = False) -> NDArray[np.bool_]:
        """Return whether the Earth hides positions [m] of shape (..., 3); on its surface their side decides."""
        point, ahead = stretched(position_m, self.pole), normalised(stretched(self.towards, self.pole))
        along = point @ ahead
        across2 = np.sum(point * point, axis=-1) - along * along
        return np.asarray((along < 0) & (on_surface | (across2 < EARTH_EQUATORIAL_RADIUS_M**2)))

    def visible_line(self, path_m: F64, on_surface: bool = False) -> F64:
        """Return the visible parts of a path (n, 3) on the drawn plane [1000 km], shape (m, 2); NaN between them."""
        hidden = self.is_hidden(path_m, on_surface)
        change = np.flatnonzero(hidden[1:] != hidden[:-1])
        start, step = path_m[change], path_m[change + 1] - path_m[change]
        low, high = np.zeros(len(change)), np.ones(len(change))
        for _ in range(40):  # to 1e-12 of a step
            middle = 0.5 * (low + high)
            same = self.is_hidden(start + middle[:, None] * step, on_surface) == hidden[change]
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        limb = self.project(start + low[:, None] * step)
        drawn = self.project(path_m)
        drawn[hidden] = np.nan
        # Each crossing adds the point on the limb; the hidden side of it is NaN already.
        return np.asarray(np.insert(drawn, change + 1, limb, axis=0))

    def limb(self) -> F64:
        """Return the limb of the Earth on the drawn plane [1000 km], shape (N_PATH, 2)."""
        ahead = normalised(stretched(self.towards, self.pole))
        first = normalised(perpendicular(ahead))
        turn = np.linspace(0, 2 * np.pi, N_PATH)[:, None]
        circle = EARTH_EQUATORIAL_RADIUS_M * (np.cos(turn) * first + np.sin(turn) * np.cross(ahead, first))
        return self.project(circle + (circle @ self.pole)[:, None] * self.pole * (1 / _STRETCH - 1))

    def normals(self, xy: F64) -> F64:
        """Return unit normals of the surface at points of the drawn plane [1000 km], (..., 2); NaN beside the disc."""
        origin = SCALE_M * (xy[..., :1] * self.right + xy[..., 1:] * self.up)
        point, ahead = stretched(origin, self.pole), stretched(self.towards, self.pole)
        a, b = ahead @ ahead, point @ ahead
        c = np.sum(point * point, axis=-1) - EARTH_EQUATORIAL_RADIUS_M**2
        root = np.sqrt(np.where(b * b >= a * c, b * b - a * c, np.nan))
        # The gradient of |stretched position|2 stretches the pole's part a second time.
        return normalised(stretched(point + ((root - b) / a)[..., None] * ahead, self.pole))


def globe_from(ra_deg: float, dec_deg: float, pole: F64) -> Globe:
    """Return the Earth seen from a direction, with its pole upwards; an InputError if it is no direction."""
    if not (np.isfinite(ra_deg) and abs(dec_deg) <= 90):
        raise InputError(f"must be a right ascension and a declination, got {ra_deg}, {dec_deg}", "view_ra_dec_deg")
    towards = unit_vectors(ra_deg, dec_deg)
    up = pole - (pole @ towards) * towards
    if np.linalg.norm(up) < 1e-6:  # seen along the pole: what lies at the right ascension points downwards
        up = -unit_vectors(ra_deg, 0.0)
        up = up - (up @ towards) * towards
    return Globe(towards, normalised(up), pole)


def draw_earth(ax: Axes, globe: Globe, sun_m: F64, epoch: Instant, time_s: float) -> None:
    """Draw the Earth at an instant: day and night side, meridians and parallels every 30 degrees, the limb."""
    from matplotlib.patches import Polygon

    limb = globe.limb()
    half = 1.01 * np.abs(limb).max(axis=0)
    x, y = (np.linspace(-extent, extent, _N_SHADE) for extent in half)
    points = np.stack(np.meshgrid(x, y), axis=-1)
    # Points beside the disc take the colour of its edge, so that none shines through where it is cut out.
    beyond = np.linalg.norm(points, axis=-1, keepdims=True) / (0.999 * EARTH_POLAR_RADIUS_M / SCALE_M)
    points /= np.maximum(1, beyond)
    sunlight = globe.normals(points) @ normalised(sun_m)
    # A smooth step some 12 degrees wide about the terminator, where the Sun is low or twilight.
    day = np.clip(0.5 + 0.5 * sunlight / 0.1, 0, 1)[..., None]
    colours, extent = day * _DAY + (1 - day) * _NIGHT, (-half[0], half[0], -half[1], half[1])
    image = ax.imshow(colours, origin="lower", extent=extent, interpolation="bilinear", zorder=0.5)
    image.set_clip_path(Polygon(limb, closed=True, transform=ax.transData))
    along_deg, up_deg = np.linspace(-180, 180, 181), np.linspace(-90, 90, 91)
    parallels = [(along_deg, np.full_like(along_deg, latitude)) for latitude in range(-60, 61, 30)]
    meridians = [(np.full_like(up_deg, longitude), up_deg) for longitude in range(-180, 180, 30)]
    for lon_deg, lat_deg in parallels + meridians:
        line = globe.visible_line(geodetic_to_gcrs_m(lon_deg, lat_deg, 0.0, epoch, time_s), on_surface=True)
        ax.plot(*line.T, color="white", linewidth=0.6, zorder=0.6)
    ax.plot(*limb.T, color="0.3", linewidth=0.9, zorder=0.7)
