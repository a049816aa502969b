"""A scene is put on a device: makers of what stays the same from frame to frame."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.apparent import Presence
from warpsim_kernels.apparent import Tracks as TracksStruct
from warpsim_kernels.camera import Camera as CameraStruct
from warpsim_kernels.camera import Distortion as LensStruct
from warpsim_kernels.motion import BodyNodes, NodeGrid, Nodes
from warpsim_kernels.records import Sources, View
from warpsim_kernels.trace import Instants

from warpsim.arrays import F64
from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.launches import struct_of, to_numpy
from warpsim.legendre import series_at
from warpsim.optics.camera import Camera
from warpsim.optics.psf import PsfGaussian
from warpsim.optics.psf_bank import PsfBank, stamp_rule
from warpsim.optics.tables import TableAccuracy, cheapest_layout
from warpsim.orbit.track import TrackStack
from warpsim.render.background import make_background
from warpsim.render.batch import new_inputs
from warpsim.render.buffers import new_exposure
from warpsim.render.device import kernel_loading
from warpsim.render.device_artifacts import band_ids, make_artifacts
from warpsim.render.device_scene import DeviceBodies, DeviceScene, Streaks, make_roll, streaks_at
from warpsim.render.device_stars import make_stars, star_features, star_kernel, star_threads
from warpsim.render.pointing_arrays import make_pointing
from warpsim.render.read_out import make_read_out
from warpsim.render.stages import aim, image_kernels, trace
from warpsim.render.target_field import make_target_field
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario
from warpsim.scene.tracks import Tracks
from warpsim.sky.band_index import BandIndex

_ENDLESS_S = 1e300


def make_device_bodies(
    scenario: Scenario,
    instrument: Instrument,
    bands: Sequence[str],
    device: wp.Device,
    with_streaks: bool = False,
) -> DeviceBodies:
    """Put tracks, pointing and targets on a device."""
    camera = instrument.sensor.camera
    still = DeviceBodies(
        instrument,
        device,
        list(bands),
        len(scenario.targets),
        *make_pointing(instrument, device),
        tracks_struct(scenario.tracks, instrument.satellites, device),
        make_target_field(scenario, instrument, bands, device, with_streaks),
        camera_struct(camera),
        wp.array(camera.sample_points, dtype=wp.vec3d, device=device),
        Streaks(0, 0.0, np.zeros(0), Instants()),
    )
    if not (with_streaks and instrument.sensor.streaks):
        return still
    return dataclasses.replace(still, streaks=choose_streaks(scenario.scene.duration_s, still))


def make_device_scene(
    scenario: Scenario, instrument: Instrument, bands: Sequence[str], device: wp.Device, index: BandIndex
) -> DeviceScene:
    """Put all that the stages read on a device."""
    # What needs no kernel comes first: Warp is still busy with its headers.
    sensor = instrument.sensor
    psfs = [instrument.psf(name) for name in bands]
    psf = PsfBank(psfs, device, sensor.camera.pixel_aspect, table_accuracy(instrument))
    read_out = make_read_out(instrument, bands, device)
    loading = kernel_loading(device)
    loading.start(star_kernel(star_features(scenario.scene.sky, sensor), device), block_dim=star_threads(device))
    if device.is_cpu:  # which has no other
        loading.start(read_out.kernel)
    loading.share_headers()
    bodies = make_device_bodies(scenario, instrument, bands, device, with_streaks=True)
    loading.start(bodies.field.observe_kernel, bodies.aim_kernel)
    for kernel, n_thread in image_kernels(bodies, psf, read_out):
        loading.start(kernel, block_dim=n_thread)
    cut = stamp_rule([sensor.optics.stamp_cut_nei * instrument.nei_w_cm2(band) for band in bands], 0.0, device)
    loading.wait()
    stars = make_stars(scenario, instrument, bands, index, psf, cut, bodies.tracks.grid)
    of_bodies = {field.name: getattr(bodies, field.name) for field in dataclasses.fields(bodies)}
    background = make_background(scenario, instrument, bands, device)
    own = {"stars": stars, "band_id": band_ids(instrument, bands, device), "stamp_rule": cut, "background": background}
    own["artifacts"] = make_artifacts(instrument, bands, read_out.detector.keys, device)
    return DeviceScene(**of_bodies, psf=psf, read_out=read_out, **own)


def with_pointing(scene: DeviceScene, instrument: Instrument) -> DeviceScene:
    """Return a scene whose sensors point as those of a commanded instrument; streaks are followed as before."""
    kernel, pointing = make_pointing(instrument, scene.device)
    return dataclasses.replace(scene, instrument=instrument, aim_kernel=kernel, pointing=pointing)


def tracks_struct(tracks: Tracks, satellites: Sequence[int], device: wp.Device) -> Any:
    """Return tracks as the kernels' struct: a row for each sensor, then one for each target."""
    bodies = [*(tracks.satellites[index] for index in satellites), *tracks.targets]
    stack, sun = TrackStack(bodies), tracks.sun
    rows = np.zeros(len(bodies), dtype=BodyNodes.numpy_dtype())
    rows["grid"]["start_s"], rows["grid"]["step_s"], rows["grid"]["n_node"] = stack.start_s, stack.step_s, stack.n_node
    rows["first"], rows["steps_per_m"] = stack.first, 1.0 / (SPEED_OF_LIGHT_M_S * stack.step_s)
    # On a CPU the arrays are those of the stack, which nobody else has.
    position_m, velocity_m_s = (
        wp.array(nodes, dtype=wp.vec3d, device=device, copy=False) for nodes in (stack.node_m, stack.node_m_s)
    )
    n_sensor = len(satellites)
    release_s = np.concatenate([np.full(n_sensor, -np.inf), tracks.release_s])
    exists_s = np.concatenate([np.full((n_sensor, 2), [-np.inf, np.inf]), tracks.exists_s])
    presence = struct_of(
        Presence,
        device,
        release_s=np.maximum(release_s, -_ENDLESS_S),
        carrier=np.concatenate([np.arange(n_sensor), n_sensor + tracks.carrier]),
        exists_s=np.clip(exists_s, -_ENDLESS_S, _ENDLESS_S),
    )
    return struct_of(
        TracksStruct,
        device,
        earth_velocity_m_s=tracks.earth_velocity_m_s,
        nodes=struct_of(Nodes, device, bodies=rows, position_m=position_m, velocity_m_s=velocity_m_s),
        presence=presence,
        grid=struct_of(NodeGrid, start_s=sun.start_s, step_s=sun.step_s, n_node=sun.n_node),
        first_target=n_sensor,
    )


def camera_struct(camera: Camera) -> Any:
    """The camera as the kernels' struct."""
    names = ("n_row", "n_col", "focal_px", "focal_row_px")
    struct = struct_of(CameraStruct, **{name: getattr(camera, name) for name in names})
    struct.centre_x_px, struct.centre_y_px = camera.centre_px
    if camera.lens is not None:
        terms = {name: getattr(camera.lens, name) for name in ("k1", "k2", "k3", "p1", "p2")}
        struct.distortion = struct_of(LensStruct, **terms, limit=camera.distortion_radius)
    return struct


def table_accuracy(instrument: Instrument) -> TableAccuracy:
    """Return how good the tables are that an instrument's patterns are drawn with.

    By all its bands: a frame must not depend on which of them are rendered.
    """
    optics, camera = instrument.sensor.optics, instrument.sensor.camera
    accuracy = TableAccuracy(optics.psf_error)
    psfs = [instrument.psf(name) for name in instrument.sensor.bands]
    patterns = [psf for psf in psfs if not isinstance(psf, PsfGaussian)]
    if not patterns:  # Gaussians have tables of their own
        return accuracy
    layout = cheapest_layout(patterns, camera.pixel_aspect, accuracy)
    return TableAccuracy(optics.psf_error, layout.n_point or None, layout.degree)


NODE_COUNTS = (3, 5, 9, 17, 33, 65)
"""Odd, so that one node lies in the middle; all but the last may be chosen."""

PATH_ERROR_PX = 1e-3
"""Largest distance of a source from its path at any time of the exposure."""

_MOST_FRAMES, _MOST_SENSORS, _MOST_BREAK_VIEWS = 24, 12, 288
_INSTANTS = np.linspace(-1.0, 1.0, 65)


def choose_streaks(duration_s: float, scene: DeviceBodies) -> Streaks:
    """Return the fewest instants that keep positions within PATH_ERROR_PX, else 33, on targets and on a still sky.

    A rule is judged by the next finer one, on frames and sensors spread over the scene, and on frames at the steps and
    slews of the cameras: with their own axes, so that whatever turns the camera counts, its jitter too.
    """
    instrument, sensor_kind = scene.instrument, scene.instrument.sensor
    camera, span_s = sensor_kind.camera, sensor_kind.window_s
    time_s, sensor = _sample(instrument, duration_s)
    rules = [streaks_at(count, span_s, scene.device) for count in NODE_COUNTS]
    paths = (_paths_px(camera, scene, rule, time_s, sensor) for rule in rules)
    for count, (one, other) in zip(NODE_COUNTS, pairwise(paths), strict=False):
        error_px = _largest_shift_px(camera, one, other)
        streaks = streaks_at(count, span_s, scene.device, error_px)
        if error_px <= PATH_ERROR_PX:
            break
    if sensor_kind.rolls:
        streaks = dataclasses.replace(streaks, roll=make_roll(sensor_kind, streaks.instants, scene.device))
    return streaks


def _sample(instrument: Instrument, duration_s: float) -> tuple[F64, npt.NDArray[np.uint32]]:
    """Times and sensors of the views to measure on, (n_view,) each."""
    spread_s = instrument.frame_time_s(_spread(instrument.frames.count, _MOST_FRAMES))
    sensors = _spread(len(instrument.names), _MOST_SENSORS)
    at_breaks = [(number, sensor) for sensor in sensors for number in _break_frames(instrument, int(sensor))]
    chosen = np.array(at_breaks, dtype=np.int64).reshape(-1, 2)[_spread(len(at_breaks), _MOST_BREAK_VIEWS)]
    time_s = np.concatenate([np.repeat(spread_s, len(sensors)), instrument.frame_time_s(chosen[:, 0])])
    sensor = np.concatenate([np.tile(sensors, len(spread_s)), chosen[:, 1]]).astype(np.uint32)
    return time_s[time_s <= duration_s], sensor[time_s <= duration_s]


def _spread(count: int, most: int) -> npt.NDArray[np.int64]:
    """Some of so many numbers from 0 on."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


def _break_frames(instrument: Instrument, sensor: int) -> list[int]:
    """The frames before and after each time at which a camera jumps or turns at another rate, and each time between."""
    frames, steps = instrument.frames, instrument.program.sensors[sensor].steps
    ends_s = [step.start_s + turn.duration_s for step, turn in zip(steps, instrument.turns(sensor), strict=True)]
    breaks_s = np.unique([*instrument.program.breaks_s(sensor), *(end_s for end_s in ends_s if np.isfinite(end_s))])
    number = (np.concatenate([breaks_s, 0.5 * (breaks_s[1:] + breaks_s[:-1])]) - frames.start_s) / frames.interval_s
    near = np.unique([np.floor(number), np.ceil(number)])
    return [int(one) for one in near if 0 <= one < frames.count]


def _paths_px(camera: Camera, scene: DeviceBodies, rule: Streaks, time_s: F64, sensor: npt.NDArray[np.uint32]) -> F64:
    """Paths of all targets, and of stars at the sample points of the frame, (n_view, n_source, 2, n_instant)."""
    device, n_view = scene.device, len(time_s)
    inputs = new_inputs(device, time_s, np.zeros(n_view), sensor)
    views, exposure = wp.zeros(n_view, dtype=View, device=device), new_exposure(device, rule.offset_s, n_view)
    aim(scene, inputs, views, exposure).run()
    stars = np.einsum("ci,vij->vcj", camera.sample_points, to_numpy(views)["axes"])
    n_source = scene.n_target + stars.shape[1]
    sources = struct_of(
        Sources,
        device,
        n_source=np.full(n_view, n_source),
        xy_px=np.zeros((n_view, n_source, 2)),  # series are of positions themselves
        direction=np.concatenate([np.zeros((n_view, scene.n_target, 3)), stars], axis=1),
        offset_px=wp.empty((n_view, n_source, rule.n_path), dtype=wp.vec2, device=device),
    )
    targets = wp.empty((n_view, scene.n_target, rule.n_path), dtype=wp.vec2, device=device)
    trace(scene, rule, exposure, sources, targets).run()
    series = np.asarray(to_numpy(sources.offset_px), dtype=np.float64)
    return series_at(np.moveaxis(series, -1, -2), _INSTANTS)


def _largest_shift_px(camera: Camera, one: F64, other: F64) -> float:
    """Largest distance of two paths, of sources that pass the frame or come near."""
    far = np.array([[camera.n_col], [camera.n_row]])
    near = np.all((other > -far) & (other < 2 * far), axis=-2, keepdims=True)
    return float(np.abs(np.where(near, one - other, 0.0)).max(initial=0.0))
