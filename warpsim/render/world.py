"""A scene on a device: everything that stays the same from frame to frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from warpsim_kernels.apparent import Releases
from warpsim_kernels.camera import Camera as CameraStruct
from warpsim_kernels.earth import Earth
from warpsim_kernels.motion import NodeGrid
from warpsim_kernels.targets import Target

from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING
from warpsim.detector.nei import read_out_struct
from warpsim.optics.psf_bank import PsfBank, psf_bank, stamp_rule
from warpsim.render.aiming import Aiming, make_aiming
from warpsim.render.star_field import Stars, make_stars
from warpsim.render.turning import Turning, make_turning, motion_struct
from warpsim.render.warmth import Warmth, make_radiance, make_warmth
from warpsim.scene.scene import Scene
from warpsim.sky.band_index import BandIndex
from warpsim.sky.bands import BANDS
from warpsim.target.shapes import body_struct


@dataclass(frozen=True)
class Motion:
    """Tracks on the device."""

    position_m: wp.array
    velocity_m_s: wp.array
    earth_velocity_m_s: wp.array
    releases: Any
    grid: Any


class World:
    """What the stages of a scene read: tracks, targets, stars, optics, detector, for some of its bands.

    Args:
        scene: The description.
        bands: Names of the bands, in the order of the images.
        device: Where everything is put.
        index: Star index of the scene's catalog at its epoch.
    """

    def __init__(self, scene: Scene, bands: Sequence[str], device: wp.Device, index: BandIndex) -> None:
        self.device = device
        self.n_band = len(bands)
        self.n_target = len(scene.target_names)
        self.first_target = len(scene.sensor_names)
        self.aiming: Aiming = make_aiming(scene, device)
        self.band_id = wp.array([scene.bands.index(name) for name in bands], dtype=wp.uint32, device=device)
        self.motion = _motion(scene, device)
        self.turning: Turning = make_turning(scene.attitudes, device)
        self.warmth: Warmth = make_warmth(scene.temperatures, device)
        self.targets = wp.array(_target_structs(scene, self.turning, self.warmth), dtype=Target, device=device)
        emissivity = np.array([[spec.surface.emissivity_in(name) for spec in scene.target_specs] for name in bands])
        self.emissivity = wp.array(emissivity, dtype=wp.float64, device=device)
        self.ln_radiance, self.ln_radiance_slope, self.radiance_table = make_radiance(bands, self.warmth.span_k, device)
        self.earth = _earth(scene)
        self.camera = _camera(scene)
        self.read_out = read_out_struct(scene.detector, scene.seed)
        self.stamp_rule = stamp_rule(scene.optics.stamp_cut_nei * scene.detector.nei_w_cm2, 0.0)
        psfs = [scene.optics.psf_at(BANDS[name].isophotal_um, scene.camera) for name in bands]
        self.psf: PsfBank = psf_bank(psfs, device)
        self.stars: Stars = make_stars(scene, bands, index, self.psf, self.stamp_rule, self.motion.grid)


def _motion(scene: Scene, device: wp.Device) -> Motion:
    tracks = scene.tracks
    bodies = [*tracks.sensors, *tracks.targets]
    grid: Any = NodeGrid()
    grid.start_s, grid.step_s, grid.n_node = tracks.start_s, tracks.step_s, tracks.n_node

    def upload(values: Any) -> wp.array:
        return wp.array(values, dtype=wp.vec3d, device=device)

    releases: Any = Releases()
    releases.release_s = wp.array(np.maximum(tracks.release_s, -1e300), dtype=wp.float64, device=device)
    releases.carrier = wp.array(tracks.carrier, dtype=wp.int32, device=device)
    return Motion(
        upload(np.stack([track.position_m for track in bodies])),
        upload(np.stack([track.velocity_m_s for track in bodies])),
        upload(tracks.earth_velocity_m_s),
        releases,
        grid,
    )


def _target_structs(scene: Scene, turning: Turning, warmth: Warmth) -> list[Any]:
    structs = []
    for number, (spec, attitude) in enumerate(zip(scene.target_specs, scene.attitudes, strict=True)):
        target: Any = Target()
        target.body = body_struct(spec.shape)
        target.attitude = motion_struct(attitude)
        target.table_first, target.table_count = turning.table_first[number], turning.table_count[number]
        target.temperature_first, target.temperature_count = warmth.first[number], warmth.count[number]
        structs.append(target)
    return structs


def _earth(scene: Scene) -> Any:
    earth: Any = Earth()
    earth.pole = wp.vec3d(*scene.tracks.pole_icrs)
    earth.equatorial_radius_m = EARTH_EQUATORIAL_RADIUS_M
    earth.polar_radius_m = EARTH_EQUATORIAL_RADIUS_M * (1 - EARTH_FLATTENING)
    return earth


def _camera(scene: Scene) -> Any:
    camera: Any = CameraStruct()
    camera.n_row, camera.n_col = scene.camera.n_row, scene.camera.n_col
    camera.focal_px = scene.camera.focal_px
    camera.centre_x_px, camera.centre_y_px = scene.camera.centre_px
    return camera
