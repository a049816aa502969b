"""The stages of a frame: each one launches, and does nothing else.

aim -> observe_targets -> gather_stars -> trace -> record_targets -> deposit -> read_out. A stage reads the scene, reads
and writes a chunk, allocates nothing and never waits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import warp as wp
from warpsim_kernels.emission import make_split_kernel, record_targets_kernel
from warpsim_kernels.strips import N_PAIR, STRIP_PIXELS, STRIPS_PER_BLOCK
from warpsim_kernels.trace import make_reach_kernel, make_trace_stars_kernel, make_trace_targets_kernel

from warpsim.launches import clear, launch, launch_tiled
from warpsim.render.buffers import Chunk, Observations, PathViews, Sources, Views, seen_struct
from warpsim.render.device import rows_per_block
from warpsim.render.streaks import Streaks, paths_struct

if TYPE_CHECKING:
    from warpsim.render.device_scene import DeviceBodies, DeviceScene

TILE_THREADS_CUDA = N_PAIR


def aim(scene: DeviceScene, chunk: Chunk) -> None:
    """Views: camera axes, position and velocity from the tracks and the pointing; where light moves, in between too."""
    views = chunk.views
    aim_views(scene, views)
    if views.path is not None:
        aim_views(scene, views.path)
        inputs = [views.axes, views.path.axes, scene.camera, scene.sample_points]
        kernel = make_reach_kernel(scene.field.features.distortion)
        launch(kernel, dim=chunk.n_view, inputs=inputs, outputs=[views.reach], device=scene.device)


def aim_views(scene: DeviceBodies, views: Views | PathViews) -> None:
    """The first launch of `aim`, which needs no images."""
    tracks = scene.tracks
    launch(
        scene.pointing.kernel,
        dim=views.time_s.size,
        inputs=[
            _flat(views.time_s),
            _flat(views.middle_s),
            _flat(views.sensor),
            tracks.position_m,
            tracks.velocity_m_s,
            tracks.earth_velocity_m_s,
            tracks.presence,
            tracks.grid,
            scene.pointing.struct,
        ],
        outputs=[_flat(array) for array in (views.axes, views.position_m, views.velocity_m_s, views.flags)],
        device=scene.device,
    )


def _flat(array: wp.array) -> wp.array:
    return array if array.ndim == 1 else array.flatten()


def observe_targets(scene: DeviceScene, chunk: Chunk) -> None:
    """What is seen of each target, and the first source slots: its place and light."""
    seen, sources = chunk.observations, chunk.sources
    look_at_targets(scene, chunk.views, seen, sources.xy_px, sources.area_series)
    launch(
        scene.field.emit_kernel,
        dim=(chunk.n_view, scene.field.n_lane),
        inputs=[scene.field.surfaces, scene.field.radiance, seen_struct(seen), scene.field.n_lane],
        outputs=[sources.irradiance_w_cm2],
        device=scene.device,
    )
    if scene.field.features.profile:
        launch(
            scene.field.profile_kernel,
            dim=(chunk.n_view, scene.n_band, scene.n_target),
            inputs=[scene.field.surfaces, scene.field.radiance, seen_struct(seen), sources.area_series],
            outputs=[seen.brightness],
            device=scene.device,
        )


def look_at_targets(
    scene: DeviceBodies, views: Views, seen: Observations, xy_px: wp.array, area_series: wp.array
) -> None:
    """The first launch of `observe_targets`, which needs no images; places go to xy_px, (n_view, >= n_target)."""
    tracks, field = scene.tracks, scene.field
    launch(
        field.observe_kernel,
        dim=(views.time_s.shape[0], field.n_lane),
        inputs=[
            views.time_s,
            views.axes,
            views.position_m,
            views.velocity_m_s,
            tracks.position_m,
            tracks.velocity_m_s,
            tracks.earth_velocity_m_s,
            tracks.presence,
            tracks.grid,
            field.first_row,
            field.targets,
            field.tables,
            field.exposure,
            field.surroundings,
            scene.camera,
            field.n_lane,
        ],
        outputs=[
            xy_px,
            seen.range_m,
            seen.aspect_rad,
            seen.area_m2,
            seen.sun_area_m2,
            seen.earth_area_m2,
            seen.albedo_area_m2_sr,
            seen.sunlit,
            seen.temperature_k,
            seen.flags,
            area_series,
        ],
        device=scene.device,
    )


def split_light(scene: DeviceBodies, seen: Observations, irradiance_w_cm2: wp.array) -> None:
    """Irradiance by each term into (N_TERM, n_view, n_band, n_target); for the truth, not part of a frame."""
    launch(
        make_split_kernel(scene.field.features),
        dim=irradiance_w_cm2.shape[1:],
        inputs=[scene.field.surfaces, scene.field.radiance, seen_struct(seen)],
        outputs=[irradiance_w_cm2],
        device=scene.device,
    )


def gather_stars(scene: DeviceScene, chunk: Chunk) -> None:
    """The source slots behind the targets: every star whose stamp touches the frame."""
    views, sources = chunk.views, chunk.sources
    launch(
        scene.stars.kernel,
        dim=chunk.n_view,
        inputs=[
            views.time_s,
            views.axes,
            views.position_m,
            views.velocity_m_s,
            scene.stars.field,
            scene.stars.orbit,
            scene.camera,
            scene.field.surroundings.earth,
            scene.n_target,
            views.reach,
        ],
        outputs=[
            sources.xy_px,
            sources.irradiance_w_cm2,
            sources.star,
            sources.direction,
            sources.n_source,
            views.n_wanted,
        ],
        device=scene.device,
    )


def trace(scene: DeviceScene, chunk: Chunk) -> None:
    """Sources: how they move during the exposure, where they do."""
    path = chunk.views.path
    if path is not None:
        trace_sources(scene, scene.streaks, path, chunk.sources)


def trace_sources(scene: DeviceBodies, streaks: Streaks, path: PathViews, sources: Sources) -> None:
    """The launches of `trace`."""
    tracks, (n_view, n_slot) = scene.tracks, sources.xy_px.shape
    launch(
        make_trace_targets_kernel(scene.field.features.distortion),
        dim=(n_view, scene.n_target),
        inputs=[
            path.time_s,
            path.axes,
            path.position_m,
            path.velocity_m_s,
            tracks.position_m,
            tracks.velocity_m_s,
            tracks.earth_velocity_m_s,
            tracks.presence,
            tracks.grid,
            scene.field.first_row,
            scene.camera,
            streaks.instants,
            sources.xy_px,
        ],
        outputs=[sources.offset_px],
        device=scene.device,
    )
    launch(
        make_trace_stars_kernel(scene.field.features.distortion),
        dim=(n_view, n_slot - scene.n_target),
        inputs=[
            path.axes,
            scene.camera,
            streaks.instants,
            scene.n_target,
            sources.n_source,
            sources.xy_px,
            sources.direction,
        ],
        outputs=[sources.offset_px],
        device=scene.device,
    )


def record_targets(scene: DeviceScene, chunk: Chunk) -> None:
    """Observations: what of the source list belongs to targets."""
    sources, seen = chunk.sources, chunk.observations
    launch(
        record_targets_kernel,
        dim=(chunk.n_view, scene.field.n_lane),
        inputs=[sources.xy_px, sources.irradiance_w_cm2, sources.offset_px, scene.field.n_lane],
        outputs=[seen.xy_px, seen.irradiance_w_cm2, seen.offset_px],
        device=scene.device,
    )


def deposit(scene: DeviceScene, chunk: Chunk) -> None:
    """Signal: the light of all sources, integrated over pixels."""
    sources, signal = chunk.sources, chunk.light.signal_w_cm2  # dark
    lists = [sources.n_source, sources.xy_px, sources.irradiance_w_cm2]
    paths = None
    if scene.streaks.wanted:
        paths = paths_struct(sources.offset_px, chunk.observations.brightness, scene.n_target)
    n_row_per_block = rows_per_block(scene.device, signal.shape[2])
    scene.psf.deposit(lists, scene.stamp_rule, n_row_per_block, signal, paths, chunk.light.lit)


def read_out(scene: DeviceScene, chunk: Chunk) -> None:
    """Counts: what the detector makes of the signal."""
    n_view, n_band, n_row, n_col = chunk.counts.shape
    n_image, n_pixel = n_view * n_band, n_row * n_col
    n_strip = n_pixel // STRIP_PIXELS
    light, counts = chunk.light, chunk.counts
    inputs = [chunk.views.frame, chunk.views.sensor, scene.band_id, scene.read_out.detector]
    keep = int(chunk.keep_light)
    block_dim = TILE_THREADS_CUDA if scene.device.is_cuda else 1
    if n_strip:
        launch_tiled(
            scene.read_out.kernel,
            dim=[n_image * -(-n_strip // STRIPS_PER_BLOCK)],
            inputs=[*inputs, 0, n_strip, light.dark_place, keep, light.flat, light.lit.flatten()],
            outputs=[counts.flatten()],
            block_dim=block_dim,
            device=scene.device,
        )
    if n_strip * STRIP_PIXELS < n_pixel:
        shape = (n_image, n_pixel)
        launch_tiled(
            scene.read_out.rest_kernel,
            dim=[n_image],
            inputs=[*inputs, n_strip, n_strip + 1, 0, keep, light.signal_w_cm2.reshape(shape), light.lit.flatten()],
            outputs=[counts.reshape(shape)],
            block_dim=block_dim,
            device=scene.device,
        )
    if not chunk.keep_light:
        clear(light.lit)


VIEW_STAGES = (aim, observe_targets, gather_stars, trace, record_targets)
"""What is done for all views of a chunk at a time."""

IMAGE_STAGES = (deposit, read_out)
"""What is done for few images at a time, whose light then stays in the cache from one to the other."""
