"""Contents of the fields of view of a kind of sensor: targets, Earth, Sun, and streak lengths in an exposure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.constants import SUN_RADIUS_M
from warpsim.directions import normalised
from warpsim.optics.camera import Camera
from warpsim.orbit.earth import earth_clearance_m
from warpsim.orbit.sun import sunlit_fraction
from warpsim.scene.camera_axes import SatelliteState, apparent_mean, satellite_state
from warpsim.scene.instrument import Instrument
from warpsim.scene.tracks import Tracks

Mask = npt.NDArray[np.bool_]

MOST_VIEWS_LOOKED_AT = 2000
"""Views in which bodies are looked for."""

MOST_VIEWS_OF_STREAKS = 200
"""Views in which streaks are measured."""

MOST_STREAKS = 10_000
"""Sensors times targets whose streaks are measured there, half a millisecond for each."""

_BORDER_STEPS = 16
"""Along each edge of the frame, to see whether the Earth is in it."""


@dataclass
class FieldContents:
    """Counts of views by the contents of their fields of view."""

    n_view: int = 0
    target: int = 0
    """Views with a target in the field that access counts by."""
    earth: int = 0
    sun: int = 0
    slewing: int = 0
    counted: set[int] = field(default_factory=set)
    """Targets that access counts by."""


def field_contents(instrument: Instrument, tracks: Tracks, frames_of: Mapping[str, Sequence[int]]) -> FieldContents:
    """Count the contents of the fields of view, over some views spread over all frames of the kind's sensors."""
    found = FieldContents()
    for sensor, time_s in spread_views(instrument, frames_of, MOST_VIEWS_LOOKED_AT):
        at = satellite_state(tracks, instrument.satellites[sensor], time_s)
        axes = instrument.commanded_axes(sensor, time_s).axes
        seen = np.zeros(len(time_s), dtype=bool)
        for targets, then in counted_targets(instrument, sensor, time_s):
            found.counted |= set(targets)
            for target in targets:
                seen[then] |= target_in_field(instrument.sensor.camera, tracks, target, at.rows(then), axes[then])
        found.n_view += len(time_s)
        found.target += int(seen.sum())
        found.earth += int(earth_in_field(instrument.sensor.camera, at.position_m, axes, tracks.pole_icrs).sum())
        found.sun += int(sun_in_field(instrument.sensor.camera, tracks, at, axes).sum())
        found.slewing += int((~instrument.settled(sensor, time_s)).sum())
    return found


def spread_views(
    instrument: Instrument, frames_of: Mapping[str, Sequence[int]], most: int
) -> Iterator[tuple[int, F64]]:
    """Yield the index of each sensor of a kind, and times of its frames; some views spread over all of them."""
    own = {name: frames_of[name] for name in instrument.names if frames_of.get(name)}
    n_view = sum(map(len, own.values()))
    step = max(1, -(-n_view // most))
    before = 0
    for name, frames in own.items():
        chosen = frames[-before % step :: step]
        before += len(frames)
        if len(chosen):
            yield instrument.index(name), instrument.frame_time_s(chosen)


def counted_targets(instrument: Instrument, sensor: int, time_s: F64) -> Iterator[tuple[Sequence[int], Mask]]:
    """Yield the targets that a sensor's access counts by, and which of some times they do at."""
    steps = instrument.access_targets(sensor)
    ends = [start_s for start_s, _ in steps[1:]] + [np.inf]
    for (start_s, targets), end_s in zip(steps, ends, strict=True):
        then = (time_s >= start_s) & (time_s < end_s)
        if then.any():
            yield targets, then


def target_in_field(camera: Camera, tracks: Tracks, target: int, at: SatelliteState, axes: F64) -> Mask:
    """Return whether a target is there, in the frame and not behind the Earth, shape (n,)."""
    seen = np.einsum("nij,nj->ni", axes, apparent_mean(tracks, [target], at))
    target_m = tracks.target_state(target, at.time_s)[0]
    free = earth_clearance_m(at.position_m, target_m, tracks.pole_icrs) >= 0.0
    return np.asarray(
        (camera.frame_margin_deg(seen) >= 0.0) & tracks.exist(target, at.time_s - at.since_middle_s) & free
    )


def earth_in_field(camera: Camera, position_m: F64, axes: F64, pole_icrs: F64) -> Mask:
    """Return whether the Earth fills a part of the frame, shape (n,): it is met on the border, or its centre within."""
    border = np.einsum("bi,nij->nbj", _border(camera), axes)
    far_m = position_m[:, None] + 1e7 * border
    met = (earth_clearance_m(position_m[:, None], far_m, pole_icrs, beyond=True) < 0.0).any(axis=1)
    nadir = np.einsum("nij,nj->ni", axes, -normalised(position_m))
    return np.asarray(met | (camera.frame_margin_deg(nadir) >= 0.0))


def _border(camera: Camera) -> F64:
    """Directions of the border of the frame, in camera axes, (n, 3)."""
    along = np.linspace(-0.5, 0.5, _BORDER_STEPS + 1)
    side = np.full_like(along, 0.5)
    edges = [np.stack(pair, axis=1) for sign in (-side, side) for pair in ((along, sign), (sign, along))]
    return camera.direction(np.concatenate(edges) * [camera.n_col, camera.n_row] + camera.centre_px)


def sun_in_field(camera: Camera, tracks: Tracks, at: SatelliteState, axes: F64) -> Mask:
    """Return whether any of the Sun's disc is in the frame and not behind the Earth, shape (n,)."""
    sun_m = tracks.sun.position_at_m(at.time_s)
    sight_m = sun_m - at.position_m
    radius_deg = np.degrees(np.arcsin(SUN_RADIUS_M / np.linalg.norm(sight_m, axis=-1)))
    seen = np.einsum("nij,nj->ni", axes, normalised(sight_m))
    visible = sunlit_fraction(at.position_m, sun_m, tracks.pole_icrs) > 0.0
    return np.asarray((camera.frame_margin_deg(seen) >= -radius_deg) & visible)


def longest_streaks_px(
    instrument: Instrument, tracks: Tracks, frames_of: Mapping[str, Sequence[int]], duration_s: float, span_s: float
) -> tuple[float, float]:
    """Return the longest streaks of a star and of a target during a span about frames' times [px]; 0 for none.

    Between the ends of the span, in straight lines, without errors of pointing. Stars are looked at in the middle,
    on the edges and in the corners of the frame, targets where they are in the frame; of very many some.
    """
    longest = np.zeros(2)
    half_s = 0.5 * span_s
    views = list(spread_views(instrument, frames_of, MOST_VIEWS_OF_STREAKS))
    targets = range(0, len(tracks.targets), 1 + len(views) * len(tracks.targets) // MOST_STREAKS)
    for sensor, time_s in views:
        ends = []
        for offset_s in (-half_s, half_s):
            end_s = np.clip(time_s + offset_s, 0.0, duration_s)
            at = satellite_state(tracks, instrument.satellites[sensor], end_s, end_s - time_s)
            ends.append((at, instrument.commanded_axes(sensor, end_s, end_s - time_s).axes))
        longest = np.maximum(longest, _streaks_px(instrument.sensor.camera, tracks, targets, ends))
    return float(longest[0]), float(longest[1])


def _streaks_px(camera: Camera, tracks: Tracks, targets: Sequence[int], ends: list[tuple[SatelliteState, F64]]) -> F64:
    """Longest streaks of a star and of a target in one sensor [px]."""
    stars = np.einsum("ci,tij->ctj", camera.sample_points, ends[0][1])
    star_px = max(_way_px(camera, [star, star], ends).max(initial=0.0) for star in stars)
    target_px = 0.0
    for target in targets:
        shown = [target_in_field(camera, tracks, target, at, axes) for at, axes in ends]
        some = shown[0] | shown[1]
        if some.any():
            own = [(at.rows(some), axes[some]) for at, axes in ends]
            lines = [apparent_mean(tracks, [target], at) for at, _ in own]
            target_px = max(target_px, _way_px(camera, lines, own).max(initial=0.0))
    return np.array([star_px, target_px])


def _way_px(camera: Camera, lines: Sequence[F64], ends: list[tuple[SatelliteState, F64]]) -> F64:
    """Distances on the image between directions at the two ends, (n, 3) each; 0 behind the camera."""
    seen = [np.einsum("nij,nj->ni", axes, line) for line, (_, axes) in zip(lines, ends, strict=True)]
    positions_px = [camera.project(normalised(direction), np.eye(3))[0] for direction in seen]
    return np.asarray(np.nan_to_num(np.linalg.norm(positions_px[1] - positions_px[0], axis=-1)))
