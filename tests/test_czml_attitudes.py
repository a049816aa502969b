"""Attitudes and curves in CZML: read back as JSON and interpolated as Cesium does, they are the scene's."""

import json

import erfa
import numpy as np
import pytest
from astropy.time import Time, TimeDelta

import warpsim as ws
from warpsim.orbit.earth import itrs_to_gcrs
from warpsim.output import czml_targets
from warpsim.output.czml_targets import ERROR_RAD, LONGEST_TURN_RAD, earth_rotation, sampled_attitude
from warpsim.quaternion import conjugate, from_matrix, product, rotated, rotation_between_rad

czml3 = pytest.importorskip("czml3")

SAMPLE_ATOL_RAD = 1e-6  # rounding of the quaternions is 1e-7
EARTH_ATOL_RAD = 1e-10
UT1_ATOL_RAD = 1e-5  # UT1 - UTC, which the oracle leaves out, turns the Earth by 4e-6 rad in 2025
TARGETS = ["center", "cone01", "cylinder01"]
FEW = {"count": 1, "shape": ws.Sphere(0.8), "surface": {"emissivity": 0.9}, "temperature": {"start_k": 300.0}}


def read(path):
    return {packet["id"]: packet for packet in json.loads(path.read_text("utf-8"))}


@pytest.fixture(scope="module")
def packets(scene, tmp_path_factory):
    path = tmp_path_factory.mktemp("czml") / "stss.czml"
    ws.write_czml(scene, path, attitudes=TARGETS, curves=["center", "cone01"])
    czml3.Document.load(path)
    return read(path)


def samples(packet):
    """Times and quaternions of a packet, (n,) and (n, 4)."""
    rows = np.array(packet["orientation"]["unitQuaternion"]).reshape(-1, 5)
    return rows[:, 0], rows[:, 1:]


def shown(packet, times):
    """Quaternions that Cesium's SampledProperty gives, after its source (1.140): degree 1, by axis and angle."""
    orientation = packet["orientation"]
    assert (orientation["interpolationAlgorithm"], orientation["interpolationDegree"]) == ("LINEAR", 1)
    time_s, given = samples(packet)
    given = given / np.linalg.norm(given, axis=1, keepdims=True)
    after = np.clip(np.searchsorted(time_s, times), 1, len(time_s) - 1)
    last = given[after]
    turned = product(given[after - 1], conjugate(last))
    turned = np.where(turned[:, 3:] < 0, -turned, turned)
    small = np.abs(turned[:, 3] - 1.0) < 1e-6  # EPSILON6: no rotation at all
    angle = np.where(small, 0.0, 2.0 * np.arccos(np.minimum(turned[:, 3], 1.0)))
    axis = turned[:, :3] / np.maximum(np.sqrt(1.0 - turned[:, 3:] ** 2), 1e-12)
    part = (time_s[after] - times) / (time_s[after] - time_s[after - 1])
    half = 0.5 * (angle * part)[:, None]
    return product(np.concatenate([axis * np.sin(half), np.cos(half)], axis=1), last)


def in_itrs(scene, name, times):
    """The scene's own attitudes, from body to Earth-fixed axes."""
    attitude = scene.scenario.attitudes[scene.target_names.index(name)]
    earth = from_matrix(itrs_to_gcrs(scene.scenario.epoch, times))
    return product(conjugate(earth), attitude.at(times))


@pytest.mark.ci
@pytest.mark.parametrize("name", TARGETS)
def test_orientations_are_the_scenes_in_the_earths_axes(scene, packets, name):
    assert packets[name]["orientation"]["epoch"] == "2025-01-01T14:00:00.000000Z"
    time_s, given = samples(packets[name])
    assert (time_s[0], time_s[-1]) == (0.0, scene.duration_s)
    some = np.linspace(0, len(time_s) - 1, 300).astype(int)
    expected = in_itrs(scene, name, time_s[some])
    assert rotation_between_rad(given[some], expected).max() < SAMPLE_ATOL_RAD
    assert np.minimum(np.abs(given[some] - expected), np.abs(given[some] + expected)).max() < SAMPLE_ATOL_RAD
    assert (np.sum(given[1:] * given[:-1], axis=1) > 0).all()
    times = np.random.default_rng(3).uniform(0, scene.duration_s, 3000)
    off_rad = rotation_between_rad(shown(packets[name], times), in_itrs(scene, name, times))
    assert off_rad.max() < ERROR_RAD
    assert off_rad.max() > 0.1 * ERROR_RAD or name == "cylinder01"  # which turns evenly: no more samples than needed


@pytest.mark.ci
def test_directions_are_those_of_the_standards_of_fundamental_astronomy(scene, packets):
    """The cone's axis by its quaternion in the file, against GCRS turned by ERFA's IAU 2006 matrix, UT1 as UTC."""
    time_s, given = samples(packets["center"])
    attitude = scene.scenario.attitudes[0]
    for row in (0, len(time_s) // 2, len(time_s) - 1):
        at = Time(scene.epoch_utc, scale="utc") + TimeDelta(time_s[row], format="sec")
        to_itrs = erfa.c2t06a(at.tt.jd1, at.tt.jd2, at.utc.jd1, at.utc.jd2, 0.0, 0.0)
        for axis in np.eye(3):
            expected = to_itrs @ rotated(attitude.at([time_s[row]])[0], axis)
            assert np.linalg.norm(rotated(given[row], axis) - expected) < UT1_ATOL_RAD


def test_the_earths_rotation_between_nodes_is_exact(scene):
    earth = earth_rotation(scene.scenario.epoch, 1614.0)
    times = np.linspace(0, 1614.0, 97)
    exact = from_matrix(itrs_to_gcrs(scene.scenario.epoch, times))
    assert rotation_between_rad(earth(times), exact).max() < EARTH_ATOL_RAD


def test_steps_are_cut_at_kinks_and_where_the_axis_moves():
    axis = np.array([0.6, 0.0, 0.8])

    def at(time_s):
        angle = np.where(time_s < 4.321, 0.0, (time_s - 4.321) ** 2)[:, None]
        about = np.concatenate([axis * np.sin(angle / 2), np.cos(angle / 2)], axis=1)
        spin = 0.3 * time_s[:, None]
        zero = np.zeros_like(spin)
        return product(about, np.concatenate([zero, zero, np.sin(spin), np.cos(spin)], axis=1))

    time_s, turned = sampled_attitude(at, np.array([0.0, 2.5, 5.0]))
    packet = {"orientation": {"unitQuaternion": np.column_stack([time_s, turned]).ravel().tolist(),
              "interpolationAlgorithm": "LINEAR", "interpolationDegree": 1}}  # fmt: skip
    times = np.linspace(0.0, 5.0, 5001)
    assert rotation_between_rad(shown(packet, times), at(times)).max() < ERROR_RAD
    before = np.count_nonzero(time_s < 4.3)
    assert before < 12 < len(time_s) < 60  # a steady turn needs two samples


@pytest.mark.ci
@pytest.mark.parametrize(
    "attitude",
    [
        {"kind": "torque_free", "moments": [1.0, 2.0, 3.0], "rates_deg_s": [0.01, 30.0, 0.01]},
        {"kind": "table", "time_s": [0.0, 600.0, 601.0, 2000.0],
         "quaternion": [[0, 0, 0, 1], [0, 0, 0.1, 0.99499], [0.7, 0, 0.1, 0.70711], [0, 0.6, 0, 0.8]]},
        {"kind": "table", "time_s": [0.0], "quaternion": [[0, 0, 0, 1]]},
    ],
    ids=["flipping", "table", "still"],
)  # fmt: skip
def test_other_motions(scene, tmp_path, attitude):
    rotating = scene.replace(targets=[{"name": "body", **FEW, "attitude": attitude}], access_rules={})
    ws.write_czml(rotating, tmp_path / "a.czml", attitudes="all")
    packet = read(tmp_path / "a.czml")["body"]
    times = np.random.default_rng(3).uniform(0, scene.duration_s, 4000)
    assert rotation_between_rad(shown(packet, times), in_itrs(rotating, "body", times)).max() < ERROR_RAD
    given = samples(packet)[1]
    assert 2.0 * np.arccos(np.sum(given[1:] * given[:-1], axis=1).min()) < LONGEST_TURN_RAD + 1.5
    assert packet["ellipsoid"]["radii"]["cartesian"] == [0.8, 0.8, 0.8]


def test_targets_are_solids_in_their_own_axes(packets):
    cone, cylinder = packets["cone01"]["cylinder"], packets["cylinder01"]["cylinder"]
    assert (cone["length"], cone["topRadius"], cone["bottomRadius"]) == (1.0, 0.0, 0.25)
    assert (cylinder["length"], cylinder["topRadius"], cylinder["bottomRadius"]) == (1.0, 0.25, 0.25)


def test_what_is_not_asked_for_is_not_there(packets):
    assert {name for name, packet in packets.items() if "orientation" in packet} == set(TARGETS)
    assert {name for name, packet in packets.items() if "properties" in packet} == {"center", "cone01"}


@pytest.mark.ci
def test_curves_are_those_of_the_scene(scene, packets):
    """Every sensor and band: the irradiance at the frames during access, and nothing at other times."""
    frames_s = scene.scenario.instrument.frame_time_s(np.arange(scene.frames.count))
    for name in ("center", "cone01"):
        properties = packets[name]["properties"]
        sensors = set(scene.access()["sensor"])
        assert set(properties) == {f"irradiance_w_cm2/{sensor}/{band}" for sensor in sensors for band in "ACE"}
        curves = ws.light_curves(scene, frames_s, sorted(sensors), [name])
        for row, sensor in enumerate(curves.sensors):
            seen = scene.scenario.instrument.has_access(scene.sensor_names.index(sensor), frames_s)
            for column, band in enumerate(curves.bands):
                pieces = properties[f"irradiance_w_cm2/{sensor}/{band}"]
                pieces = pieces if isinstance(pieces, list) else [pieces]
                table = np.concatenate([np.array(piece["number"]).reshape(-1, 2) for piece in pieces])
                np.testing.assert_array_equal(table[:, 0], frames_s[seen])
                np.testing.assert_allclose(table[:, 1], curves.irradiance_w_cm2[seen, row, column, 0], rtol=6e-6)
                assert table[:, 1].max() > 0
                assert len(pieces) == np.count_nonzero(scene.access()["sensor"] == sensor)
                assert all(piece["epoch"] == "2025-01-01T14:00:00.000000Z" for piece in pieces)


@pytest.mark.ci
def test_curves_of_late_targets_begin_with_them(scene, tmp_path):
    late = scene.replace(release__time_s=500.0)
    ws.write_czml(late, tmp_path / "late.czml", curves=["center", "cone01"])
    packets = read(tmp_path / "late.czml")
    first = {
        name: packets[name]["properties"]["irradiance_w_cm2/sat11/A"]["number"][0] for name in ("center", "cone01")
    }
    assert first == {"center": 250.0, "cone01": 500.0}
    interval = packets["cone01"]["properties"]["irradiance_w_cm2/sat11/A"]["interval"]
    assert interval.startswith("2025-01-01T14:08:20.000000Z/")


@pytest.mark.ci
def test_curves_of_many_frames_have_some_of_them(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(czml_targets, "MOST_FRAMES", 30)
    ws.write_czml(scene, tmp_path / "a.czml", curves="center")
    numbers = read(tmp_path / "a.czml")["center"]["properties"]["irradiance_w_cm2/sat11/A"]["number"]
    assert len(numbers) == 2 * 30 and set(np.diff(numbers[::2])) == {40.0}  # of 118 frames, 10 s apart


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"attitudes": ["nobody"]}, "^attitudes: must be among center, sphere01, .*, got 'nobody'$"),
        ({"curves": "nobody"}, "^curves: must be among center, sphere01, .*, got 'nobody'$"),
        ({"attitudes": []}, "^attitudes: must name at least one$"),
    ],
)
def test_unknown_targets_are_named(scene, tmp_path, more, message):
    with pytest.raises(ws.InputError, match=message):
        ws.write_czml(scene, tmp_path / "a.czml", **more)
    assert list(tmp_path.iterdir()) == []


def test_too_much_is_refused_before_it_is_done(scene, tmp_path, monkeypatch):
    for rate_rev_s in (1e9, 1e60):
        fast = scene.replace(targets__0__attitude={"spin_rev_s": rate_rev_s})
        with pytest.raises(ws.InputError, match=r"^center: turns so fast, .* 2000000 samples: choose fewer") as caught:
            ws.write_czml(fast, tmp_path / "a.czml", attitudes="center")
        assert "\n" not in str(caught.value)
    monkeypatch.setattr(czml_targets, "MOST_SAMPLES", 1000)
    with pytest.raises(ws.InputError, match=r"^curves: take \d+ samples, more than 1000: choose fewer targets$"):
        ws.write_czml(scene, tmp_path / "a.czml", curves="all")
    monkeypatch.setattr(czml_targets, "MOST_SAMPLES", 60_000)
    with pytest.raises(ws.InputError, match=r"^cone01: turns so fast"):
        ws.write_czml(scene, tmp_path / "a.czml", attitudes=["center", "cone01"])
    assert list(tmp_path.iterdir()) == []
