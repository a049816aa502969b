"""Stars that are read as views need them: which tiles the views of a call look at."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from warpsim.errors import InputError
from warpsim.launches import to_numpy
from warpsim.render.batch import Batch
from warpsim.render.device_scene import DeviceScene
from warpsim.render.device_stars import LARGEST_SHIFT_RAD, Skies, half_width_px, jyear_of, make_stars
from warpsim.scene.scenario import Scenario

BRIGHTEST_JY = 1e5
"""No star but the Sun is brighter, at any wavelength: IRC+10216 has half of it at 10 um."""

LARGEST_MOTION_RAD_YR = 6e-5
"""Barnard's star moves by 10.4 arcsec a year, 5.0e-5 rad."""


def with_stars_of(
    batch: Batch, scenes: Sequence[DeviceScene], scenario: Scenario, skies: Skies
) -> Sequence[DeviceScene] | None:
    """Return the scenes with the stars that the views of a batch need; None where they have them already.

    The batch has been rendered, which tells where its views look.

    Raises:
        InputError: The views need too many stars at a time, or a star is brighter than any is.
    """
    assert skies.tiles is not None
    first = scenes[0]
    axes, reach_rad = _looks_at(batch, first)
    radius_rad = first.stars.tile_radius_rad or _radius_rad(first, skies, scenario)
    needed = skies.tiles.hats.rows_near(axes, reach_rad + radius_rad)
    if set(needed.tolist()) <= set(first.stars.tiles):
        return None
    tiles = skies.tiles.chosen(needed.tolist())
    indices, rows = skies.indices_of(tiles)
    filled = []
    for scene, index in zip(scenes, indices, strict=True):
        optics, grid = (scene.psf, scene.stamp_rule), scene.tracks.grid
        stars = make_stars(scenario, scene.instrument, scene.bands, index, *optics, grid)
        _check_brightest(stars.field.irradiance_w_cm2, scene, skies)
        stars = dataclasses.replace(stars, tiles=tiles, folder_row=rows, tile_radius_rad=radius_rad)
        filled.append(dataclasses.replace(scene, stars=stars))
    return filled


def _looks_at(batch: Batch, scene: DeviceScene) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Boresights of all views, (n_view, 3), and how far stars move during the exposure [rad], (n_view,)."""
    views: Any = to_numpy(batch.columns.views)
    reach_rad = views["reach"][:, 1] if scene.streaks.enabled else np.zeros(len(views))
    return np.array(views["axes"][:, 2], dtype=np.float64), np.array(reach_rad, dtype=np.float64)


def _radius_rad(scene: DeviceScene, skies: Skies, scenario: Scenario) -> float:
    """How far from the boresight a star may lie in its tile whose stamp touches the frame [rad]."""
    assert skies.tiles is not None
    margin_px = float(half_width_px(_brightest(scene), scene.psf, scene.stamp_rule).max()) + 1.0
    years = abs(jyear_of(scenario.epoch) - skies.tiles.epoch_jyear)
    nearest_rad = 1e-5  # parallaxes, of which none reaches 1 arcsec
    field_rad = scene.instrument.sensor.camera.half_diagonal_rad(margin_px)
    return field_rad + LARGEST_SHIFT_RAD + nearest_rad + LARGEST_MOTION_RAD_YR * years


def _brightest(scene: DeviceScene) -> wp.array:
    """Irradiance of a star of BRIGHTEST_JY in each band [W/cm2], (n_band, 1)."""
    light = [BRIGHTEST_JY * scene.instrument.bands[name].flat_w_cm2_per_jy for name in scene.bands]
    return wp.array(np.array(light, dtype=np.float32)[:, None], dtype=wp.float32, device=scene.device)


def _check_brightest(irradiance: wp.array, scene: DeviceScene, skies: Skies) -> None:
    most, light = to_numpy(_brightest(scene))[:, 0], to_numpy(irradiance)
    if light.size and (light.max(axis=1) > most).any():
        rule = f"must hold no star brighter than {BRIGHTEST_JY:g} Jy, or views may miss its light"
        raise InputError(rule).of(scene.instrument.sensor.name).within("sky.catalog")
