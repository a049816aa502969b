"""CZML: read back as JSON and interpolated as Cesium does, it is the scene."""

import json

import numpy as np
import pytest
from astropy.time import Time

import warpsim as ws
from warpsim.output import czml
from warpsim.output.czml import interpolated, sampled_track

czml3 = pytest.importorskip("czml3")

POSITION_ATOL_M = 0.1  # what the samples are chosen for; their rounding is 1 mm
TIME_ATOL_S = 1e-6  # digits of the dates
STSS_BYTES = 5_000_000


@pytest.fixture(scope="module")
def written(scene, tmp_path_factory):
    path = tmp_path_factory.mktemp("czml") / "stss.czml"
    return path, ws.write_czml(scene, path)


@pytest.fixture(scope="module")
def packets(written):
    return {packet["id"]: packet for packet in json.loads(written[0].read_text("utf-8"))}


def cesium_value(times, values, degree, time):
    """What Cesium's SampledProperty.getValue gives, after its source (1.120): sample numbers, then Lagrange."""
    index = 0
    while index < len(times) and times[index] < time:
        index += 1
    if index < len(times) and times[index] == time:
        return values[index]
    first, last = 0, len(times) - 1
    if last - first + 1 >= degree + 1:
        computed_first = max(index - degree // 2 - 1, first)
        computed_last = computed_first + degree
        if computed_last > last:
            computed_last = last
            computed_first = max(computed_last - degree, first)
        first, last = computed_first, computed_last
    x = [t - times[last] for t in times[first : last + 1]]
    at = time - times[last]
    result = np.zeros(3)
    for i, xi in enumerate(x):
        coefficient = 1.0
        for j, xj in enumerate(x):
            if j != i:
                coefficient *= (at - xj) / (xi - xj)
        result += coefficient * np.asarray(values[first + i])
    return result


def seconds(scene, text):
    """Seconds after the epoch of an ISO 8601 UTC instant."""
    assert text.endswith("Z")
    return (Time(text[:-1], scale="utc") - scene.epoch).sec


def interval(scene, text):
    return tuple(seconds(scene, part) for part in text.split("/"))


def shown_off_m(scene, packet, times):
    """How far a body is from the scene's place where Cesium shows it, (n,) [m]."""
    position = packet["position"]
    pieces = position if isinstance(position, list) else [position]
    starts = [interval(scene, piece["interval"])[0] if len(pieces) > 1 else 0.0 for piece in pieces]
    samples = [np.array(piece["cartesian"]).reshape(-1, 4) for piece in pieces]
    for piece, rows in zip(pieces, samples, strict=True):
        assert (piece["interpolationAlgorithm"], piece["interpolationDegree"]) == ("LAGRANGE", 5)
        assert len(rows) >= 6
    shown = []
    for time in times:
        rows = samples[np.searchsorted(starts, time, side="right") - 1]
        near = slice(*np.clip(np.searchsorted(rows[:, 0], time) + np.array([-9, 9]), 0, len(rows)))
        shown.append(cesium_value(rows[near, 0], rows[near, 1:], 5, time))
    return np.linalg.norm(shown - scene.position_m(packet["id"], times), axis=1)


def test_positions_are_the_scenes_where_cesium_interpolates(scene, packets, written):
    times = np.concatenate([np.arange(0.0, scene.duration_s, 7.3), [1e-3, scene.duration_s - 1e-3, scene.duration_s]])
    worst_m = 0.0
    for name in [*scene.sensor_names, *scene.target_names]:
        position = packets[name]["position"]
        assert position["referenceFrame"] == "INERTIAL"
        assert (position["interpolationAlgorithm"], position["interpolationDegree"]) == ("LAGRANGE", 5)
        assert seconds(scene, position["epoch"]) == 0
        samples = np.array(position["cartesian"]).reshape(-1, 4)
        assert samples[0, 0] == 0 and samples[-1, 0] == scene.duration_s
        shown = [cesium_value(samples[:, 0], samples[:, 1:], 5, time) for time in times]
        worst_m = max(worst_m, np.linalg.norm(shown - scene.position_m(name, times), axis=1).max())
    assert worst_m < POSITION_ATOL_M
    assert worst_m == pytest.approx(written[1], rel=0.2)  # what is reported is what is


def test_interpolation_is_cesiums():
    rng = np.random.default_rng(5)
    times, values = np.cumsum(rng.uniform(1, 3, 14)), rng.normal(size=(14, 3))
    between = np.concatenate([rng.uniform(times[0], times[-1], 200), times])
    expected = [cesium_value(list(times), values, 5, time) for time in between]
    np.testing.assert_allclose(interpolated(times, values, between), expected, rtol=0, atol=1e-9)
    quintic = np.polynomial.Polynomial([1, -2, 0.3, 0.1, -0.02, 0.004])
    np.testing.assert_allclose(interpolated(times, quintic(times)[:, None], between)[:, 0], quintic(between), rtol=1e-9)


def test_document_has_the_clock(scene, packets):
    document = next(iter(packets.values()))
    assert (document["id"], document["name"], document["version"]) == ("document", "stss", "1.0")
    assert interval(scene, document["clock"]["interval"]) == pytest.approx((0, 1614), abs=TIME_ATOL_S)
    assert document["clock"]["currentTime"] == "2025-01-01T14:00:00.000000Z"


def test_every_body_is_a_packet(scene, packets):
    lines = [name for name in packets if name.startswith("access/")]
    assert set(packets) == {"document", *scene.sensor_names, *scene.target_names, *lines}
    for name in [*scene.sensor_names, *scene.target_names]:
        packet = packets[name]
        assert packet["label"]["text"] == packet["name"] == name
        assert interval(scene, packet["availability"]) == pytest.approx((0, 1614), abs=TIME_ATOL_S)
        assert packet["path"]["leadTime"] == scene.duration_s and packet["point"]["pixelSize"] > 0
    assert packets["sat11"]["label"]["show"] and packets["center"]["path"]["show"]
    assert not packets["sphere01"]["label"]["show"]
    assert packets["cone01"]["description"] == "target, cone"


def test_lines_of_sight_show_during_access(scene, packets):
    table = scene.access()
    assert {name.split("/")[1] for name in packets if name.startswith("access/")} == set(table["sensor"])
    for sensor in set(table["sensor"]):
        line = packets[f"access/{sensor}/center"]["polyline"]
        assert line["positions"]["references"] == [f"{sensor}#position", "center#position"]
        assert line["arcType"] == "NONE"
        never, *shown = line["show"]
        assert never["boolean"] is False and interval(scene, never["interval"]) == pytest.approx((0, 1614), abs=1e-6)
        assert all(item["boolean"] is True for item in shown)
        rows = [(row["start_s"], row["end_s"]) for row in table if row["sensor"] == sensor]
        np.testing.assert_allclose(
            [interval(scene, item["interval"]) for item in shown], rows, rtol=0, atol=TIME_ATOL_S
        )


def test_czml3_takes_it_back(written):
    path, _ = written
    document = czml3.Document.load(path)
    assert len(document.packets) == 1 + 58 + 10
    assert path.stat().st_size < STSS_BYTES


def test_a_step_of_ones_own(scene, tmp_path):
    coarse = ws.write_czml(scene, tmp_path / "coarse.czml", step_s=270.0)
    fine = ws.write_czml(scene, tmp_path / "fine.czml", step_s=30.0)
    assert fine < 0.01 < 1.0 < coarse  # m
    ((time_s, position_m),), _ = sampled_track(scene, "sat11", 270.0)
    assert len(time_s) == 7
    np.testing.assert_allclose(position_m, scene.position_m("sat11", time_s), rtol=0, atol=0.6e-3)


def test_dates_count_leap_seconds(tmp_path):
    before = {"epoch_utc": "2016-12-31T23:50:00", "access_rules": {}}
    leap = ws.Scene.load("stss").replace(**before)
    ws.write_czml(leap, tmp_path / "leap.czml")
    packets = {packet["id"]: packet for packet in json.loads((tmp_path / "leap.czml").read_text())}
    assert packets["document"]["clock"]["interval"] == "2016-12-31T23:50:00.000000Z/2017-01-01T00:16:53.000000Z"
    assert czml._utc(leap, [599.5, 600.25, 601.0]) == [
        "2016-12-31T23:59:59.500000Z", "2017-01-01T00:00:00.000000Z", "2017-01-01T00:00:00.000000Z",
    ]  # fmt: skip


def test_a_file_that_cannot_be_finished_is_not_there(scene, tmp_path, monkeypatch):
    def fail(document, path, **_):
        path.write_text("[")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(czml3.Document, "save", fail)
    with pytest.raises(OSError, match="No space"):
        ws.write_czml(scene, tmp_path / "a.czml")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("path", "step_s", "message"),
    [
        ("a.json", None, r"must end in \.czml$"),
        ("missing/a.czml", None, "missing is not a folder$"),
        ("a.czml", 0.0, "^step_s: must be > 0, got 0$"),
        ("a.czml", float("nan"), "^step_s: must be > 0, got nan$"),
        ("a.czml", 1e-3, "^step_s: 0.001 s give more than 2000000 positions for 58 bodies over 1614 s$"),
    ],
)
def test_bad_input_is_named_in_one_line(scene, tmp_path, path, step_s, message):
    with pytest.raises(ws.InputError, match=message) as caught:
        ws.write_czml(scene, tmp_path / path, step_s)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_existing_files_are_kept(scene, tmp_path):
    path = tmp_path / "a.czml"
    path.write_text("mine")
    with pytest.raises(ws.InputError, match="is there already"):
        ws.write_czml(scene, path)
    assert path.read_text() == "mine"


BEND_S, BEND_M_S = 700.3, np.array([3.0, -4.0, 1.0])


def bent(monkeypatch, jump_m=0.0):
    """Scenes whose sphere01 gets a push at 700.3 s, as by a release."""
    straight = ws.Scene.position_m

    def position_m(self, name, time_s):
        later_s = np.maximum(np.atleast_1d(time_s) - BEND_S, 0)[:, None]
        return straight(self, name, time_s) + (name == "sphere01") * (later_s * BEND_M_S + jump_m * (later_s > 0))

    monkeypatch.setattr(ws.Scene, "position_m", position_m)


def test_a_bend_is_between_intervals(scene, monkeypatch, tmp_path):
    bent(monkeypatch)
    error_m = ws.write_czml(scene, tmp_path / "bent.czml")
    assert error_m < POSITION_ATOL_M
    text = (tmp_path / "bent.czml").read_text()
    assert len(text) < STSS_BYTES
    packets = {packet["id"]: packet for packet in json.loads(text)}
    assert isinstance(packets["sphere02"]["position"], dict)
    pieces = packets["sphere01"]["position"]
    spans = [interval(scene, piece["interval"]) for piece in pieces]
    assert spans[0][0] == 0 and spans[-1][1] == pytest.approx(scene.duration_s, abs=TIME_ATOL_S)
    assert [end for _, end in spans[:-1]] == [start for start, _ in spans[1:]]
    times = np.concatenate([np.arange(0.0, scene.duration_s, 3.1), BEND_S + np.linspace(-2, 2, 401)])
    assert shown_off_m(scene, packets["sphere01"], times).max() < POSITION_ATOL_M
    assert len(czml3.Document.load(tmp_path / "bent.czml").packets) == 69


def around(time_s, first_s, last_s):
    """Times that come ever closer to one of them, on either side, and some all over the rest."""
    step_s = np.concatenate([np.geomspace(1e-4, 1000.0, 400), np.linspace(0.05, 30.0, 300)])
    times = np.concatenate([time_s - step_s, [time_s], time_s + step_s, np.linspace(first_s, last_s, 997)])
    return np.sort(times[(times >= first_s) & (times <= last_s)])


def test_what_is_returned_holds_at_a_release(tmp_path):
    """Half a day of an orbit, and cubes that leave it at 900 s: long pieces, whose bend is between their samples."""
    body = {"shape": ws.Sphere(0.8), "surface": {"emissivity": 0.9}, "temperature": {"start_k": 300.0}}
    cubes = {"name": "cube", "count": 4, **body, "release": {"time_s": 900.0, "speed_m_s": [0.5, 1.0]}}
    late = ws.Scene.load("stss").replace(
        epoch_utc="2025-06-01T00:00:00", duration_s=43200.0, targets=[{"name": "bus", **body}, cubes], access_rules={},
        trajectory=ws.KeplerOrbit(66.0, altitude_km=600.0, raan_deg=40.0),
        constellation=ws.ListedSatellites([{"name": "eye", "orbit": ws.KeplerOrbit(64.0, altitude_km=1400.0)}]),
    )  # fmt: skip
    told_m = ws.write_czml(late, tmp_path / "late.czml")
    packets = {packet["id"]: packet for packet in json.loads((tmp_path / "late.czml").read_text())}
    times = around(900.0, 0.0, late.duration_s)
    worst_m = max(shown_off_m(late, packets[name], times).max() for name in late.target_names)
    assert worst_m < POSITION_ATOL_M
    assert worst_m < told_m < POSITION_ATOL_M  # 0.047 and 0.052; with the bend within a piece 0.130
    spans = [interval(late, piece["interval"]) for piece in packets["cube01"]["position"]]
    np.testing.assert_allclose(spans, [(0.0, 900.0), (900.0, 43200.0)], rtol=0, atol=TIME_ATOL_S)
    # So it is where the user says the step: cut at the release, and the error is the one that is told.
    told_m = ws.write_czml(late, tmp_path / "own.czml", step_s=120.0)
    packets = {packet["id"]: packet for packet in json.loads((tmp_path / "own.czml").read_text())}
    worst_m = max(shown_off_m(late, packets[name], times).max() for name in late.target_names)
    assert len(packets["cube02"]["position"]) == 2
    assert worst_m == pytest.approx(told_m, rel=0.02)


def test_a_late_release_is_a_bend(scene, tmp_path):
    late = scene.replace(release__time_s=500.0)
    assert ws.write_czml(late, tmp_path / "late.czml") < POSITION_ATOL_M
    assert (tmp_path / "late.czml").stat().st_size < STSS_BYTES
    packets = {packet["id"]: packet for packet in json.loads((tmp_path / "late.czml").read_text())}
    assert isinstance(packets["center"]["position"], dict) and isinstance(packets["cone03"]["position"], list)


def test_a_jump_is_named(scene, monkeypatch, tmp_path):
    bent(monkeypatch, jump_m=50.0)
    with pytest.raises(ws.InputError, match=r"^sphere01: jumps at 700\.[23]\d* s: samples are .* m off") as caught:
        ws.write_czml(scene, tmp_path / "a.czml")
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []
    assert ws.write_czml(scene, tmp_path / "a.czml", step_s=20.0) > 10  # all the same


def test_a_target_named_document_is_refused(scene, tmp_path):
    with pytest.raises(ws.InputError, match=r"^document: is the name of the first packet"):
        ws.write_czml(scene.replace(targets__0__name="document"), tmp_path / "a.czml")
