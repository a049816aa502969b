"""Gradients of a number by what frames show: sources, camera, positions of targets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.optics.camera import Camera
from warpsim.optics.psf import PsfGaussian
from warpsim.render.deposit import checked_cotangent
from warpsim.render.frameset import FrameSet
from warpsim.render.point_images import Gathered

PARAMETERS = (
    "x_px", "y_px", "irradiance_w_cm2", "path_px", "sigma_px", "boresight_rad", "roll_rad",
    "target_position_m", "range_m",
)  # fmt: skip
"""What images can be differentiated by."""

OF_STARS = ("boresight_rad", "roll_rad", "sigma_px")
"""Parameters that move stars, too."""

_TURNS = {"boresight_rad", "roll_rad"}

ANGLE_STEP_RAD, POSITION_STEP = 1e-4, 1e-3
"""Of five-point differences of projections in float64, of positions over their range: both good to 1e-11."""

_STEPS = ((-2.0, 1.0 / 12.0), (-1.0, -8.0 / 12.0), (1.0, 8.0 / 12.0), (2.0, -1.0 / 12.0))


def checked_parameters(wrt: str | Sequence[str], known: Sequence[str] = PARAMETERS) -> list[str]:
    """Return names of parameters as a list; InputError for none, unknown ones, and one twice."""
    names = [wrt] if isinstance(wrt, str) else list(wrt)
    for name in names:
        if name not in known:
            raise InputError(f"must be of {', '.join(known)}", "wrt", name)
    if not names or len(set(names)) != len(names):
        raise InputError("must name parameters, none twice", "wrt", ", ".join(names), "s")
    return names


def gradients(
    frames: FrameSet, cotangent: npt.ArrayLike, wrt: str | Sequence[str] = ("x_px", "y_px", "irradiance_w_cm2")
) -> dict[str, F64]:
    """Return the gradient of a number by what frames show, from its derivatives by the noiseless pixels.

    It is that of the images that were drawn, by the same stamps, tables and streaks, in float64, to rounding; the
    scene is not rendered again. What a target's light, or the scene's, follows from is not asked.

    Args:
        frames: Rendered frames; with keep_stars=True where stars move with what is asked for.
        cotangent: Derivatives by signal_w_cm2, shape (frame, sensor, band, row, column) [cm2/W]; taken as float32.
        wrt: Names of parameters:

            - "x_px", "y_px": positions of targets, with their paths; (frame, sensor, target).
            - "irradiance_w_cm2": of targets at the pupil; (frame, sensor, band, target).
            - "path_px": Legendre coefficients of their paths in the exposure; (frame, sensor, target, n_path, 2).
            - "sigma_px": width of a Gaussian point spread function; (frame, sensor, band).
            - "boresight_rad": the camera's direction, towards larger x and towards larger y; (frame, sensor, 2).
            - "roll_rad": right-handed about it; (frame, sensor).
            - "target_position_m": where a target's light left, geocentric, GCRS axes, its light falling as 1 / range^2,
              its aspect the same; (frame, sensor, target, 3).
            - "range_m": the same along the line of sight; (frame, sensor, target).

    Returns:
        Arrays by name. A target without light has 0, by its irradiance too: it has no stamp.

    Raises:
        InputError: An unknown parameter, sigma of a pattern that has none, a cotangent of another shape or that is not
            finite, or stars that were not kept.
    """
    names = checked_parameters(wrt)
    n_frame, n_sensor, n_band, n_row, n_col = frames.counts.shape
    shape = (n_frame, n_sensor)
    with_stars = any(name in OF_STARS for name in names)
    if "sigma_px" in names and not all(isinstance(frames.instrument.psf(band), PsfGaussian) for band in frames.bands):
        raise InputError("only Gaussian point spread functions have one", "wrt", "sigma_px")
    values = checked_cotangent(cotangent, frames.counts.shape).reshape(-1, n_band, n_row, n_col)
    images = frames.point_images("gradients", with_stars)
    found = images.gathered(values, "sigma_px" in names)
    turned = _by_turn(frames, images.xy_px, found).reshape(*shape, 3) if _TURNS & set(names) else np.zeros(0)
    return {name: _by(name, frames, found, turned, shape) for name in names}


def _by(name: str, frames: FrameSet, found: Gathered, turned: F64, shape: tuple[int, int]) -> F64:
    """Gradient by one parameter; that by the camera's turns, (frame, sensor, 3), is there already."""
    n_target = len(frames.scenario.target_names)
    by_xy = found.by_xy.sum(axis=1)  # all bands see a source at one position
    if name in ("x_px", "y_px"):
        return np.asarray(by_xy[:, :n_target, ("x_px", "y_px").index(name)].reshape(*shape, n_target))
    if name == "irradiance_w_cm2":
        lit = np.where(frames.target_light.irradiance_w_cm2 != 0.0, found.by_light[..., :n_target], 0.0)
        return np.asarray(lit.reshape(*shape, -1, n_target))
    if name == "path_px":
        by_path = found.by_path.sum(axis=1)[:, :n_target]
        return np.asarray(by_path.reshape(*shape, *by_path.shape[1:]))
    if name == "sigma_px":
        return np.asarray(found.by_sigma.sum(axis=2).reshape(*shape, -1))
    if name in _TURNS:
        return np.array(turned[..., :2] if name == "boresight_rad" else turned[..., 2])
    return _by_position(name, frames, by_xy[:, :n_target], found.by_light[..., :n_target]).reshape(
        *shape, n_target, *((3,) if name == "target_position_m" else ())
    )


def _by_turn(frames: FrameSet, xy_px: F64, found: Gathered) -> F64:
    """Gradient by the camera's turns, (n_view, 3), with sources where they were drawn, (n_view, n_slot, 2)."""
    by_xy = found.by_xy.sum(axis=1)
    turned = np.zeros((len(by_xy), 3))
    for view in range(len(by_xy)):
        lit = by_xy[view].any(axis=1)
        slopes = camera_slopes(frames.instrument.sensor.camera, xy_px[view, lit])
        turned[view] = np.einsum("na,nak->k", by_xy[view, lit], slopes)
    return turned


def _by_position(name: str, frames: FrameSet, by_xy: F64, by_light: F64) -> F64:
    """Gradient by positions of targets or their ranges, views first."""
    position_m, away_m = frames.target_position_m, frames.target_vector_m
    range_m = np.linalg.norm(away_m, axis=-1)
    light = frames.target_light.irradiance_w_cm2.astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        by_range = np.where(light != 0.0, -2.0 * light / range_m[:, None] * by_light, 0.0).sum(axis=1)
        along = away_m / range_m[..., None]
    if name == "range_m":
        return np.asarray(by_range)
    found = np.zeros((*by_range.shape, 3))
    n_sensor = len(frames.sensors)
    for view in range(len(by_xy)):
        lit = (light[view] != 0.0).any(axis=0)
        frame, sensor = frames.frames[view // n_sensor], frames.sensors[view % n_sensor]
        slopes = position_slopes(
            lambda there, frame=frame, sensor=sensor: frames.project(frame, sensor, there)[0],
            position_m[view, lit],
            range_m[view, lit],
        )
        found[view, lit] = np.einsum("na,nak->nk", by_xy[view, lit], slopes)
        found[view, lit] += by_range[view, lit, None] * along[view, lit]
    return found


def camera_slopes(camera: Camera, xy_px: F64) -> F64:
    """Return how positions of a still sky follow the camera, (n, 2, 3): x and y by boresight, two angles, and roll.

    The boresight turns towards larger x, then towards larger y; roll turns the camera right-handed about it, as
    `roll_deg` does. Through the lens. NaN where a position is none.

    Args:
        camera: The camera.
        xy_px: Positions, (n, 2).
    """
    there = np.isfinite(xy_px).all(axis=1) & (np.abs(xy_px) < 1e6).all(axis=1)
    slopes = np.full((len(xy_px), 2, 3), np.nan)
    seen = camera.direction(xy_px[there])
    turns = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # about x, y and z, for each of the three
    for number, turn in enumerate(turns):
        step = -np.cross(turn, seen) * ANGLE_STEP_RAD
        slopes[there, :, number] = sum(weight * camera.project(seen + k * step, np.eye(3))[0] for k, weight in _STEPS)
    return slopes / ANGLE_STEP_RAD


def position_slopes(project: Any, position_m: F64, range_m: F64) -> F64:
    """Return how images follow positions in space, (n, 2, 3) [px/m]; NaN where there is none.

    Args:
        project: Function of positions, (n, 3), to pixels, (n, 2), as `FrameSet.project`, light path and lens included.
        position_m: Where the light left, (n, 3); NaN for none.
        range_m: From how far away, (n,).
    """
    slopes = np.full((len(position_m), 2, 3), np.nan)
    there = np.isfinite(position_m).all(axis=1) & (range_m > 0.0)
    if not there.any():
        return slopes
    step_m = POSITION_STEP * range_m[there, None]
    for axis in range(3):
        along = step_m * np.eye(3)[axis]
        shift = sum(weight * project(position_m[there] + k * along) for k, weight in _STEPS)
        slopes[there, :, axis] = shift / step_m
    return slopes
