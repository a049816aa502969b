"""Orbits, attitudes and directions from a user's files, in one scene: from the files to the image."""

import json
import re

import numpy as np
import pytest
from astropy.time import Time
from element_sets import iss
from scipy.interpolate import KroghInterpolator
from skyfield.api import EarthSatellite, load

import warpsim as ws
from warpsim.scene.provenance import input_checksums
from warpsim.scene.scene_files import named_files

TRACK_M = 1e-3  # what interpolation between nodes may add
SKYFIELD_M = 5e-3  # with the interpolation between nodes

EPOCH = "2025-06-01T00:00:00"
TLE = "\n".join(["ISS (ZARYA)", *iss("25152.00000000"), ""])
BODY = {
    "shape": {"kind": "cone", "radius_m": 0.25, "height_m": 1.0},
    "surface": {"emissivity": 0.9},
    "temperature": {"start_k": 320.0},
}
DURATION_S = 300.0
WALKER = {"n_satellite": 4, "n_plane": 2, "phasing": 1, "altitude_km": 1400.0, "inclination_deg": 65.0}


@pytest.fixture
def folder(tmp_path):
    """TLE, OEM, `.e`, AEM, CSV of directions and a scene file beside them."""
    epoch = Time(EPOCH, scale="utc")
    orbit = ws.KeplerOrbit(64.0, altitude_km=1400.0, raan_deg=150.0, mean_anomaly_deg=60.0)
    times = np.arange(-60.0, DURATION_S + 61.0, 30.0)
    states = [part[:, 0] for part in orbit.states(epoch, times)]
    ws.write_oem(tmp_path / "bird.oem", ws.EphemerisSegment.of_states("BIRD 1", epoch, times, *states))
    target = ws.KeplerOrbit(66.0, altitude_km=500.0, raan_deg=155.0, mean_anomaly_deg=62.0)
    states = [part[:, 0] for part in target.states(epoch, times)]
    ws.write_stk_ephemeris(tmp_path / "ship.e", ws.EphemerisSegment.of_states("ship", epoch, times, *states))
    (tmp_path / "stations.tle").write_text(TLE)
    (tmp_path / "tumble.csv").write_text(
        "time_s,qx,qy,qz,qw\n"
        + "".join(f"{t},{np.sin(0.01 * t):.16f},0.0,0.0,{np.cos(0.01 * t):.16f}\n" for t in np.arange(0.0, 301.0, 10.0))
    )
    scene = ws.Scene.load("stss").replace(
        name="own",
        epoch_utc=EPOCH,
        duration_s=DURATION_S,
        frames={"count": 31, "interval_s": 10.0},
        constellation={
            "kind": "mixed",
            "parts": [
                {"kind": "tle", "lines": TLE.splitlines()},
                {"kind": "walker", "n_satellite": 4, "n_plane": 2, "phasing": 1, "altitude_km": 1400.0,
                 "inclination_deg": 65.0, "prefix": "w"},
            ],
        },
        trajectory={"kind": "elements", "altitude_km": 500.0, "inclination_deg": 66.0},
        targets=[{"name": "ship", **BODY}],
        access_rules={},
    )  # fmt: skip
    data = scene.to_dict()
    data["constellation"]["parts"] = [
        {"kind": "tle", "file": "stations.tle"},
        {"kind": "ephemeris_files", "files": ["bird.oem"]},
        data["constellation"]["parts"][1],
    ]
    (group,) = data["groups"]
    group["trajectory"] = {"kind": "ephemeris", "file": "ship.e"}
    group["targets"][0]["attitude"] = {"kind": "table", "file": "tumble.csv"}
    data["sensors"][0]["pointing"] = {
        "track": "ship",
        "offset_px": [0.5, 0.5],
        "jitter": {"rms_urad": 20.0, "correlation_s": 0.5},
    }
    (tmp_path / "own.json").write_text(json.dumps(data))
    return tmp_path


def test_files_reach_the_scene(folder, monkeypatch):
    monkeypatch.chdir("/")  # paths count from the scene's folder
    scene = ws.Scene.load(folder / "own.json")
    assert scene.sensor_names == ["ISS_ZARYA", "BIRD_1", "w11", "w12", "w21", "w22"]
    assert named_files(scene.to_dict()) == [
        str(folder / name) for name in ("stations.tle", "bird.oem", "ship.e", "tumble.csv")
    ]
    assert scene.scenario.tracks.error_m < 1e-3
    time_s = np.array([0.0, 1.7, 149.9, 300.0])
    ts = load.timescale(builtin=True)
    _, first, second = TLE.splitlines()
    iss = EarthSatellite(first, second, ts=ts).at(ts.utc(2025, 6, 1, 0, 0, time_s)).position.m.T
    assert np.linalg.norm(scene.position_m("ISS_ZARYA", time_s) - iss, axis=1).max() < SKYFIELD_M
    epoch = Time(EPOCH, scale="utc")
    ship = ws.KeplerOrbit(66.0, altitude_km=500.0, raan_deg=155.0, mean_anomaly_deg=62.0).states(epoch, time_s)[0][:, 0]
    assert np.linalg.norm(scene.position_m("ship", time_s) - ship, axis=1).max() < 2 * TRACK_M
    half = 0.01 * time_s
    turned = scene.scenario.attitude_quaternion("ship", time_s)
    expected = np.stack([np.sin(half), 0 * half, 0 * half, np.cos(half)], axis=1)
    np.testing.assert_allclose(turned, expected, rtol=0, atol=1e-12)
    scene.save(folder / "again.toml")
    assert ws.Scene.load(folder / "again.toml") == scene


@pytest.mark.ci
def test_the_image_shows_what_the_files_say(folder):
    scene = ws.Scene.load(folder / "own.json").replace(sky__catalog="none")
    frames = ws.Renderer(scene).render([0, 13, 30], sensors=["BIRD_1", "w11"], bands=["A"])
    truth = frames.truth
    assert len(truth) == 6
    bird = scene.position_m("BIRD_1", frames.time_s)
    ship = scene.position_m("ship", frames.time_s)
    rows = truth[truth["sensor"] == "BIRD_1"]
    # Light time: 0.01 s of 7 km/s.
    assert np.abs(rows["range_km"] - np.linalg.norm(ship - bird, axis=1) / 1e3).max() < 0.2
    # The offset puts the ship on (64, 64) of 128 pixels, and the jitter up to 5 sigma of 20 urad = 0.15 px away.
    for axis in ("x_px", "y_px"):
        off = np.asarray(truth[axis]) - 64.0
        assert 1e-3 < np.abs(off).max() < 5 * 20e-6 * scene.camera.focal_px


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("tumble.csv", ("0.0998334", "0.0998335")),
        ("ship.e", ("-4290150.370", "-4290150.371")),
        ("stations.tle", ("85.6398", "85.6389")),
    ],
)
@pytest.mark.ci
def test_a_run_is_another_when_a_file_has_changed(folder, name, change):
    out = folder / "out"
    scene = ws.Scene.load(folder / "own.json").replace(sky__catalog="none")
    options = {"frames": range(2), "sensors": ["BIRD_1"], "bands": ["A"]}
    ws.render_to_folder(scene, out, **options)
    (folder / name).write_text((folder / name).read_text().replace(*change))
    # The scene in hand is the one that was read: the run is complete, and tells of the old content.
    ws.render_to_folder(scene, out, **options)
    anew = ws.Scene.load(folder / "own.json").replace(sky__catalog="none")
    with pytest.raises(ws.InputError, match="holds a different run"):
        ws.render_to_folder(anew, out, **options)
    inputs = json.loads((out / "manifest.json").read_text())["inputs"]
    assert inputs == input_checksums(scene.scenario)
    assert set(inputs) == set(named_files(scene.to_dict()))
    assert {path for path, text in input_checksums(anew.scenario).items() if text != inputs[path]} == {
        str(folder / name)
    }


def test_oem_keeps_the_orbit_between_its_rows(folder):
    """Hermite interpolation of the rows, by scipy, is where the satellite is."""
    scene = ws.Scene.load(folder / "own.json")
    (segment,) = ws.read_ephemeris(folder / "bird.oem")
    times = segment.instants.since(scene.epoch)
    rows = slice(4, 8)  # degree 7 about 105 s
    path = KroghInterpolator(
        np.repeat(times[rows], 2), np.stack([segment.position_m[rows], segment.velocity_m_s[rows]], 1).reshape(-1, 3)
    )
    assert np.linalg.norm(scene.position_m("BIRD_1", [105.0])[0] - path(105.0)) < TRACK_M


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"duration_s": 2000.0, "frames__count": 200},
         r"^constellation.parts\[1\]: .*bird.oem: BIRD_1: time 2000 s .2025-06-01T00:33.* must be in the file's span"),
        ({"epoch_utc": "2025-05-31T23:00:00"}, r"^constellation.parts\[1\]: .*: BIRD_1: time 0 s .2025-05-31T23:00"),
        ({"constellation__parts__0__file": "none.tle"}, r"^constellation: .*none.tle: cannot be read"),
        ({"groups__0__trajectory__object": "boat"}, r"^trajectory: .*ship.e: .*boat"),
        ({"groups__0__trajectory__file": "tumble.csv"}, r"^trajectory: .*tumble.csv"),
        ({"groups__0__trajectory__kind": "oem"}, r"own.json: trajectory.kind: must be one of"),
        ({"groups__0__targets__0__release": {"time_s": 5.0}}, r"own.json: targets\[0\].release: must not be given"),
        ({"sensors__0__pointing__track": "boat"}, r"^pointing.track: must be 'main', 'group' or a target's name"),
    ],
)  # fmt: skip
def test_errors_name_file_object_and_time(folder, change, message):
    data = json.loads((folder / "own.json").read_text())
    for name, value in change.items():
        *parents, leaf = name.split("__")
        place = data
        for parent in parents:
            place = place[int(parent) if parent.isdigit() else parent]
        place[leaf] = value
    (folder / "own.json").write_text(json.dumps(data))
    with pytest.raises(ws.InputError, match=message) as caught:
        _ = ws.Scene.load(folder / "own.json").scenario
    print(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_rows_are_refused_or_told(folder):
    """Rows taken out of a segment: 150 s are interpolated well, 900 s with an error that is told, 3000 s not at all."""
    epoch = Time(EPOCH, scale="utc")
    orbit = ws.KeplerOrbit(66.0, altitude_km=500.0)
    times = np.arange(-600.0, 6001.0, 30.0)
    scene = ws.Scene.load(folder / "own.json")

    def flown(first_s, last_s):
        rows = (times <= first_s) | (times >= last_s)
        states = [part[:, 0] for part in orbit.states(epoch, times[rows])]
        segment = ws.EphemerisSegment.of_states("ship", epoch, times[rows], *states)
        ws.write_oem(folder / "holes.oem", segment, overwrite=True)
        path = {"kind": "ephemeris", "file": str(folder / "holes.oem")}
        return scene.replace(trajectory=path, duration_s=5000.0, constellation=WALKER, targets__0__attitude={})

    assert flown(1200.0, 1350.0).groups[0].trajectory.notes(epoch, 5000.0) == []
    (note,) = flown(1200.0, 2100.0).groups[0].trajectory.notes(epoch, 5000.0)
    print(note)
    told_m = float(re.search(r"some (\S+) m off between rows at 1200 s .* and 2100 s", note)[1])
    middle = np.linspace(1200.0, 2100.0, 91)
    off = flown(1200.0, 2100.0).groups[0].trajectory.states(epoch, middle)[0] - orbit.states(epoch, middle)[0]
    assert 0.3 < told_m / np.linalg.norm(off, axis=-1).max() < 3.0
    rule = r"trajectory: .*holes.oem: ship: rows must be close enough .* 1200 s"
    with pytest.raises(ws.InputError, match=rule) as caught:
        _ = flown(1200.0, 4200.0).scenario
    print(caught.value)
    assert "\n" not in str(caught.value)


def test_a_gap_in_a_file_is_named_before_rendering(folder):
    """Rows are taken out of the middle: two segments, and nothing between them."""
    (segment,) = ws.read_ephemeris(folder / "ship.e")
    epoch = Time(EPOCH, scale="utc")
    times = segment.instants.since(epoch)
    parts = [
        ws.EphemerisSegment.of_states("ship", epoch, times[rows], segment.position_m[rows], segment.velocity_m_s[rows])
        for rows in (slice(0, 5), slice(8, None))
    ]
    ws.write_oem(folder / "gap.oem", parts)
    gap = {"kind": "ephemeris", "file": str(folder / "gap.oem")}
    with pytest.raises(ws.InputError, match=r"trajectory.*gap.oem: ship: .*gap") as caught:
        _ = ws.Scene.load(folder / "own.json").replace(trajectory=gap).scenario
    print(caught.value)
    assert "\n" not in str(caught.value)
