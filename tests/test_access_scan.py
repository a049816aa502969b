"""Access in `stss` against a scan at 1 s whose geometry is erfa's: pole, Sun, heights along the line of sight."""

from __future__ import annotations

import erfa
import numpy as np
import pytest
from astropy.time import Time, TimeDelta

RESOLUTION_S = 1.1e-3  # ends are halved down to the promised 1 ms and off by up to all of it; the rest is for rounding


def to_true_equator(scene):
    """Rotation from GCRS axes to those of the true pole of date at the epoch."""
    tt = scene.epoch.tt
    return erfa.pnm06a(tt.jd1, tt.jd2)


def sun_m(scene, time_s):
    when: Time = (scene.epoch + TimeDelta(time_s, format="sec")).tdb
    return -erfa.epv00(when.jd1, when.jd2)[0]["p"] * erfa.DAU


def lowest_altitude_m(start, end):
    """Heights by erfa's geodesy at points of segments (n, 3): coarse, then fine about the lowest."""
    low, high = np.zeros(len(start)), np.ones(len(start))
    for _ in range(4):
        share = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, 33)
        points = start[:, None] + share[..., None] * (end - start)[:, None]
        height = erfa.gc2gd(1, points.reshape(-1, 3))[2].reshape(share.shape)
        place = height.argmin(axis=1)
        low, high = (share[np.arange(len(share)), np.clip(place + k, 0, 32)] for k in (-1, 1))
    return height.min(axis=1)


def allowed(scene, sensor, time_s):
    """Table 4's rules, one by one, and the Earth."""
    place, target = (scene.position_m(name, time_s) for name in (sensor, scene.target_names[0]))
    angle = lambda a, b: np.degrees(erfa.sepp(a, b))  # noqa: E731
    sight = target - place
    turn = to_true_equator(scene)
    return (
        (np.linalg.norm(sight, axis=1) <= 6e6)
        & (90.0 - angle(sight, place) >= -32.0)
        & (angle(sight, sun_m(scene, time_s) - place) >= 60.0)
        & (lowest_altitude_m(place @ turn.T, target @ turn.T) >= 250e3)
    )


@pytest.mark.slow
def test_stss_against_a_one_second_scan(scene):
    time_s = np.arange(0.0, scene.duration_s + 0.5)
    table = scene.access()
    for sensor in scene.sensor_names:
        ok = allowed(scene, sensor, time_s)
        edge = np.flatnonzero(np.diff(np.concatenate([[False], ok, [False]]).astype(int)))
        runs = list(zip(time_s[edge[::2]], time_s[edge[1::2] - 1], strict=True))
        rows = table[table["sensor"] == sensor]
        assert len(rows) == len(runs), sensor  # none missed, none extra
        for row, (first_s, last_s) in zip(rows, runs, strict=True):
            assert first_s - 1.0 - RESOLUTION_S <= row["start_s"] <= first_s + RESOLUTION_S
            assert last_s - RESOLUTION_S <= row["end_s"] <= last_s + 1.0 + RESOLUTION_S


@pytest.mark.parametrize("step_s", [10.0, 60.0])
def test_ends_in_stss_against_a_local_scan_at_one_millisecond(scene, step_s):
    n_end = 0
    for row in scene.access(step_s=step_s):
        for edge_s, inward in ((row["start_s"], 1.0), (row["end_s"], -1.0)):
            if 0.0 < edge_s < scene.duration_s:
                around_s = edge_s + inward * 1e-3 * np.arange(-20, 21)
                ok = allowed(scene, row["sensor"], around_s)
                flips = np.flatnonzero(np.diff(ok.astype(int)))
                assert len(flips) == 1 and not ok[0] and ok[-1]
                assert abs(around_s[flips[0]] - edge_s) <= 2.1e-3  # between the scan points on either side, 1 ms each
                n_end += 1
    assert n_end >= 15
