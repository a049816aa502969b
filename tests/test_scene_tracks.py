"""Tracks of scenes along files that cover just them, the room of the node grid around a scene, and breakpoints."""

from __future__ import annotations

import numpy as np
import pytest

import warpsim as ws
from warpsim.instant import utc_time
from warpsim.scene import target_access

MU = 3.986004418e14
EPOCH = "2025-03-20T12:00:00"
TRACK_M = 1e-3  # what tracks are asked for
FILE_M = 1e-4  # what the file's own interpolation adds; measured 2e-6
GOES_ON_M = 0.05  # twice J2 over 2 s, which the circles below do not know: 0.5 * 0.013 m/s2 * 4 s2
JUMP_M_S = 100.0


def circle(time_s, radius_m, phase=0.0, tilt=0.3):
    """Uniform motion on a circle, (n, 3) each."""
    rate = np.sqrt(MU / radius_m**3)
    angle = phase + rate * np.asarray(time_s, float)
    first, second = np.array([1.0, 0.0, 0.0]), np.array([0.0, np.cos(tilt), np.sin(tilt)])
    r = radius_m * (np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second)
    v = radius_m * rate * (np.cos(angle)[:, None] * second - np.sin(angle)[:, None] * first)
    return r, v


def pushed(time_s, radius_m, at_s):
    """The circle, left with a jump of the velocity along z: neither is a path of gravity, nor need it be."""
    r, v = circle(time_s, radius_m)
    after = np.maximum(np.asarray(time_s, float) - at_s, 0.0)
    r[:, 2] += JUMP_M_S * after
    v[:, 2] += JUMP_M_S * (np.asarray(time_s) >= at_s)
    return r, v


@pytest.fixture
def along(tmp_path):
    """Write files of a sensor ("bird") and a target ("ship") by segments, and make the scene."""
    base = ws.Scene.load("stss").to_dict()

    def write(name, motion, spans, n):
        segments = []
        for begin_s, end_s in spans:
            time_s = np.linspace(begin_s, end_s, n)
            # A segment that begins with a jump has it in its first row, one that ends with it does not.
            inside = time_s - np.where(time_s == end_s, 1e-9, 0.0)
            r, v = motion(time_s)[0], motion(inside)[1]
            segments.append(ws.EphemerisSegment.of_states(name, utc_time(EPOCH), time_s, r, v))
        ws.write_oem(tmp_path / f"{name}.oem", segments, overwrite=True)
        return str(tmp_path / f"{name}.oem")

    def do(duration_s, bird, ship, bird_spans, ship_spans=None, epoch=EPOCH, n=41):
        files = write("bird", bird, bird_spans, n), write("ship", ship, ship_spans or bird_spans, n)
        return ws.Scene.from_dict(base).replace(
            epoch_utc=epoch,
            duration_s=duration_s,
            frames={"count": 2, "interval_s": duration_s / 2},
            constellation={"kind": "ephemeris_files", "files": [files[0]]},
            trajectory={"kind": "ephemeris", "file": files[1]},
            targets=[{**base["groups"][0]["targets"][0], "name": "ship"}],
            release={},
            access_rules={},
            sky={"catalog": "none"},
        )

    return do


def check_tracks(scene, motions, begin_s=0.0):
    """The tracks are the motions, and their measured error is no less than their true one."""
    time_s = np.sort(np.random.default_rng(3).uniform(0.0, scene.duration_s, 2000))
    time_s = np.concatenate([[0.0], time_s, [scene.duration_s]])
    for name, motion in motions.items():
        missed_m = np.linalg.norm(scene.position_m(name, time_s) - motion(time_s + begin_s)[0], axis=1).max()
        assert missed_m < 1.02 * scene.scenario.tracks.of(name).error_m + FILE_M
    assert scene.scenario.tracks.error_m < TRACK_M


@pytest.mark.parametrize("radius_m", [7.0e6, 2.66e7, 4.2164e7, 3.8e8], ids=["low", "GPS", "geostationary", "moon"])
def test_files_that_cover_the_scene_and_no_more(along, radius_m):
    motions = {"bird": lambda t: circle(t, radius_m), "ship": lambda t: circle(t, radius_m, 0.05)}
    duration_s = 3000.0 if radius_m < 1e7 else 7200.0
    scene = along(duration_s, *motions.values(), [(0.0, duration_s)])
    check_tracks(scene, motions)
    assert scene.scenario.tracks.start_s <= -2.0
    early_s = np.array([-2.0, -1.0])
    assert np.linalg.norm(scene.position_m("ship", early_s) - motions["ship"](early_s)[0], axis=1).max() < GOES_ON_M


@pytest.mark.parametrize(("duration_s", "begin_s"), [(600.0, 0.0), (580.0, 0.0), (600.0, 660.0), (640.0, 660.0)])
def test_gaps_outside_the_scene_do_not_matter(along, duration_s, begin_s):
    motions = {"bird": lambda t: circle(t, 7.0e6), "ship": lambda t: circle(t, 7.1e6, 0.05)}
    epoch = "2025-03-20T12:11:00" if begin_s else EPOCH
    scene = along(duration_s, *motions.values(), [(0.0, 600.0), (660.0, 1300.0)], epoch=epoch)
    check_tracks(scene, motions, begin_s)
    assert scene.scenario.tracks.step_s > 10.0


def test_files_in_lists_and_mixtures_go_on_as_well(along):
    """Beside an orbit that goes on by itself."""
    motion = lambda t: circle(t, 7.0e6)  # noqa: E731
    scene = along(580.0, motion, motion, [(0.0, 600.0), (660.0, 1300.0)])
    files = scene.constellation
    orbit = {"kind": "ephemeris", "file": files.files[0]}
    free = {"kind": "elements", "altitude_km": 900.0, "inclination_deg": 60.0}
    listed = {"kind": "listed", "satellites": [{"name": "own", "orbit": orbit}, {"name": "free", "orbit": free}]}
    mixed = scene.replace(constellation={"kind": "mixed", "parts": [listed, files]})
    assert mixed.sensor_names == ["own", "free", "bird"]
    check_tracks(mixed, dict.fromkeys(("own", "bird", "ship"), motion))
    early_s = np.array([-1.5])
    alone = ws.KeplerOrbit(60.0, altitude_km=900.0).states(mixed.epoch, early_s)[0][:, 0]
    assert np.abs(mixed.position_m("free", early_s) - alone).max() < TRACK_M
    with pytest.raises(ws.InputError, match=r"constellation.parts\[0\].* must not be in a gap"):
        _ = mixed.replace(duration_s=700.0, trajectory=free).scenario


def test_gaps_inside_the_scene_are_refused(along):
    motion = lambda t: circle(t, 7.0e6)  # noqa: E731
    for duration_s in (610.0, 700.0):
        with pytest.raises(ws.InputError, match="must not be in a gap between segments, 600 s"):
            _ = along(duration_s, motion, motion, [(0.0, 600.0), (660.0, 1300.0)]).scenario


@pytest.mark.parametrize("begin_s", [0.0, 600.0])
def test_a_jump_at_the_ends_of_a_scene_does_not_shorten_its_steps(along, begin_s):
    """Scenes that end, or begin, with a manoeuvre: it has no part in them."""
    motions = {"bird": lambda t: pushed(t, 7.0e6, 600.0), "ship": lambda t: circle(t, 7.1e6, 0.05)}
    epoch = "2025-03-20T12:10:00" if begin_s else EPOCH
    scene = along(600.0, *motions.values(), [(0.0, 600.0), (600.0, 1200.0)], epoch=epoch)
    check_tracks(scene, motions, begin_s)
    assert scene.scenario.tracks.step_s > 10.0
    _, velocity = scene.scenario.tracks.state("bird", [0.0, 600.0])
    assert np.abs(velocity - pushed([begin_s + 1e-9, begin_s + 600.0 - 1e-9], 7.0e6, 600.0)[1]).max() < 1e-3


def test_light_time_has_room_when_steps_are_tiny(along):
    """A jump of 100 m/s inside the scene gives steps of 10 ms; the light of the first frame left 60 ms before it."""
    ship = lambda t: circle(t, 2.5e7, 0.5)  # noqa: E731
    spans = [(0.0, 12.3), (12.3, 20.0)]
    jumping = along(20.0, lambda t: pushed(t, 7.0e6, 12.3), ship, spans)
    assert jumping.scenario.tracks.step_s <= 0.01
    assert jumping.scenario.tracks.start_s == pytest.approx(-2.0, abs=0.011, rel=0)
    axes = jumping.scenario.view_axes("bird", [0.0, 10.0])
    smooth = along(20.0, lambda t: circle(t, 7.0e6), ship, [(0.0, 20.0)])
    assert smooth.scenario.tracks.step_s > 1.0
    assert np.abs(axes - smooth.scenario.view_axes("bird", [0.0, 10.0])).max() < 1e-9


def test_tracks_say_what_they_are_and_not_all_they_hold():
    tracks = ws.Scene.load("stss").scenario.tracks
    assert repr(tracks) == "Tracks(28 satellites, 30 targets, nodes every 11.6957 s)"


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
