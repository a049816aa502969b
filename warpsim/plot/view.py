"""Figure of the geometry of a sensor's view: targets, stars, the Earth's limb, zenith and north.

Positions are those of the renderer itself, so the figure agrees with the rendered frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.plot.camera_view import CameraView, camera_view, earth_clearance, sensor_index
from warpsim.plot.drawn_targets import TargetKind, counted_targets, observed_targets, target_kinds
from warpsim.plot.figure import (
    BLUE,
    GREEN,
    GREY,
    INK,
    MOST_LABELS,
    PURPLE,
    SKY_BLUE,
    annotate_points,
    new_axes,
    pair,
    plain,
)
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from warpsim.render.renderer import Renderer

F64 = NDArray[np.float64]

VIEW_INCH = (7.4, 7.9)
"""Size of a figure for `plot_satellite_view`: room for a legend of three rows below a square."""

_WORD_PT = 8.0  # letters of the compass
_N_GRID = 129  # points across the field at which the Earth is looked for
_INSET_BELOW = 0.2  # of the field: a smaller group is drawn a second time, enlarged


def plot_satellite_view(
    scene: Scene | Scenario, sensor: str, time_s: float, ax: Axes | None = None, renderer: Renderer | None = None
) -> Axes:
    """Draw the geometry of a sensor's view: targets and stars at their pixels, the Earth, zenith and north.

    Positions are apparent, with light time and aberration: those of the rendered frame. A group that is small in the
    field is drawn a second time, enlarged and with names. Targets that are not deployed or absent are left out: they
    give no light.

    Args:
        scene: The scene.
        sensor: Name of the sensor.
        time_s: The instant [s after the epoch].
        ax: Where to draw; in pixels, row 0 on top.
        renderer: Of this scene, to use its catalog and kernels again.

    Raises:
        InputError: No such sensor, or the instant is outside the scene.
    """
    scenario = scenario_of(scene)
    view = camera_view(scenario, sensor, time_s, renderer)
    kinds, camera = target_kinds(scenario), view.camera
    ax = ax or new_axes(*VIEW_INCH)
    right, bottom = camera.n_col - 0.5, camera.n_row - 0.5
    ax.set(xlim=(-0.5, right), ylim=(bottom, -0.5), aspect=camera.pixel_aspect, xlabel="column [px]", ylabel="row [px]")
    _draw_limb(ax, view, scenario.tracks.pole_icrs)
    _draw_stars(ax, view)
    _draw_targets(ax, view, kinds, with_labels=True)
    _draw_compass(ax, view)
    in_field = view.target_xy_px[view.shown]
    extent_px = float((np.ptp(in_field, axis=0) * [1, camera.pixel_aspect]).max()) if len(in_field) > 1 else 0.0
    detail = ax
    if 0 < extent_px < _INSET_BELOW * view.short_side_px:
        detail = _inset(ax, view, in_field, extent_px)
        _draw_targets(detail, view, kinds, with_labels=False)
    _name_targets(detail, view, scenario.target_names)
    ax.set_title(
        f"{scenario.scene.name}: {sensor} at {plain(time_s)} s, {_range_words(scenario, sensor, float(time_s))}\n"
        f"field of {camera.field_deg[0]:.3g} deg across",
        fontsize=10,
    )
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.09), ncols=3, fontsize=8, frameon=False)
    return ax


def _range_words(scenario: Scenario, sensor: str, time_s: float) -> str:
    """Range of a target that access counts by, of one that the sensor can observe if there is one; and the access."""
    instrument, index = sensor_index(scenario, sensor)
    at = np.array([time_s])
    if instrument.has_access(index, at)[0]:
        words, targets = "access", observed_targets(scenario, instrument, index, time_s)
    else:
        words, targets = "no access", list(counted_targets(instrument, index, time_s))
    there = [target for target in targets if scenario.tracks.exist(target, at)[0]]
    if not there:
        return words
    line_m = scenario.tracks.target_state(there[0], at)[0] - scenario.position_m(sensor, at)
    return f"{np.linalg.norm(line_m) / 1e3:.0f} km from {scenario.target_names[there[0]]}, {words}"


def _draw_stars(ax: Axes, view: CameraView) -> None:
    inside = view.in_frame(view.star_xy_px)
    if not inside.any():
        return
    size = np.clip(6 + 9 * np.log10(np.maximum(view.star_snr[inside], 0.1)), 3, 60)
    x, y = view.star_xy_px[inside].T
    ax.scatter(x, y, s=size, marker="o", facecolors="none", edgecolors=GREY, linewidths=0.9,
               label=f"stars ({np.count_nonzero(inside)}), by brightness", zorder=2)  # fmt: skip


def _draw_targets(ax: Axes, view: CameraView, kinds: Sequence[TargetKind], with_labels: bool) -> None:
    """Marks of the targets in the frame by kind; those behind the Earth are crosses."""
    shown, inside = view.shown, view.in_frame(view.target_xy_px)
    for kind in kinds:
        chosen = np.array(kind.targets)[shown[kind.targets]]
        if len(chosen):
            part = len(chosen) < len(kind.targets)
            label = f"{kind.name} ({len(chosen)} of {len(kind.targets)})" if part else kind.label
            ax.plot(*view.target_xy_px[chosen].T, label=label if with_labels else None, **kind.style)
    hidden = view.occulted & ~view.not_deployed & ~view.absent & inside
    if hidden.any():
        ax.plot(*view.target_xy_px[hidden].T, "x", color=GREY, markersize=5,
                label=f"behind the Earth ({np.count_nonzero(hidden)})" if with_labels else None)  # fmt: skip
    for words, left_out in (("not deployed", view.not_deployed & ~view.absent), ("absent", view.absent)):
        if with_labels and left_out.any():
            ax.plot([], [], " ", label=f"{words}, not drawn ({np.count_nonzero(left_out)})")


def _name_targets(ax: Axes, view: CameraView, names: Sequence[str]) -> None:
    shown = np.flatnonzero(view.shown)
    if len(shown) <= MOST_LABELS:
        texts = [names[int(number)] for number in shown]
        annotate_points(ax, view.target_xy_px[shown], texts, size=6.2, color=INK, zorder=2.5)


def _inset(ax: Axes, view: CameraView, in_field: F64, extent_px: float) -> Any:
    """Axes that enlarge the group, in the corner that it leaves free; extent_px counts in widths of a pixel."""
    middle = in_field.min(axis=0) / 2 + in_field.max(axis=0) / 2
    aspect = view.camera.pixel_aspect
    low, high = (middle + sign * 0.66 * extent_px / np.array([1.0, aspect]) for sign in (-1, 1))
    corner_y = 0.05 if middle[1] < (view.camera.n_row - 1) / 2 else 0.58
    inset: Any = ax.inset_axes((0.58, corner_y, 0.4, 0.4))
    inset.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]), aspect=aspect)
    inset.tick_params(labelsize=7)
    ax.indicate_inset_zoom(inset, edgecolor=INK, alpha=0.6)
    return inset


def _draw_limb(ax: Axes, view: CameraView, pole: F64) -> None:
    """The Earth's disc and its limb, where they are in the field."""
    n_row, n_col = view.camera.n_row, view.camera.n_col
    x, y = np.linspace(-0.5, n_col - 0.5, _N_GRID), np.linspace(-0.5, n_row - 0.5, _N_GRID)
    clearance = earth_clearance(view, pole, np.stack(np.meshgrid(x, y), axis=-1))
    if clearance.min() >= 0:
        return
    ax.contourf(x, y, clearance, levels=[-1.0, 0.0], colors=[SKY_BLUE], alpha=0.35, zorder=0.5)
    if clearance.max() > 0:
        ax.contour(x, y, clearance, levels=[0.0], colors=[BLUE], linewidths=1.2, zorder=1)
    ax.plot([], [], "s", color=SKY_BLUE, alpha=0.35, markeredgecolor=BLUE, markersize=9, label="Earth")


def _draw_compass(ax: Axes, view: CameraView) -> None:
    """Arrows to the sensor's zenith and to celestial north, from a corner."""
    n, per_width = view.short_side_px, np.array([1.0, 1.0 / view.camera.pixel_aspect])  # pixels in a pixel's width
    ax.apply_aspect()
    pt_px = view.camera.n_col * ax.get_figure(root=True).dpi / 72 / ax.bbox.width  # type: ignore[union-attr]
    # A word to the left or above keeps inside the frame: half its width or height, and some room.
    corner = (0.125 * n + np.array([2.4, 1.2]) * _WORD_PT * pt_px) * per_width - 0.5
    zenith, north = (
        view.axes_icrs[:2] @ direction
        for direction in (view.position_m / np.linalg.norm(view.position_m), np.array([0.0, 0.0, 1.0]))
    )
    together = zenith @ north > 0.9 * np.linalg.norm(zenith) * np.linalg.norm(north)
    for word, across, colour, word_at in (
        ("zenith", zenith, GREEN, 0.125),
        ("north", north, PURPLE, -0.035 if together else 0.125),  # at the arrow's foot where the heads are too close
    ):
        length = float(np.linalg.norm(across))
        if length < 1e-6:
            continue  # along the boresight
        tip, text_at = (corner + part * n * across / length * per_width for part in (0.09, word_at))
        arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.6}
        ax.annotate("", pair(tip), pair(corner), arrowprops=arrow, zorder=4)
        ax.text(*pair(text_at), word, color=colour, fontsize=_WORD_PT, ha="center", va="center", zorder=4)
