"""A scene on a device: everything that stays the same from frame to frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from warpsim_kernels.apparent import Releases
from warpsim_kernels.camera import Camera as CameraStruct
from warpsim_kernels.camera import Distortion as LensStruct
from warpsim_kernels.emission import record_targets_kernel
from warpsim_kernels.motion import NodeGrid

from warpsim.optics.camera import Camera
from warpsim.optics.psf import Psf, PsfGaussian
from warpsim.optics.psf_bank import PsfBank, psf_bank, stamp_rule
from warpsim.optics.tables import TableAccuracy, cheapest_points
from warpsim.render.aiming import Aiming, make_aiming
from warpsim.render.buffers import observation_columns
from warpsim.render.kernel_loading import kernel_loading
from warpsim.render.read_out import ReadOut, make_read_out
from warpsim.render.rows import RowLayout
from warpsim.render.star_field import Stars, make_stars, star_kernel
from warpsim.render.streak_rule import choose_streaks
from warpsim.render.streaks import Streaks, no_streaks
from warpsim.render.target_field import TargetField, make_target_field
from warpsim.scene.scene import Scene
from warpsim.sky.band_index import BandIndex


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
        with_streaks: Whether movement during the exposure is followed, where the scene has it.
    """

    def __init__(
        self, scene: Scene, bands: Sequence[str], device: wp.Device, with_streaks: bool = False
    ) -> None:
        self.device = device
        self.n_band = len(bands)
        self.n_target = len(scene.target_names)
        self.aiming: Aiming = make_aiming(scene, device)
        self.motion = _motion(scene, device)
        self.field: TargetField = make_target_field(scene, bands, device, with_streaks)
        self.camera = camera_struct(scene.camera)
        self.landmarks = wp.array(scene.camera.landmarks, dtype=wp.vec3d, device=device)
        self.streaks: Streaks = choose_streaks(scene, self) if with_streaks and scene.streaks else no_streaks()


class World(TargetWorld):
    """What all stages read: stars, optics and detector besides.

    Args:
        scene: The description.
        bands: Names of the bands, in the order of the images.
        device: Where everything is put.
        index: Star index of the scene's catalog at its epoch.
    """

    def __init__(self, scene: Scene, bands: Sequence[str], device: wp.Device, index: BandIndex) -> None:
        # What needs no kernel comes first: Warp is still busy with its headers.
        psfs = [scene.psf(name) for name in bands]
        self.psf: PsfBank = psf_bank(psfs, device, scene.camera.pixel_aspect, table_accuracy(scene))
        shape = (scene.camera.n_row, scene.camera.n_col)
        self.read_out: ReadOut = make_read_out(scene.detector, scene.levels, bands, scene.seed, shape, device)
        loading = kernel_loading(device)
        loading.start(self.read_out.kernel, star_kernel(scene))
        loading.share_headers()
        super().__init__(scene, bands, device, with_streaks=True)
        loading.start(self.field.observe_kernel, self.psf.deposit_kernel(self.streaks.wanted), self.aiming.kernel)
        loading.start(self.field.emit_kernel, record_targets_kernel)
        self.observation_rows = RowLayout(observation_columns(self))
        self.band_id = wp.array([scene.bands.index(name) for name in bands], dtype=wp.uint32, device=device)
        cut_w_cm2 = [scene.optics.stamp_cut_nei * scene.nei_w_cm2(band) for band in bands]
        self.stamp_rule = stamp_rule(cut_w_cm2, 0.0, device)
        loading.wait()
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


def camera_struct(camera: Camera) -> Any:
    """The camera as the kernels' struct."""
    struct: Any = CameraStruct()
    struct.n_row, struct.n_col = camera.n_row, camera.n_col
    struct.focal_px, struct.focal_row_px = camera.focal_px, camera.focal_row_px
    struct.centre_x_px, struct.centre_y_px = camera.centre_px
    if camera.lens is not None:
        lens: Any = LensStruct()
        lens.k1, lens.k2, lens.k3 = camera.lens.k1, camera.lens.k2, camera.lens.k3
        lens.p1, lens.p2, lens.limit = camera.lens.p1, camera.lens.p2, camera.distortion_radius
        struct.distortion = lens
    return struct


def table_accuracy(scene: Scene) -> TableAccuracy:
    """How good the tables are that a scene's patterns are drawn with.

    By all bands of the scene: a frame must not depend on which of them are rendered.
    """
    n_point = scene.optics.psf_points or points_of([scene.psf(name) for name in scene.bands], scene)
    return TableAccuracy(scene.optics.psf_error, n_point)


def points_of(psfs: Sequence[Psf], scene: Scene) -> int | None:
    """Points per axis between which patterns are interpolated; None for Gaussians, which have tables of their own."""
    patterns = [psf for psf in psfs if not isinstance(psf, PsfGaussian)]
    return cheapest_points(patterns, scene.camera.pixel_aspect, scene.optics.psf_error) if patterns else None
