"""The stages of a frame: each function returns the launches of one, over arrays that are there.

aim -> observe_targets -> gather_stars -> trace -> deposit -> artifacts -> read_out. Of a detector that is read row by
row, light is found at the rows' times: aim -> gather_stars -> locate_targets -> trace -> roll -> observe_targets. Where
the threads of a block share memory, and nothing moves during the exposure nor adds charge, find_spots ->
deposit_read_out stand for the last three. A stage launches, and does nothing else: it allocates nothing and never
waits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import warp as wp
from warpsim_kernels.artifacts import add_flicker_kernel, add_hits_kernel
from warpsim_kernels.background import add_image_kernel, image_of_targets_kernel, stray_light_kernel
from warpsim_kernels.canvas import N_PAIR, STRIP_PIXELS, STRIPS_PER_BLOCK
from warpsim_kernels.deposit_read_out import RUN_PIXELS, make_deposit_read_out_kernel
from warpsim_kernels.emission import make_split_kernel
from warpsim_kernels.rolling import make_locate_targets_kernel, roll_stars_kernel, roll_targets_kernel
from warpsim_kernels.spots import make_find_spots_kernel
from warpsim_kernels.trace import (
    make_reach_kernel,
    make_trace_stars_kernel,
    make_trace_targets_kernel,
    spread_views_kernel,
)

from warpsim.detector.hits_and_flicker import has_artifacts
from warpsim.launches import THREADS_PER_BLOCK_CUDA, Launch, Stage
from warpsim.optics.psf_bank import PsfBank, paths_struct
from warpsim.render.batch import Columns, Inputs
from warpsim.render.buffers import BackgroundNodes, ExposureViews, RowViews, Signal, TimedViews, ViewArrays
from warpsim.render.device import rows_per_block
from warpsim.render.device_artifacts import FLICKER, HIT, DeviceArtifacts
from warpsim.render.device_scene import Streaks
from warpsim.render.device_stars import star_kernel, star_threads

if TYPE_CHECKING:
    from warpsim.render.device_scene import DeviceBodies, DeviceScene
    from warpsim.render.read_out import ReadOut

TILE_THREADS_CUDA = N_PAIR

RUN_THREADS = 128
"""Threads that draw and read out a run of pixels. On an H200 256 take 1.35 times as long, and 64 take 1.2 times."""


def view_stages(scene: DeviceScene, own: ViewArrays) -> list[Stage]:
    """Return the stages that find the sources of views."""
    stages = target_stages(scene, own)
    stars = gather_stars(scene, own.inputs, own.columns.views, own.sources)
    stages.insert(1 if own.rows is not None else 2, stars)
    return stages


def target_stages(scene: DeviceBodies, own: ViewArrays) -> list[Stage]:
    """Return the stages that find targets alone."""
    inputs, columns, sources, rows = own.inputs, own.columns, own.sources, own.rows
    first = aim(scene, inputs, columns.views, own.exposure)
    targets = observe_targets(scene, inputs, columns, sources, own.area_series, rows)
    if own.exposure is None:
        return [first, targets]
    if rows is None:
        return [first, targets, trace(scene, scene.streaks, own.exposure, sources, columns.offset_px)]
    paths = trace(scene, scene.streaks, own.exposure, rows.sources, columns.offset_px)
    found = roll(scene, inputs, columns, sources, rows)
    return [first, locate_targets(scene, own.exposure, sources), paths, found, targets]


def aim(scene: DeviceBodies, inputs: Inputs, views: wp.array, exposure: ExposureViews | None = None) -> Stage:
    """Views: camera axes, position and velocity from the tracks and the pointing; where light moves, in between too."""
    launches = [_aim(scene, TimedViews(inputs.time_s, inputs.time_s, inputs.sensor, views))]
    if exposure is not None:
        at, when = exposure, [exposure.time_s, exposure.middle_s, exposure.sensor]
        reads, device = [inputs.time_s, inputs.sensor, at.offset_s], scene.device
        reach = make_reach_kernel(scene.field.features.distortion)
        launches += [
            Launch(spread_views_kernel, at.time_s.shape, reads, when, device),
            _aim(scene, at),
            Launch(reach, views.shape, [at.views, scene.camera, scene.sample_points], [views], device),
        ]
    return Stage("aim", len(views), launches)


def _aim(scene: DeviceBodies, own: TimedViews) -> Launch:
    times = [own.time_s.flatten(), own.middle_s.flatten(), own.sensor.flatten()]
    reads = [*times, scene.tracks, scene.pointing]
    return Launch(scene.aim_kernel, (own.time_s.size,), reads, [own.views.flatten()], scene.device)


def observe_targets(
    scene: DeviceBodies,
    inputs: Inputs,
    columns: Columns,
    sources: Any,
    area_series: wp.array,
    rows: RowViews | None = None,
) -> Stage:
    """Observe each target, at its row's time where that has one, and fill the first source slots."""
    field, n_view, device = scene.field, len(columns.views), scene.device
    bodies, seen, n_thread = field.bodies, columns.observations, field.threads_per_view
    time_s, views = inputs.time_s, columns.views
    if rows is not None:
        time_s, views = rows.time_s.flatten(), rows.views.flatten()
    reads = [time_s, views, scene.tracks, bodies, scene.camera, n_thread]
    writes = [sources, seen, columns.irradiance_w_cm2, area_series]
    launches = [Launch(field.observe_kernel, (n_view, n_thread), reads, writes, device)]
    if field.profile_kernel is not None:
        dim, reads = (n_view, scene.n_band, scene.n_target), [bodies.surfaces, bodies.radiance, seen, area_series]
        launches.append(Launch(field.profile_kernel, dim, reads, [columns.brightness], device))
    return Stage("observe_targets", n_view, launches)


def split_light(scene: DeviceBodies, observations: wp.array, irradiance_w_cm2: wp.array) -> Stage:
    """Irradiance by each term into (N_TERM, n_view, n_band, n_target); for the truth, not part of a frame."""
    _, n_view, n_band, n_target = irradiance_w_cm2.shape
    kernel = make_split_kernel(scene.field.features)
    inputs = [scene.field.bodies.surfaces, scene.field.bodies.radiance, observations]
    launch = Launch(kernel, (n_view, n_band, n_target), inputs, [irradiance_w_cm2], scene.device)
    return Stage("split_light", n_view, [launch])


def gather_stars(scene: DeviceScene, inputs: Inputs, views: wp.array, sources: Any) -> Stage:
    """The source slots behind the targets: every star whose stamp touches the frame."""
    stars, earth = scene.stars, scene.field.bodies.surroundings.earth
    reads = [inputs.time_s, stars.field, stars.orbit, scene.camera, earth, scene.n_target]
    kernel, n_thread = star_kernel(stars.features, scene.device), star_threads(scene.device)
    launch = Launch(kernel, views.shape, reads, [views, sources], scene.device, n_thread)
    return Stage("gather_stars", len(views), [launch])


def trace(
    scene: DeviceBodies, streaks: Streaks, exposure: ExposureViews, sources: Any, offset_px: wp.array | None
) -> Stage:
    """Sources: how they move during the exposure."""
    n_view, n_slot = sources.xy_px.shape
    n_target, camera, device = scene.n_target, scene.camera, scene.device
    distortion, views, instants = scene.field.features.distortion, exposure.views, streaks.instants
    of_targets, of_stars = make_trace_targets_kernel(distortion), make_trace_stars_kernel(distortion)
    reads, writes = [exposure.time_s, views, scene.tracks, camera, instants], [sources, offset_px]
    launches = [
        Launch(of_targets, (n_view, n_target), reads, writes, device),
        Launch(of_stars, (n_view, n_slot - n_target), [views, camera, instants, n_target], [sources], device),
    ]
    return Stage("trace", n_view, launches)


def locate_targets(scene: DeviceBodies, exposure: ExposureViews, sources: Any) -> Stage:
    """Positions of the targets at the frame's time: of detectors read row by row, where light is found later."""
    kernel, n_view = make_locate_targets_kernel(scene.field.features.distortion), len(sources.n_source)
    reads = [exposure.time_s, exposure.views, scene.tracks, scene.camera]
    launch = Launch(kernel, (n_view, scene.n_target), reads, [sources], scene.device)
    return Stage("locate_targets", n_view, [launch])


def roll(scene: DeviceBodies, inputs: Inputs, columns: Columns, sources: Any, rows: RowViews) -> Stage:
    """Sources at the times of their rows, of paths over those of all rows; and the targets' own views then."""
    n_view, n_slot = sources.xy_px.shape
    n_target, device, row_roll, window_px = scene.n_target, scene.device, scene.streaks.roll, rows.sources.offset_px
    reads, times = [inputs.time_s, inputs.sensor, row_roll, window_px], [rows.time_s, rows.middle_s, rows.sensor]
    writes = [sources, columns.offset_px, columns.row_time_s, *times]
    launches = [
        Launch(roll_targets_kernel, (n_view, n_target), reads, writes, device),
        Launch(roll_stars_kernel, (n_view, n_slot - n_target), [row_roll, window_px, n_target], [sources], device),
        _aim(scene, rows),
    ]
    return Stage("roll", n_view, launches)


def background(
    scene: DeviceScene, inputs: Inputs, columns: Columns, sources: Any, nodes: BackgroundNodes, signal: Signal
) -> Stage:
    """Signal: what lies behind all sources; and how bright it is behind each target."""
    own, n_view = scene.background, len(columns.views)
    assert own is not None
    n_image, (n_row, n_col) = n_view * scene.n_band, signal.images.shape[2:]
    sky, earth = nodes.sky_w_cm2[:n_view], nodes.earth_km[:n_view]
    reads, writes = [own.struct, sky, earth, n_col, n_row], [signal.flat, signal.touched.flatten()]
    launches = [Launch(own.add_kernel, [n_image * n_row], reads, writes, scene.device, own.n_thread)]
    if own.image_w_cm2 is not None:
        reads = [own.image_w_cm2.flatten(), n_row * n_col, scene.n_band]
        launches.append(Launch(add_image_kernel, [n_image * n_row * n_col], reads, [signal.flat], scene.device))
    behind = background_of_targets(scene, inputs, columns, sources, nodes)
    return Stage("background", n_view, [*behind.launches, *launches])


def background_of_targets(
    scene: DeviceScene, inputs: Inputs, columns: Columns, sources: Any, nodes: BackgroundNodes
) -> Stage:
    """Nodes of what lies behind all sources, and how bright it is behind each target."""
    own, n_view = scene.background, len(columns.views)
    assert own is not None
    sky, earth = nodes.sky_w_cm2[:n_view], nodes.earth_km[:n_view]
    stray, views = nodes.stray_w_cm2_sr[:n_view], [inputs.time_s, columns.views, own.struct]
    dim, out, device = (n_view, scene.n_target), [columns.background_w_cm2], scene.device
    launches = [Launch(stray_light_kernel, (n_view,), views, [stray], device)] if own.stray else []
    launches += [
        Launch(own.nodes_kernel, (n_view, own.n_node), [*views, stray], [sky, earth], device),
        Launch(own.targets_kernel, dim, [sources.xy_px, own.struct, sky, earth], out, device),
    ]
    if own.image_w_cm2 is not None:
        launches.append(Launch(image_of_targets_kernel, dim, [sources.xy_px, own.image_w_cm2], out, device))
    return Stage("background_of_targets", n_view, launches)


def deposit(scene: DeviceScene, sources: Any, brightness: wp.array | None, signal: Signal) -> Stage:
    """Signal: the light of all sources, integrated over pixels."""
    lists = [sources.n_source, sources.xy_px, sources.irradiance_w_cm2]
    paths = None
    if scene.streaks.enabled:
        paths = paths_struct(sources.offset_px, brightness, scene.n_target)
    images = signal.images  # zeros
    n_row_per_block = rows_per_block(scene.device, images.shape[2], len(images) * scene.n_band)
    launch = scene.psf.deposit(lists, scene.stamp_rule, n_row_per_block, images, paths, signal.touched)
    return Stage("deposit", len(images), [launch])


def artifacts(own: DeviceArtifacts, inputs: Inputs, signal: Signal, only: int = HIT | FLICKER) -> Stage:
    """Signal: the charge of hits and of flickering pixels, as irradiance."""
    n_view = len(signal.images)
    n_image = n_view * len(own.band_id)
    reads = [inputs.frame, inputs.sensor, own.band_id, own.key]
    writes, device = [signal.flat, signal.touched.flatten()], own.key.device
    launches = []
    if own.flicker is not None and only & FLICKER:
        dim = [n_image * own.flicker.n_most]
        launches.append(Launch(add_flicker_kernel, dim, [*reads, own.flicker, own.n_row * own.n_col], writes, device))
    if own.hits is not None and only & HIT:
        reads = [*reads, own.hits, own.n_col, own.n_row]
        launches.append(Launch(add_hits_kernel, [n_image], reads, writes, device))
    return Stage("artifacts", n_view, launches)


def read_out(scene: DeviceScene, inputs: Inputs, signal: Signal, counts: wp.array, first_view: int) -> Stage:
    """Counts, from first_view on: what the detector makes of the signal, which is 0 afterwards."""
    n_view, n_band, n_row, n_col = signal.images.shape
    n_image, n_pixel = n_view * n_band, n_row * n_col
    n_strip = n_pixel // STRIP_PIXELS
    views = [inputs.frame, inputs.sensor, scene.band_id, scene.read_out.detector]
    first_image, touched = first_view * n_band, signal.touched.flatten()
    block_dim = TILE_THREADS_CUDA if scene.device.is_cuda else 1
    launches = []
    if n_strip:
        dim = [n_image * -(-n_strip // STRIPS_PER_BLOCK)]
        reads = [*views, 0, n_strip, signal.zero_strip, first_image, touched]
        writes = [counts.flatten(), signal.flat]
        launches.append(Launch(scene.read_out.kernel, dim, reads, writes, scene.device, block_dim))
    if n_strip * STRIP_PIXELS < n_pixel:
        reads = [*views, n_strip, n_strip + 1, 0, first_image, touched]
        writes = [counts.reshape(_image_shape(counts)), signal.images.reshape((n_image, n_pixel))]
        launches.append(Launch(scene.read_out.rest_kernel, [n_image], reads, writes, scene.device, block_dim))
    return Stage("read_out", n_view, launches)


def is_read_out_at_once(scene: DeviceBodies) -> bool:
    """Return whether deposit_read_out replaces deposit and read_out: on CUDA, for still sources and whole strips.

    Where every pixel has light of a background, and where charge is added to it, signal is in memory; the user's maps
    are read by strips.
    """
    camera, detector = scene.instrument.sensor.camera, scene.instrument.sensor.detector
    whole = camera.n_row * camera.n_col % STRIP_PIXELS == 0
    in_memory = scene.streaks.enabled or scene.instrument.background.is_on or has_artifacts(detector)
    return scene.device.is_cuda and not (in_memory or detector.maps_file is not None) and whole


def image_kernels(scene: DeviceBodies, psf: PsfBank, read_out: ReadOut) -> list[tuple[wp.Kernel, int]]:
    """Kernels that make counts of sources, unless signal is kept, and the threads of their blocks on CUDA."""
    if is_read_out_at_once(scene):
        at_once = make_deposit_read_out_kernel(psf.spots, read_out.features, RUN_THREADS)
        return [(make_find_spots_kernel(psf.spots), THREADS_PER_BLOCK_CUDA), (at_once, RUN_THREADS)]
    drawn = psf.deposit_kernel(scene.streaks.enabled)
    return [(drawn, THREADS_PER_BLOCK_CUDA), (read_out.kernel, TILE_THREADS_CUDA)]


def find_spots(scene: DeviceScene, sources: Any, spots: wp.array) -> Stage:
    """Spots: what deposit_read_out has to know of each source, found once for all the pixels that it reaches."""
    camera = scene.instrument.sensor.camera
    reads = [sources, scene.psf.tables, scene.stamp_rule, camera.n_row, camera.n_col]
    launch = Launch(make_find_spots_kernel(scene.psf.spots), spots.shape, reads, [spots], scene.device)
    return Stage("find_spots", len(spots), [launch])


def deposit_read_out(scene: DeviceScene, inputs: Inputs, sources: Any, spots: wp.array, counts: wp.array) -> Stage:
    """Counts of all views at once; their signal is never kept."""
    camera = scene.instrument.sensor.camera
    kernel = make_deposit_read_out_kernel(scene.psf.spots, scene.read_out.features, RUN_THREADS)
    n_run = len(spots) * scene.n_band * -(-camera.n_row * camera.n_col // RUN_PIXELS)
    reads = [inputs.frame, inputs.sensor, scene.band_id, scene.read_out.detector, sources.n_source, spots]
    launch = Launch(kernel, [n_run], [*reads, scene.psf.tables], [counts.flatten()], scene.device, RUN_THREADS)
    return Stage("deposit_read_out", len(spots), [launch])


def counts_for(stage: Stage, counts: wp.array) -> list[wp.array]:
    """Return counts, (n_view, n_band, n_row, n_col), as each launch of a read-out takes them.

    They do not keep the memory: a launch holds its arguments until the next pass, a result only as long as its owner.
    """
    flat, by_image = (counts.size,), _image_shape(counts)
    shapes = [flat if launch.outputs[0].ndim == 1 else by_image for launch in stage.launches]
    return [wp.array(ptr=counts.ptr, dtype=counts.dtype, shape=shape, device=counts.device) for shape in shapes]


def _image_shape(counts: wp.array) -> tuple[int, int]:
    n_view, n_band, n_row, n_col = counts.shape
    return n_view * n_band, n_row * n_col


def read_out_into(stage: Stage, counts: Sequence[wp.array]) -> None:
    """Have a read-out write other counts, given as `counts_for` does."""
    for launch, array in zip(stage.launches, counts, strict=True):
        launch.set_output(0, array)
