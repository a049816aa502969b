"""A scene on a device: everything that stays the same from frame to frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from warpsim_kernels.apparent import Releases
from warpsim_kernels.camera import Camera as CameraStruct
from warpsim_kernels.motion import NodeGrid

from warpsim.optics.psf_bank import PsfBank, psf_bank, stamp_rule
from warpsim.render.aiming import Aiming, make_aiming
from warpsim.render.read_out import ReadOut, make_read_out
from warpsim.render.star_field import Stars, make_stars
from warpsim.render.target_field import TargetField, make_target_field
from warpsim.scene.scene import Scene
from warpsim.sky.band_index import BandIndex
from warpsim.sky.bands import BANDS


@dataclass(frozen=True)
class Motion:
    """Tracks on the device."""

    position_m: wp.array
    velocity_m_s: wp.array
    earth_velocity_m_s: wp.array
    releases: Any
    grid: Any


class TargetWorld:
    """What the stages read that need no images: tracks, pointing and targets, for some of a scene's bands.

    Args:
        scene: The description.
        bands: Names of the bands, in the order of the images.
        device: Where everything is put.
    """

    def __init__(self, scene: Scene, bands: Sequence[str], device: wp.Device) -> None:
        self.device = device
        self.n_band = len(bands)
        self.n_target = len(scene.target_names)
        self.aiming: Aiming = make_aiming(scene, device)
        self.motion = _motion(scene, device)
        self.field: TargetField = make_target_field(scene, bands, device)
        self.camera = _camera(scene)


class World(TargetWorld):
    """What all stages read: stars, optics and detector besides.

    Args:
        scene: The description.
        bands: Names of the bands, in the order of the images.
        device: Where everything is put.
        index: Star index of the scene's catalog at its epoch.
    """

    def __init__(self, scene: Scene, bands: Sequence[str], device: wp.Device, index: BandIndex) -> None:
        super().__init__(scene, bands, device)
        self.band_id = wp.array([scene.bands.index(name) for name in bands], dtype=wp.uint32, device=device)
        shape = (scene.camera.n_row, scene.camera.n_col)
        self.read_out: ReadOut = make_read_out(scene.detector, scene.levels, bands, scene.seed, shape, device)
        # One cut for all bands, and of all bands of the scene: a stamp must not depend on which of them are rendered.
        nei_w_cm2 = min(scene.nei_w_cm2(band) for band in scene.bands)
        self.stamp_rule = stamp_rule(scene.optics.stamp_cut_nei * nei_w_cm2, 0.0)
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


def _camera(scene: Scene) -> Any:
    camera: Any = CameraStruct()
    camera.n_row, camera.n_col = scene.camera.n_row, scene.camera.n_col
    camera.focal_px = scene.camera.focal_px
    camera.centre_x_px, camera.centre_y_px = scene.camera.centre_px
    return camera
