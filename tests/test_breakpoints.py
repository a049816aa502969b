"""Breakpoints: times at which bodies change their velocity at once."""

from __future__ import annotations

import numpy as np
import pytest

import warpsim as ws
from warpsim.scene import target_access

TIME_ATOL_S = 1e-6  # dates of the files
NODES_S = np.arange(-120.0, 3721.0, 60.0)
ORBIT = ws.KeplerOrbit(64.0, altitude_km=1400.0)


@pytest.fixture
def manoeuvre(tmp_path, scene):
    """A file of two objects; one climbs from 1200 s on by 20 m/s."""
    position_m, velocity_m_s = (state[:, 0] for state in ORBIT.states(scene.epoch, NODES_S))
    turn = int(np.flatnonzero(NODES_S == 1200.0)[0])
    speed_m_s = np.linalg.norm(velocity_m_s[turn])
    push = ws.StateVector(position_m[turn], velocity_m_s[turn] * (1 + 20.0 / speed_m_s), time_s=1200.0)
    after = [state[:, 0] for state in push.states(scene.epoch, NODES_S[turn:])]
    parts = [
        ("climber", NODES_S[: turn + 1], position_m[: turn + 1], velocity_m_s[: turn + 1]),
        ("climber", NODES_S[turn:], *after),
    ]
    segments = [ws.EphemerisSegment.of_states(name, scene.epoch, *rest, object_id="1") for name, *rest in parts]
    ws.write_oem(tmp_path / "climber.oem", segments)
    return str(tmp_path / "climber.oem")


def test_the_papers_scene_has_none(scene):
    assert scene.scenario.breakpoints_s == {name: [] for name in [*scene.sensor_names, *scene.target_names]}


def test_breaks_are_found_in_lists_and_mixtures(scene, manoeuvre):
    listed = ws.ListedSatellites([
        {"name": "own", "orbit": ws.EphemerisOrbit(manoeuvre)},
        {"name": "plain", "orbit": ORBIT},
    ])  # fmt: skip
    mixed = ws.MixedConstellation([scene.constellation, listed, ws.EphemerisSatellites([manoeuvre])])
    found = scene.replace(constellation=mixed).scenario.breakpoints_s
    bent = {name: times for name, times in found.items() if times}
    assert set(bent) == {"own", "climber"}
    assert list(bent.values()) == [pytest.approx([1200.0], abs=TIME_ATOL_S, rel=0)] * 2


@pytest.mark.parametrize(
    ("release_s", "expected"), [(500.0, [500.0]), (1300.0, [1200.0, 1300.0]), (0.0, []), (-10.0, [])]
)
def test_targets_have_those_of_the_main_one_until_they_are_released(scene, manoeuvre, release_s, expected):
    late = scene.replace(trajectory=ws.EphemerisOrbit(manoeuvre), release__time_s=release_s)
    found = late.scenario.breakpoints_s
    assert found["center"] == pytest.approx([1200.0], abs=TIME_ATOL_S, rel=0)
    assert found["cone03"] == pytest.approx(expected, abs=TIME_ATOL_S, rel=0)
    assert found["sat11"] == []


@pytest.mark.slow
def test_access_breaks_are_those_of_both_bodies_and_of_the_camera(scene, manoeuvre, monkeypatch):
    bodies = ws.ListedSatellites([
        {"name": "own", "orbit": ws.EphemerisOrbit(manoeuvre)},
        {"name": "plain", "orbit": ORBIT},
    ])  # fmt: skip
    row = {"dec_deg": 0.0}
    rows = [
        {**row, "time_s": 0.0, "ra_deg": 0.0, "sensor": "own"},
        {**row, "time_s": 300.0, "ra_deg": 57.0, "sensor": "own"},
        {**row, "time_s": 2000.0, "ra_deg": 57.0, "sensor": "own"},
        {**row, "time_s": 0.0, "ra_deg": 0.0, "sensor": "plain"},
        {**row, "time_s": 2000.0, "ra_deg": 0.0, "sensor": "plain"},
    ]
    late = scene.replace(constellation=bodies, release__time_s=500.0)
    swept = late.replace(pointing={"kind": "table", "mode": "scan", "rows": rows})
    stared = late.replace(pointing={"kind": "table", "mode": "stare", "rows": rows})

    def breaks_s(scene, target="cone03", with_cameras=True):
        asked = {}

        def access_intervals(*arguments, breaks_s, **others):
            asked["times"] = breaks_s
            return []

        monkeypatch.setattr(target_access, "access_intervals", access_intervals)
        rules = ws.AccessConstraints(in_fov=with_cameras)
        scene.scenario.access(target, ["plain", "own"], rules)
        return [np.round(times, 6).tolist() for times in asked["times"]]

    assert breaks_s(swept, with_cameras=False) == [[500.0], [500.0, 1200.0]]
    assert breaks_s(swept, "center", with_cameras=False) == [[], [1200.0]]
    assert breaks_s(stared) == [[0.0, 500.0, 2000.0], [0.0, 300.0, 500.0, 1200.0, 2000.0]]
    turning_s = [0.0, 150.0, 300.0]  # 57 degrees, in steps of half a radian
    assert breaks_s(swept) == [[0.0, 500.0, 2000.0], [*turning_s, 500.0, 1200.0, 2000.0]]
    follows = late.replace(pointing={"track": "cone04"})
    assert breaks_s(follows, "center") == [[500.0], [500.0, 1200.0]]
