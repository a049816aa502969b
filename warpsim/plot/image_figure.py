"""Figures of what a sensor sees: the geometry of a view.

Positions are those of the renderer itself, so the figures agree with the rendered frames.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.arguments import some_names
from warpsim.arrays import F64
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M
from warpsim.directions import normalised
from warpsim.errors import InputError
from warpsim.optics.camera import Camera
from warpsim.plot.figure import (
    BLUE,
    GREEN,
    GREY,
    INK,
    MOST_LABELS,
    PURPLE,
    SKY_BLUE,
    annotate_points,
    checked_time_s,
    counted_targets,
    draw_arrow,
    legend_below,
    literal,
    new_axes,
    observed_targets,
    pair,
    plain,
    stretched,
    target_kinds,
)
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of
from warpsim.scene.sensors import Frames
from warpsim.sky.apparent import apparent_direction

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from warpsim.render.renderer import Renderer

Mask = NDArray[np.bool_]

VIEW_INCH = (7.4, 7.9)
"""Size of a figure for `plot_satellite_view`: room for a legend of three rows below a square."""

_WORD_PT = 8.0  # letters of the compass
_N_GRID = 129  # points across the field at which the Earth is looked for
_INSET_BELOW = 0.2  # of the field: a smaller group is drawn a second time, enlarged


@dataclass(frozen=True)
class CameraView:
    """Geometry of one view, from a rendered frame."""

    camera: Camera
    axes_icrs: F64
    """Camera axes as rows x, y, z, shape (3, 3)."""
    position_m: F64
    """Geocentric position of the sensor, shape (3,)."""
    velocity_m_s: F64
    """Its geocentric velocity, shape (3,)."""
    target_xy_px: F64
    """Pixel positions of the targets, NaN behind the camera and for absent ones, shape (n_target, 2)."""
    occulted: Mask
    """Whether the Earth hides them, shape (n_target,)."""
    not_deployed: Mask
    """Whether they are with their main target still, and so give no light, shape (n_target,)."""
    absent: Mask
    """Whether they do not exist, shape (n_target,)."""
    star_xy_px: F64
    """Pixel positions of the stars whose light reaches the frame, shape (n_star, 2)."""
    star_snr: F64
    """Their irradiance over NEI in the sensor's first band, shape (n_star,)."""

    @property
    def shown(self) -> Mask:
        """Targets in the frame that can be seen: deployed, and not behind the Earth, shape (n_target,)."""
        return ~self.occulted & ~self.not_deployed & ~self.absent & self.in_frame(self.target_xy_px)

    def in_frame(self, xy_px: F64) -> Mask:
        """Return whether points of the image plane lie on the array, shape (n,)."""
        edge = np.array([self.camera.n_col, self.camera.n_row]) - 0.5
        return np.asarray(((xy_px >= -0.5) & (xy_px < edge)).all(axis=1))  # NaN is not

    @property
    def short_side_px(self) -> float:
        """Shorter side of the array, in widths of a pixel."""
        return min(self.camera.n_col, self.camera.n_row * self.camera.pixel_aspect)


def camera_view(scenario: Scenario, sensor: str, time_s: float, renderer: Renderer | None = None) -> CameraView:
    """Render one view, of a frame or between frames, and return its geometry; an InputError for no sensor or instant.

    A renderer of this scene lends its catalog and kernels.
    """
    from warpsim.render.renderer import Renderer

    time = checked_time_s(time_s, scenario.scene.duration_s)
    instrument, index = _sensor_index(scenario, sensor)
    frames = instrument.frames
    number = round((time - frames.start_s) / frames.interval_s)
    if not 0 <= number < 2**32 or instrument.frame_time_s([number])[0] != time:
        # No frame is at this instant: one scene more, in which the sensor's only frame is there.
        number = 0
        moved = dataclasses.replace(instrument.sensor, frames=Frames(1, frames.interval_s, time))
        sensors = tuple(moved if other.name == moved.name else other for other in scenario.scene.sensors)
        once = Scenario(dataclasses.replace(scenario.scene, sensors=sensors))
        renderer = renderer.with_scene(once) if renderer else Renderer(once)
    shown = (renderer or Renderer(scenario)).render([number], [sensor], [instrument.sensor.bands[0]], keep_stars=True)
    truth, stars = shown.truth, shown.stars
    position_m, velocity_m_s = scenario.tracks.state(instrument.satellite_names[index], np.array([time]))
    return CameraView(
        camera=instrument.sensor.camera,
        axes_icrs=shown.axes_icrs[0, 0],
        position_m=position_m[0],
        velocity_m_s=velocity_m_s[0],
        target_xy_px=np.stack([np.asarray(truth["x_px"]), np.asarray(truth["y_px"])], axis=1),
        occulted=np.asarray(truth["occulted"]),
        not_deployed=np.asarray(truth["not_deployed"]),
        absent=np.asarray(truth["absent"]),
        star_xy_px=np.stack([np.asarray(stars["x_px"]), np.asarray(stars["y_px"])], axis=1),
        star_snr=np.asarray(stars["snr"])[:, 0],
    )


def _sensor_index(scenario: Scenario, sensor: str) -> tuple[Instrument, int]:
    """The kind of a sensor, and its index in it; the name of a kind is no sensor where several satellites carry one."""
    if sensor not in scenario.sensor_names:
        rule = f"must be a sensor of the scene ({some_names(scenario.sensor_names)})"
        raise InputError(rule, "sensor", sensor)
    instrument = scenario.instrument_of(sensor)
    return instrument, instrument.index(sensor)


def earth_clearance(view: CameraView, pole: F64, xy_px: F64) -> F64:
    """Return the clearance of rays through points of the image past the Earth: below 0 where they meet it, shape (...).

    In axes in which the ellipsoid about a pole is a sphere: the ray's smallest distance from the centre over the
    radius, minus one. The apparent directions are taken back through the aberration.
    """
    seen = view.camera.direction(xy_px.reshape(-1, 2), view.axes_icrs)
    # The Earth comes along: only the motion about it shifts its limb.
    ray = apparent_direction(seen, -view.velocity_m_s).reshape(*xy_px.shape[:-1], 3)
    start, ray = stretched(view.position_m, pole), normalised(stretched(ray, pole))
    nearest = np.linalg.norm(start - np.minimum(ray @ start, 0)[..., None] * ray, axis=-1)
    return np.asarray(nearest / EARTH_EQUATORIAL_RADIUS_M - 1)


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
    camera = view.camera
    ax = ax or new_axes(*VIEW_INCH)
    set_frame(ax, camera)
    _draw_limb(ax, view, scenario.tracks.pole_icrs)
    _draw_stars(ax, view)
    _draw_targets(ax, view, scenario, with_labels=True)
    _draw_compass(ax, view)
    in_field = view.target_xy_px[view.shown]
    extent_px = float((np.ptp(in_field, axis=0) * [1, camera.pixel_aspect]).max()) if len(in_field) > 1 else 0.0
    detail = ax
    if 0 < extent_px < _INSET_BELOW * view.short_side_px:
        detail = inset(ax, camera, in_field, extent_px)
        _draw_targets(detail, view, scenario, with_labels=False)
    shown = np.flatnonzero(view.shown)
    if len(shown) <= MOST_LABELS:
        names = [scenario.target_names[number] for number in shown]
        annotate_points(detail, view.target_xy_px[shown], names, size=6.2, color=INK, zorder=2.5)
    ax.set_title(
        f"{literal(scenario.scene.name)}: {sensor} at {plain(time_s)} s, "
        f"{_range_words(scenario, sensor, float(time_s))}\n"
        f"field of {camera.field_deg[0]:.3g} deg across",
        fontsize=10,
    )
    if ax.get_legend_handles_labels()[0]:
        legend_below(ax, -0.09, 3)
    return ax


def set_frame(ax: Axes, camera: Camera) -> None:
    """Set the limits of axes in pixels, row 0 on top."""
    ax.set(xlim=(-0.5, camera.n_col - 0.5), ylim=(camera.n_row - 0.5, -0.5), aspect=camera.pixel_aspect)
    ax.set(xlabel="column [px]", ylabel="row [px]")


def _range_words(scenario: Scenario, sensor: str, time_s: float) -> str:
    """Range of a target that access counts by, of one that the sensor can observe if there is one; and the access."""
    instrument, index = _sensor_index(scenario, sensor)
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


def _draw_targets(ax: Axes, view: CameraView, scenario: Scenario, with_labels: bool) -> None:
    """Marks of the targets in the frame by kind; those behind the Earth are crosses."""
    for kind in target_kinds(scenario):
        chosen = np.array(kind.targets)[view.shown[kind.targets]]
        if len(chosen):
            part = len(chosen) < len(kind.targets)
            label = f"{kind.name} ({len(chosen)} of {len(kind.targets)})" if part else kind.label
            ax.plot(*view.target_xy_px[chosen].T, label=label if with_labels else None, **kind.style)
    hidden = view.occulted & ~view.not_deployed & ~view.absent & view.in_frame(view.target_xy_px)
    if hidden.any():
        ax.plot(*view.target_xy_px[hidden].T, "x", color=GREY, markersize=5,
                label=f"behind the Earth ({np.count_nonzero(hidden)})" if with_labels else None)  # fmt: skip
    for words, left_out in (("not deployed", view.not_deployed & ~view.absent), ("absent", view.absent)):
        if with_labels and left_out.any():
            ax.plot([], [], " ", label=f"{words}, not drawn ({np.count_nonzero(left_out)})")


def inset(ax: Axes, camera: Camera, in_field: F64, extent_px: float) -> Any:
    """Return axes that enlarge a part of a field, in the corner that it leaves free.

    Args:
        ax: Of the field.
        camera: Whose field it is.
        in_field: What is enlarged: columns and rows of points, shape (n, 2) [px].
        extent_px: Its width or height, in widths of a pixel.
    """
    from matplotlib.patches import Rectangle

    middle = in_field.min(axis=0) / 2 + in_field.max(axis=0) / 2
    aspect = camera.pixel_aspect
    low, high = (middle + sign * 0.66 * extent_px / np.array([1.0, aspect]) for sign in (-1, 1))
    corner_y = 0.05 if middle[1] < (camera.n_row - 1) / 2 else 0.58
    enlarged: Any = ax.inset_axes((0.58, corner_y, 0.4, 0.4))
    enlarged.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]), aspect=aspect)
    enlarged.tick_params(labelsize=7)
    enlarged.locator_params(nbins=6, steps=[1, 2, 5, 10])
    # White behind the numbers of the inset, which would stand on stars or on a black image.
    paper = Rectangle((0.5, corner_y - 0.04), 0.49, 0.455, transform=ax.transAxes, zorder=4.8)
    paper.set(facecolor="white", edgecolor="none")
    ax.add_patch(paper)
    ax.indicate_inset_zoom(enlarged, edgecolor=INK, alpha=0.6)
    return enlarged


def _draw_limb(ax: Axes, view: CameraView, pole: F64) -> None:
    """The Earth's disc and its limb, where they are in the field."""
    x, y = (np.linspace(-0.5, n - 0.5, _N_GRID) for n in (view.camera.n_col, view.camera.n_row))
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
    zenith, north = view.axes_icrs[:2] @ normalised(view.position_m), view.axes_icrs[:2, 2]
    together = zenith @ north > 0.9 * np.linalg.norm(zenith) * np.linalg.norm(north)
    for word, across, colour, word_at in (
        ("zenith", zenith, GREEN, 0.125),
        ("north", north, PURPLE, -0.035 if together else 0.125),  # at the arrow's foot where the heads are too close
    ):
        length = float(np.linalg.norm(across))
        if length < 1e-6:
            continue  # along the boresight
        tip, text_at = (corner + part * n * across / length * per_width for part in (0.09, word_at))
        draw_arrow(ax, corner, tip, 4, arrowstyle="-|>", color=colour, linewidth=1.6)
        ax.text(*pair(text_at), word, color=colour, fontsize=_WORD_PT, ha="center", va="center", zorder=4)
