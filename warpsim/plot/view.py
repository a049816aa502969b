"""What a sensor's camera sees, as geometry: targets, stars, the Earth's limb, which way is up and north.

The places are those of the renderer itself, so the picture agrees with the rendered frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M
from warpsim.errors import InputError
from warpsim.orbit.earth import EARTH_POLAR_RADIUS_M
from warpsim.plot.figure import BLUE, GREEN, GREY, INK, PURPLE, SKY_BLUE, new_axes, pair, place_labels, plain
from warpsim.plot.scenario import MOST_LABELS, checked_time_s, kind_style, kinds_of_targets
from warpsim.scene.scene import Scene
from warpsim.sky.apparent import apparent_direction

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from warpsim.render.renderer import Renderer

F64 = NDArray[np.float64]

VIEW_INCH = (7.4, 7.9)
"""Of a figure for `plot_satellite_view`: room for a legend of three rows below a square."""

_WORD_PT = 8.0  # letters of the compass
_N_GRID = 129  # places across the field at which the Earth is looked for
_INSET_BELOW = 0.2  # of the field: a smaller group is drawn a second time, enlarged


@dataclass(frozen=True)
class CameraView:
    """Geometry of one view, from a rendered frame."""

    axes_icrs: F64
    """Camera axes as rows x, y, z, shape (3, 3)."""
    position_m: F64
    """Geocentric position of the sensor, shape (3,)."""
    velocity_m_s: F64
    """Its geocentric velocity, shape (3,)."""
    target_xy_px: F64
    """Places of the targets, NaN behind the camera, shape (n_target, 2)."""
    occulted: NDArray[np.bool_]
    """Whether the Earth hides them, shape (n_target,)."""
    stowed: NDArray[np.bool_]
    """Whether they have not left their main target yet, and so give no light, shape (n_target,)."""
    star_xy_px: F64
    """Places of the stars whose light reaches the frame, shape (n_star, 2)."""
    star_snr: F64
    """Their irradiance over NEI in the scene's first band, shape (n_star,)."""


def camera_view(scene: Scene, sensor: str, time_s: float, renderer: Renderer | None = None) -> CameraView:
    """Render one view and take its geometry.

    Args:
        scene: The scene.
        sensor: Name of the sensor.
        time_s: The instant [s after the epoch]; need not be a frame's.
        renderer: Of this scene, to use its catalog and kernels again.

    Raises:
        InputError: No such sensor, or the instant is outside the scene.
    """
    from warpsim.render.renderer import Renderer

    time = checked_time_s(scene, time_s)
    if sensor not in scene.sensor_names:
        raise InputError("must be a sensor of the scene", "sensor", sensor)
    number = round((time - scene.frames.start_s) / scene.frames.interval_s)
    if not 0 <= number < 2**32 or scene.frame_time_s([number])[0] != time:
        # No frame is at this instant: one scene more, with its only frame there.
        number = 0
        frames = {"count": 1, "interval_s": scene.frames.interval_s, "start_s": time}
        given = {"device": renderer.device, "catalog": renderer.catalog} if renderer else {}
        renderer = Renderer(scene.replace(frames=frames), **given)
    elif renderer is None:
        renderer = Renderer(scene)
    shown = renderer.render([number], [sensor], [scene.bands[0]], keep_stars=True)
    truth, stars = shown.truth, shown.stars
    position_m, velocity_m_s = scene.tracks.of(sensor).state(np.array([time]))
    return CameraView(
        axes_icrs=shown.axes_icrs[0, 0],
        position_m=position_m[0],
        velocity_m_s=velocity_m_s[0],
        target_xy_px=np.stack([np.asarray(truth["x_px"]), np.asarray(truth["y_px"])], axis=1),
        occulted=np.asarray(truth["occulted"]),
        stowed=np.asarray(truth["stowed"]),
        star_xy_px=np.stack([np.asarray(stars["x_px"]), np.asarray(stars["y_px"])], axis=1),
        star_snr=np.asarray(stars["snr"])[:, 0],
    )


def plot_satellite_view(
    scene: Scene, sensor: str, time_s: float, ax: Axes | None = None, renderer: Renderer | None = None
) -> Axes:
    """Draw what a sensor's camera sees as geometry: targets and stars at their pixels, the Earth, zenith and north.

    Places are apparent, with light time and aberration: those of the rendered frame. A group that is small in the
    field is drawn a second time, enlarged and with names. Stowed targets are left out: they give no light.

    Args:
        scene: The scene.
        sensor: Name of the sensor.
        time_s: The instant [s after the epoch].
        ax: Where to draw; in pixels, row 0 on top.
        renderer: Of this scene, to use its catalog and kernels again.

    Raises:
        InputError: No such sensor, or the instant is outside the scene.
    """
    view = camera_view(scene, sensor, time_s, renderer)
    ax = ax or new_axes(*VIEW_INCH)
    camera = scene.camera
    right, bottom = camera.n_col - 0.5, camera.n_row - 0.5
    ax.set(xlim=(-0.5, right), ylim=(bottom, -0.5), aspect=camera.pixel_aspect, xlabel="column [px]", ylabel="row [px]")
    _draw_limb(ax, scene, view)
    inside = _in_frame(scene, view.star_xy_px)
    if inside.any():
        size = np.clip(6 + 9 * np.log10(np.maximum(view.star_snr[inside], 0.1)), 3, 60)
        x, y = view.star_xy_px[inside].T
        ax.scatter(x, y, s=size, marker="o", facecolors="none", edgecolors=GREY, linewidths=0.9,
                   label=f"stars ({np.count_nonzero(inside)}), by brightness", zorder=2)  # fmt: skip
    _draw_targets(ax, scene, view, with_labels=True)
    _draw_compass(ax, scene, view)
    in_field = view.target_xy_px[_shown(scene, view)]
    extent_px = float((np.ptp(in_field, axis=0) * [1, camera.pixel_aspect]).max()) if len(in_field) > 1 else 0.0
    if 0 < extent_px < _INSET_BELOW * _short_side_px(scene):
        _draw_inset(ax, scene, view, in_field, extent_px)
    else:
        _name_targets(ax, scene, view)
    seen = "access" if scene.has_access(sensor, [time_s])[0] else "no access"
    range_km = np.linalg.norm(scene.position_m(scene.target_names[0], [time_s])[0] - view.position_m) / 1e3
    ax.set_title(
        f"{scene.name}: {sensor} at {plain(time_s)} s, {range_km:.0f} km from {scene.target_names[0]}, {seen}\n"
        f"field of {camera.field_deg[0]:.3g} deg across",
        fontsize=10,
    )
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.09), ncols=3, fontsize=8, frameon=False)
    return ax


def _short_side_px(scene: Scene) -> float:
    """Shorter side of the array, in widths of a pixel."""
    return min(scene.camera.n_col, scene.camera.n_row * scene.camera.pixel_aspect)


def _in_frame(scene: Scene, xy_px: F64) -> NDArray[np.bool_]:
    edge = np.array([scene.camera.n_col, scene.camera.n_row]) - 0.5
    return np.asarray(((xy_px >= -0.5) & (xy_px < edge)).all(axis=1))  # NaN is not


def _shown(scene: Scene, view: CameraView) -> NDArray[np.bool_]:
    """Targets in the frame that can be seen: neither behind the Earth nor stowed, shape (n_target,)."""
    return ~view.occulted & ~view.stowed & _in_frame(scene, view.target_xy_px)


def _draw_targets(ax: Axes, scene: Scene, view: CameraView, with_labels: bool) -> None:
    """Marks of the targets in the frame by kind; those behind the Earth are crosses."""
    shown, inside = _shown(scene, view), _in_frame(scene, view.target_xy_px)
    for kind in kinds_of_targets(scene):
        chosen = np.array(kind.rows)[shown[kind.rows]]
        if len(chosen):
            part = len(chosen) < len(kind.rows)
            label = f"{kind.spec.name} ({len(chosen)} of {len(kind.rows)})" if part else kind.label
            ax.plot(*view.target_xy_px[chosen].T, label=label if with_labels else None, **kind_style(kind))
    hidden = view.occulted & ~view.stowed & inside
    if hidden.any():
        ax.plot(*view.target_xy_px[hidden].T, "x", color=GREY, markersize=5,
                label=f"behind the Earth ({np.count_nonzero(hidden)})" if with_labels else None)  # fmt: skip
    if with_labels and view.stowed.any():
        ax.plot([], [], " ", label=f"stowed, dark, not drawn ({np.count_nonzero(view.stowed)})")


def _name_targets(ax: Axes, scene: Scene, view: CameraView) -> None:
    shown = np.flatnonzero(_shown(scene, view))
    if len(shown) <= MOST_LABELS:
        names = [scene.target_names[number] for number in shown]
        place_labels(ax, view.target_xy_px[shown], names, size=6.2, color=INK, zorder=2.5)


def _draw_inset(ax: Axes, scene: Scene, view: CameraView, in_field: F64, extent_px: float) -> None:
    """The group enlarged, in the corner that it leaves free; extent_px counts in widths of a pixel."""
    middle = in_field.min(axis=0) / 2 + in_field.max(axis=0) / 2
    aspect = scene.camera.pixel_aspect
    low, high = (middle + sign * 0.66 * extent_px / np.array([1.0, aspect]) for sign in (-1, 1))
    corner_y = 0.05 if middle[1] < (scene.camera.n_row - 1) / 2 else 0.58
    inset: Any = ax.inset_axes((0.58, corner_y, 0.4, 0.4))
    inset.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]), aspect=aspect)
    inset.tick_params(labelsize=7)
    _draw_targets(inset, scene, view, with_labels=False)
    _name_targets(inset, scene, view)
    ax.indicate_inset_zoom(inset, edgecolor=INK, alpha=0.6)


def earth_clearance(scene: Scene, view: CameraView, xy_px: F64) -> F64:
    """How far rays through places of the image pass the Earth: below 0 where they meet it, shape (...).

    In axes stretched along the pole, where the ellipsoid is a sphere: the ray's smallest distance from the centre over
    the radius, minus one. The apparent directions are taken back through the aberration.
    """
    seen = scene.camera.direction(xy_px.reshape(-1, 2), view.axes_icrs)
    # The Earth comes along: only the motion about it shifts its limb.
    ray = apparent_direction(seen, -view.velocity_m_s).reshape(*xy_px.shape[:-1], 3)
    stretch = EARTH_EQUATORIAL_RADIUS_M / EARTH_POLAR_RADIUS_M - 1
    pole = scene.tracks.pole_icrs
    start = view.position_m + (view.position_m @ pole) * stretch * pole
    ray = ray + (ray @ pole)[..., None] * stretch * pole
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    along = ray @ start
    nearest = np.linalg.norm(start - np.minimum(along, 0)[..., None] * ray, axis=-1)
    return np.asarray(nearest / EARTH_EQUATORIAL_RADIUS_M - 1)


def _draw_limb(ax: Axes, scene: Scene, view: CameraView) -> None:
    """The Earth's disc and its limb, where they are in the field."""
    n_row, n_col = scene.camera.n_row, scene.camera.n_col
    x, y = np.linspace(-0.5, n_col - 0.5, _N_GRID), np.linspace(-0.5, n_row - 0.5, _N_GRID)
    clearance = earth_clearance(scene, view, np.stack(np.meshgrid(x, y), axis=-1))
    if clearance.min() >= 0:
        return
    ax.contourf(x, y, clearance, levels=[-1.0, 0.0], colors=[SKY_BLUE], alpha=0.35, zorder=0.5)
    if clearance.max() > 0:
        ax.contour(x, y, clearance, levels=[0.0], colors=[BLUE], linewidths=1.2, zorder=1)
    ax.plot([], [], "s", color=SKY_BLUE, alpha=0.35, markeredgecolor=BLUE, markersize=9, label="Earth")


def _draw_compass(ax: Axes, scene: Scene, view: CameraView) -> None:
    """Arrows to the sensor's zenith and to celestial north, from a corner."""
    n, per_width = _short_side_px(scene), np.array([1.0, 1.0 / scene.camera.pixel_aspect])  # pixels in a pixel's width
    ax.apply_aspect()
    pt_px = scene.camera.n_col * ax.get_figure(root=True).dpi / 72 / ax.bbox.width  # type: ignore[union-attr]
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
        tip, place = (corner + share * n * across / length * per_width for share in (0.09, word_at))
        arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.6}
        ax.annotate("", pair(tip), pair(corner), arrowprops=arrow, zorder=4)
        ax.text(*pair(place), word, color=colour, fontsize=_WORD_PT, ha="center", va="center", zorder=4)
