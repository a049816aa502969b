"""What a scene would give, in words: `warpsim check`."""

from __future__ import annotations

import numpy as np

from warpsim.render.world import load_catalog
from warpsim.scene.scene import Scene


def scene_report(scene: Scene) -> str:
    """A few lines about a valid scene: size, orbits, access, and why frames would be empty.

    Raises:
        InputError: The star catalog cannot be read.
    """
    camera, detector = scene.camera, scene.detector
    n_star = len(load_catalog(scene))
    n_target, n_sensor = len(scene.target_names), len(scene.sensor_names)
    lines = [
        f"{scene.name}: valid. {n_sensor} sensors, {n_target} targets, bands {' '.join(scene.bands)}",
        f"  frames     {scene.frames.count} every {scene.frames.interval_s:g} s from {scene.frames.start_s:g} s "
        f"after {scene.epoch_utc} UTC",
        f"  camera     {camera.n_row} x {camera.n_col} pixels, "
        f"{np.degrees(1 / camera.focal_px) * 3600:.2f} arcsec per pixel",
        f"  detector   NEI {detector.nei_w_cm2:g}, SEI {detector.sei_w_cm2:g} W/cm2, {detector.bits} bits",
        f"  sky        {n_star:,} stars, catalog {scene.sky.catalog}",
        f"  orbits     nodes every {scene.tracks.step_s:g} s, interpolation error {scene.tracks.error_m * 1e3:.2g} mm",
    ]
    if detector.offset_counts < 5 * detector.counts_per_nei:
        lines.append("  warning    offset_counts is below 5 sigma: the noise of blank sky is clipped at 0")
    return "\n".join(lines + _access_lines(scene))


def _access_lines(scene: Scene) -> list[str]:
    """Access per sensor over the frames; for a sensor without any, the rule that is broken most of the time."""
    times = scene.frame_time_s(np.arange(scene.frames.count))
    margins = scene.access_margins(times)
    counts = {name: int(scene.has_access(name, times).sum()) for name in scene.sensor_names}
    seen = {name: count for name, count in counts.items() if count}
    lines = [f"  access     {len(seen)} of {len(counts)} sensors, {sum(seen.values())} of their frames"]
    if seen:
        lines.append("             " + ", ".join(f"{name} {count}" for name, count in seen.items()))
    blind = [number for number, name in enumerate(scene.sensor_names) if not counts[name]]
    if blind:
        broken = {rule: np.mean(margin[blind] < 0) for rule, margin in margins.items()}
        rules = ", ".join(f"{rule} {share:.0%}" for rule, share in sorted(broken.items(), key=lambda kv: -kv[1]))
        lines.append(f"  no access  {len(blind)} sensors; share of time that each rule is broken: {rules}")
    if not seen:
        lines.append("  warning    nothing would be rendered: no sensor has access in any frame")
    return lines
