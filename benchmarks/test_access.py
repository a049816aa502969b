"""Time of access: many satellites over a day, one target in low orbit; beside a fine scan.

    python -m pytest benchmarks/test_access.py --benchmark-json=benchmarks/results/access.json
    python benchmarks/report.py benchmarks/results/access.json

Orbits are sampled before the clock starts. The intervals of 20 of the satellites are compared with a scan at 1 s, which
evaluates every rule at every time, and each of their ends with one at 0.1 ms.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest

import warpsim as ws
from warpsim.instant import utc_time
from warpsim.orbit.access import AccessInterval, access_intervals, margins
from warpsim.orbit.gravity import propagate
from warpsim.orbit.sampling import node_grid, sample_tracks
from warpsim.orbit.sun import earth_states
from warpsim.orbit.track import Track

NODE_STEP_S = 14.0
STEP_S = 30.0
POLE = np.array([0.0, 0.0, 1.0])
RULES = {
    "Earth in the way": ws.AccessConstraints(),
    "the paper's": ws.AccessConstraints(6000, -32, 250, 60),
    "paper's, against space, sunlit": ws.AccessConstraints(
        6000, -32, 250, 60, min_background_altitude_km=100, min_target_sunlit=1.0
    ),
}


@pytest.mark.parametrize("rules", list(RULES))
@pytest.mark.parametrize("n_satellite", [100, 1000])
def test_access(benchmark, n_satellite, rules):
    full = benchmark.enabled
    n, duration_s = (n_satellite, 86400.0) if full else (20, 6000.0)
    sensors, target, sun = orbits(n, duration_s)
    arguments = sensors, target.position_at_m, sun.position_at_m, RULES[rules], POLE, duration_s, STEP_S
    found = benchmark.pedantic(access_intervals, args=arguments, rounds=5, warmup_rounds=1)
    if benchmark.stats is None:
        return
    access_s = benchmark.stats.stats.median
    benchmark.extra_info.update(
        device="cpu",
        rules=rules,
        n_satellite=n,
        step_s=STEP_S,
        n_interval=len(found),
        access_s=access_s,
        us_per_pair=access_s / n / (duration_s / STEP_S) * 1e6,
        **compared(found, sensors, target, sun, RULES[rules], duration_s),
    )


@functools.cache
def orbits(n_satellite: int, duration_s: float) -> tuple[list[Track], Track, Track]:
    """Tracks of a Walker constellation, a target in low orbit and the Sun."""
    start_s, n_node = node_grid(duration_s, NODE_STEP_S)

    def tracks(walker: ws.Walker) -> list[Track]:
        position, velocity = walker.state()
        return sample_tracks(
            walker.names, lambda t: propagate(position, velocity, t, "two_body", POLE), start_s, NODE_STEP_S, n_node
        )

    epoch = utc_time("2025-03-01T00:00:00")
    sun = sample_tracks(["sun"], lambda t: earth_states(epoch, t)[:2], start_s, NODE_STEP_S, n_node)[0]
    return (
        tracks(ws.Walker(n_satellite, 20, 1, altitude_km=1598, inclination_deg=78)),
        tracks(ws.Walker(1, 1, 0, altitude_km=700, inclination_deg=50))[0],
        sun,
    )


def compared(
    found: list[AccessInterval],
    sensors: list[Track],
    target: Track,
    sun: Track,
    rules: ws.AccessConstraints,
    duration_s: float,
) -> dict[str, float]:
    """Intervals of 20 satellites that a scan at 1 s lacks or has besides, and the worst end."""

    def holds(sensor: Track, time_s: np.ndarray) -> np.ndarray:
        place, goal, light = (track.position_at_m(time_s) for track in (sensor, target, sun))
        return np.minimum.reduce(list(margins(place[None], goal, light, rules, POLE).values()))[0] >= 0

    time_s = np.arange(0.0, duration_s + 0.5)
    n_right = lost = extra = 0
    end_error_ms = 0.0
    for number in range(0, len(sensors), len(sensors) // 20):
        inside = holds(sensors[number], time_s)
        edge = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
        right = np.stack([time_s[edge[::2]], time_s[edge[1::2] - 1]], axis=1)
        own = np.array([f[1:] for f in found if f.sensor == number]).reshape(-1, 2)
        near = np.abs(own[:, None] - right[None]).max(axis=2) < 1.01 if len(own) and len(right) else np.zeros((0, 0))
        n_right += len(right)
        lost += len(right) - int(near.any(axis=0).sum())
        # The scan itself does not see what lies between two of its points.
        unseen = np.floor(own[:, 1]) < own[:, 0] if len(own) else np.zeros(0, bool)
        extra += int((~near.any(axis=1) & ~unseen).sum()) if len(near) else int((~unseen).sum())
        for end_s, inward in [(s, 1.0) for s in own[:, 0]] + [(s, -1.0) for s in own[:, 1]]:
            if 0.0 < end_s < duration_s:
                outside_s = end_s - inward * 1e-4 * np.arange(100)
                beyond = np.flatnonzero(~holds(sensors[number], outside_s))
                end_error_ms = max(end_error_ms, 0.1 * float(beyond[0]) if len(beyond) else 10.0)
    return {"n_right": n_right, "lost": lost, "extra": extra, "end_error_ms": end_error_ms}
