"""CZML: read back as JSON and interpolated as Cesium does, it is the scene."""

import itertools
import json

import numpy as np
import pytest
from astropy.time import Time

import warpsim as ws
from warpsim.output.czml_parts import czml_dates, interpolated, sampled_track

czml3 = pytest.importorskip("czml3")

POSITION_ATOL_M = 0.1  # what the samples are chosen for; their rounding is 1 mm
TIME_ATOL_S = 1e-6  # digits of the dates
STSS_BYTES = 5_000_000
FIELD_RTOL = 1e-3  # of the field's side: what the samples of corners are chosen for


@pytest.fixture(scope="module")
def written(scene, tmp_path_factory):
    path = tmp_path_factory.mktemp("czml") / "stss.czml"
    return path, ws.write_czml(scene, path)


@pytest.fixture(scope="module")
def packets(written):
    return read(written[0])


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


def read(path):
    """The packets of a file by their ids, which occur once."""
    packets = json.loads(path.read_text("utf-8"))
    assert len({packet["id"] for packet in packets}) == len(packets)
    return {packet["id"]: packet for packet in packets}


def written_packets(scene, path):
    ws.write_czml(scene, path)
    return read(path)


def shown_m(scene, packet, times):
    """Positions at which Cesium shows a packet, (n, 3) [m]."""
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
    return np.array(shown)


def shown_off_m(scene, packet, times):
    """How far a body is from the scene's position where Cesium shows it, (n,) [m]."""
    return np.linalg.norm(shown_m(scene, packet, times) - scene.position_m(packet["id"], times), axis=1)


def shown_spans(scene, packet):
    """When a line is shown [s], but for its being hidden otherwise."""
    never, *shown = packet["polyline"]["show"]
    assert never["boolean"] is False and interval(scene, never["interval"]) == pytest.approx((0, 1614), abs=1e-6)
    assert all(item["boolean"] is True for item in shown)
    return [interval(scene, item["interval"]) for item in shown]


@pytest.mark.ci
def test_positions_are_the_scenes_where_cesium_interpolates(scene, packets, written):
    times = np.concatenate([np.arange(0.0, scene.duration_s, 7.3), [1e-3, scene.duration_s - 1e-3, scene.duration_s]])
    worst_m = 0.0
    for name in [*scene.sensor_names, *scene.target_names]:
        position = packets[name]["position"]
        assert position["referenceFrame"] == "INERTIAL"
        assert seconds(scene, position["epoch"]) == 0
        samples = np.array(position["cartesian"]).reshape(-1, 4)
        assert samples[0, 0] == 0 and samples[-1, 0] == scene.duration_s
        worst_m = max(worst_m, shown_off_m(scene, packets[name], times).max())
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
    drawn = [name for name in packets if name.startswith(("access/", "field/"))]
    assert set(packets) == {"document", *scene.sensor_names, *scene.target_names, *drawn}
    for name in [*scene.sensor_names, *scene.target_names]:
        packet = packets[name]
        assert packet["label"]["text"] == packet["name"] == name
        assert interval(scene, packet["availability"]) == pytest.approx((0, 1614), abs=TIME_ATOL_S)
        assert packet["path"]["leadTime"] == scene.duration_s and packet["point"]["pixelSize"] > 0
    assert packets["sat11"]["label"]["show"] and packets["center"]["path"]["show"]
    assert not packets["sphere01"]["label"]["show"]
    assert packets["cone01"]["description"] == "target, cone"
    assert packets["sat11"]["description"] == "satellite"


def test_lines_of_sight_show_during_access(scene, packets):
    table = scene.access()
    assert {name.split("/")[1] for name in packets if name.startswith("access/")} == set(table["sensor"])
    for sensor in set(table["sensor"]):
        line = packets[f"access/{sensor}/center"]["polyline"]
        assert line["positions"]["references"] == [f"{sensor}#position", "center#position"]
        assert line["arcType"] == "NONE"
        rows = [(row["start_s"], row["end_s"]) for row in table if row["sensor"] == sensor]
        spans = shown_spans(scene, packets[f"access/{sensor}/center"])
        np.testing.assert_allclose(spans, rows, rtol=0, atol=TIME_ATOL_S)


def test_czml3_takes_it_back(written):
    path, _ = written
    document = czml3.Document.load(path)
    assert len(document.packets) == 1 + 58 + 10 + 10 * 5
    assert path.stat().st_size < STSS_BYTES


@pytest.mark.ci
def test_a_step_of_ones_own(scene, tmp_path):
    coarse = ws.write_czml(scene, tmp_path / "coarse.czml", step_s=270.0)
    fine = ws.write_czml(scene, tmp_path / "fine.czml", step_s=30.0)
    assert fine < 0.01 < 1.0 < coarse  # m
    span_s = (0.0, scene.duration_s)
    ((time_s, position_m),), _ = sampled_track(lambda s: scene.position_m("sat11", s), span_s, step_s=270.0)
    assert len(time_s) == 7
    np.testing.assert_allclose(position_m, scene.position_m("sat11", time_s), rtol=0, atol=0.6e-3)


@pytest.mark.ci
def test_dates_count_leap_seconds(tmp_path):
    before = {"epoch_utc": "2016-12-31T23:50:00", "access_rules": {}}
    leap = ws.Scene.load("stss").replace(**before)
    packets = written_packets(leap, tmp_path / "leap.czml")
    assert packets["document"]["clock"]["interval"] == "2016-12-31T23:50:00.000000Z/2017-01-01T00:16:53.000000Z"
    assert czml_dates(leap.epoch_utc, [599.5, 600.25, 601.0]) == [
        "2016-12-31T23:59:59.500000Z", "2017-01-01T00:00:00.000000Z", "2017-01-01T00:00:00.000000Z",
    ]  # fmt: skip


@pytest.mark.ci
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


PUSH_S, PUSH_M_S = 700.3, np.array([3.0, -4.0, 1.0])


def pushed(monkeypatch, jump_m=0.0):
    """Scenes whose sphere01 gets a push at 700.3 s that the scene does not know of."""
    straight = ws.Scenario.position_m

    def position_m(self, name, time_s):
        later_s = np.maximum(np.atleast_1d(time_s) - PUSH_S, 0)[:, None]
        return straight(self, name, time_s) + (name == "sphere01") * (later_s * PUSH_M_S + jump_m * (later_s > 0))

    monkeypatch.setattr(ws.Scenario, "position_m", position_m)


@pytest.mark.ci
def test_a_breakpoint_is_between_intervals(scene, monkeypatch, tmp_path):
    pushed(monkeypatch)
    error_m = ws.write_czml(scene, tmp_path / "pushed.czml")
    assert error_m < POSITION_ATOL_M
    assert (tmp_path / "pushed.czml").stat().st_size < STSS_BYTES
    packets = read(tmp_path / "pushed.czml")
    assert isinstance(packets["sphere02"]["position"], dict)
    pieces = packets["sphere01"]["position"]
    spans = [interval(scene, piece["interval"]) for piece in pieces]
    assert spans[0][0] == 0 and spans[-1][1] == pytest.approx(scene.duration_s, abs=TIME_ATOL_S)
    assert [end for _, end in spans[:-1]] == [start for start, _ in spans[1:]]
    times = np.concatenate([np.arange(0.0, scene.duration_s, 3.1), PUSH_S + np.linspace(-2, 2, 401)])
    assert shown_off_m(scene, packets["sphere01"], times).max() < POSITION_ATOL_M
    assert len(czml3.Document.load(tmp_path / "pushed.czml").packets) == 119


def around(time_s, first_s, last_s):
    """Times that come ever closer to one of them, on either side, and some all over the rest."""
    step_s = np.concatenate([np.geomspace(1e-4, 1000.0, 400), np.linspace(0.05, 30.0, 300)])
    times = np.concatenate([time_s - step_s, [time_s], time_s + step_s, np.linspace(first_s, last_s, 997)])
    return np.sort(times[(times >= first_s) & (times <= last_s)])


def broken(time_s):
    """A half ellipse around the Earth, pushed at 900 s: a breakpoint that would lie within a long piece."""
    angle = np.asarray(time_s) / 900.0
    circle = np.stack([7e6 * np.cos(angle), 7.2e6 * np.sin(angle), 0 * angle], axis=1)
    return circle + np.maximum(np.asarray(time_s) - 900.0, 0.0)[:, None] * [1e-3, 0.0, 0.0]


@pytest.mark.parametrize("step_s", [None, 60.0])
def test_motion_is_cut_at_known_breakpoints(step_s):
    pieces, told_m = sampled_track(broken, (100.0, 2500.0), [0.0, 900.0, 2500.0], step_s)
    assert [(piece[0][0], piece[0][-1]) for piece in pieces] == [(100.0, 900.0), (900.0, 2500.0)]
    worst_m = 0.0
    for time_s, position_m in pieces:
        times = around(900.0, time_s[0], time_s[-1])
        off_m = interpolated(time_s, position_m, times) - broken(np.minimum(times, np.nextafter(time_s[-1], 0)))
        worst_m = max(worst_m, np.linalg.norm(off_m, axis=1).max())
    assert worst_m == pytest.approx(told_m, rel=0.02)
    assert step_s or told_m < POSITION_ATOL_M


@pytest.mark.ci
def test_what_is_returned_holds_after_a_release(tmp_path):
    """Half a day of an orbit, and cubes that leave it at 900 s."""
    body = {"shape": ws.Sphere(0.8), "surface": {"emissivity": 0.9}, "temperature": {"start_k": 300.0}}
    cubes = {"name": "cube", "count": 4, **body, "release": {"time_s": 900.0, "speed_m_s": [0.5, 1.0]}}
    late = ws.Scene.load("stss").replace(
        epoch_utc="2025-06-01T00:00:00", duration_s=43200.0, targets=[{"name": "bus", **body}, cubes], access_rules={},
        trajectory=ws.KeplerOrbit(66.0, altitude_km=600.0, raan_deg=40.0),
        constellation=ws.ListedSatellites([{"name": "eye", "orbit": ws.KeplerOrbit(64.0, altitude_km=1400.0)}]),
    )  # fmt: skip
    told_m = ws.write_czml(late, tmp_path / "late.czml")
    packets = read(tmp_path / "late.czml")
    first_s = {"bus": 0.0} | dict.fromkeys(late.target_names[1:], 900.0)
    worst_m = 0.0
    for name in late.target_names:
        assert interval(late, packets[name]["availability"]) == pytest.approx((first_s[name], 43200), abs=TIME_ATOL_S)
        times = around(900.0, first_s[name], late.duration_s)
        worst_m = max(worst_m, shown_off_m(late, packets[name], times).max())
    assert worst_m < told_m < POSITION_ATOL_M
    # So it is where the user says the step: the error is the one that is told.
    told_m = ws.write_czml(late, tmp_path / "own.czml", step_s=120.0)
    packets = read(tmp_path / "own.czml")
    times = {name: around(900.0, first_s[name], late.duration_s) for name in late.target_names}
    worst_m = max(shown_off_m(late, packets[name], times[name]).max() for name in late.target_names)
    assert worst_m == pytest.approx(told_m, rel=0.02)


@pytest.mark.ci
def test_targets_are_available_from_their_release_on(scene, tmp_path):
    late = scene.replace(release__time_s=500.0)
    assert ws.write_czml(late, tmp_path / "late.czml") < POSITION_ATOL_M
    packets = read(tmp_path / "late.czml")
    assert interval(scene, packets["center"]["availability"]) == pytest.approx((0, 1614), abs=TIME_ATOL_S)
    assert interval(scene, packets["cone03"]["availability"]) == pytest.approx((500, 1614), abs=TIME_ATOL_S)
    assert packets["cone03"]["position"]["cartesian"][0] == 500.0
    never = scene.replace(targets__3__release={"time_s": scene.duration_s})
    packets = written_packets(never, tmp_path / "never.czml")
    assert "cylinder01" in packets and "cone01" not in packets


@pytest.mark.ci
def test_a_jump_is_named(scene, monkeypatch, tmp_path):
    pushed(monkeypatch, jump_m=50.0)
    with pytest.raises(ws.InputError, match=r"^sphere01: jumps at 700\.[23]\d* s: samples are .* m off") as caught:
        ws.write_czml(scene, tmp_path / "a.czml")
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []
    assert ws.write_czml(scene, tmp_path / "a.czml", step_s=20.0) > 10  # all the same


def test_a_target_named_document_is_refused(scene, tmp_path):
    with pytest.raises(ws.InputError, match=r"^document: is the name of the first packet"):
        ws.write_czml(scene.replace(targets__0__name="document"), tmp_path / "a.czml")


# --- several kinds of sensors, several groups ---


WIDE = {
    "name": "wide", "camera": {"n_row": 60, "n_col": 100, "fov_deg": 90.0}, "bands": ["A"],
    "optics": {"aperture_m": 0.1, "psf": "gaussian"}, "pointing": {"kind": "fixed", "azimuth_elevation_deg": [0, -25]},
    "on": ["sat1*"], "access_rules": {"in_fov": True},
}  # fmt: skip
SECOND = {
    "name": "second",
    "trajectory": {
        "kind": "ballistic_arc", "start_lon_lat_deg": [100.0, 50.0], "end_lon_lat_deg": [-150.0, 40.0],
        "duration_s": 1000.0, "endpoint_altitude_km": 100.0,
    },
    "targets": [
        {"name": name, "count": count, "shape": {"kind": "sphere", "radius_m": 0.3}, "surface": {"reflectance": 0.5},
         "temperature": {"start_k": 300.0}}
        for name, count in (("bus", 1), ("ball", 3))
    ],
    "release": {"time_s": 100.0, "speed_m_s": [1.0, 1.0]},
    "start_s": 400.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def two(scene):
    """Two kinds of sensors, both on the first plane's satellites, and a group that exists from 400 to 1400 s."""
    data = scene.to_dict()
    narrow = {**data["sensors"][0], "name": "narrow"}
    wide = {**WIDE, "detector": narrow["detector"]}
    return scene.replace(sensors=[narrow, wide], groups=[data["groups"][0], SECOND])


@pytest.fixture(scope="module")
def packets_of_two(two, tmp_path_factory):
    path = tmp_path_factory.mktemp("czml") / "two.czml"
    assert ws.write_czml(two.scenario, path) < POSITION_ATOL_M
    return read(path)


@pytest.mark.ci
def test_satellites_with_several_sensors_are_packets_once(two, packets_of_two):
    bodies = {name for name in packets_of_two if "/" not in name}
    assert bodies == {"document", *two.scenario.satellite_names, *two.target_names}
    assert packets_of_two["sat11"]["description"] == "satellite, sat11.narrow, sat11.wide"
    assert packets_of_two["sat21"]["description"] == "satellite"


@pytest.mark.ci
def test_targets_are_available_while_they_exist(two, packets_of_two):
    spans = {"bus": (400, 1400), "ball02": (500, 1400), "center": (0, 1614), "sat11": (0, 1614)}
    for name, span in spans.items():
        packet = packets_of_two[name]
        assert interval(two, packet["availability"]) == pytest.approx(span, abs=TIME_ATOL_S)
        rows = np.array(packet["position"]["cartesian"]).reshape(-1, 4)
        assert (rows[0, 0], rows[-1, 0]) == span
        assert shown_off_m(two, packet, np.linspace(*span, 400)).max() < POSITION_ATOL_M
    assert packets_of_two["bus"]["label"]["show"] and not packets_of_two["ball01"]["label"]["show"]


@pytest.mark.ci
def test_lines_of_sight_are_those_of_each_sensor(two, packets_of_two):
    lines = {name for name in packets_of_two if name.startswith("access/")}
    expected = {}
    for target in ("center", "bus"):  # what the wide ones count by: any target
        for row in two.access(target, sensors="wide"):
            expected.setdefault(f"access/{row['sensor']}/{target}", []).append((row["start_s"], row["end_s"]))
    for row in two.access("center", sensors="narrow"):
        expected.setdefault(f"access/{row['sensor']}/center", []).append((row["start_s"], row["end_s"]))
    assert lines == set(expected)
    assert any(name.endswith("wide/bus") for name in lines) and "access/sat11.narrow/center" in lines
    for name, spans in expected.items():
        np.testing.assert_allclose(shown_spans(two, packets_of_two[name]), spans, rtol=0, atol=TIME_ATOL_S)
        satellite = name.split("/")[1].partition(".")[0]
        references = packets_of_two[name]["polyline"]["positions"]["references"]
        assert references == [f"{satellite}#position", f"{name.split('/')[2]}#position"]


@pytest.mark.ci
def test_fields_of_view_are_those_of_each_camera(two, packets_of_two):
    edges = [name for name in packets_of_two if name.startswith("field/") and name.count("/") == 1]
    seeing = {row["sensor"] for row in two.access(sensors="narrow")}
    assert set(edges) == {f"field/{name}" for name in (*seeing, *two.scenario.instruments["wide"].names)}
    assert shown_spans(two, packets_of_two["field/sat13.wide"]) == [pytest.approx((0, 1614), abs=TIME_ATOL_S)]
    rows = [(row["start_s"], row["end_s"]) for row in two.access(sensors="sat11.narrow")]
    np.testing.assert_allclose(shown_spans(two, packets_of_two["field/sat11.narrow"]), rows, rtol=0, atol=TIME_ATOL_S)
    corners = [f"field/sat11.wide/{number}" for number in (1, 2, 3, 4)]
    references = packets_of_two["field/sat11.wide"]["polyline"]["positions"]["references"]
    drawn = {frozenset(pair) for pair in itertools.pairwise(text.removesuffix("#position") for text in references)}
    around_it = zip(corners, [*corners[1:], corners[0]], strict=True)
    assert drawn == {frozenset(pair) for pair in (*(("sat11", corner) for corner in corners), *around_it)}
    times = np.array([0.0, 333.3, 700.0, 1234.5])
    for sensor, reach_m in (("sat11.narrow", 6e6), ("sat11.wide", None)):
        check_corners(two, packets_of_two, sensor, reach_m, times)


def check_corners(scene, packets, sensor, reach_m, times):
    """Corners as seen from the satellite are at the array's corners, and as far away as they should be."""
    camera = scene.scenario.instrument_of(sensor).sensor.camera
    satellite_m, velocity_m_s = scene.scenario.tracks.state(sensor.partition(".")[0], times)
    axes = scene.scenario.view_axes(sensor, times)
    right, bottom = camera.n_col - 0.5, camera.n_row - 0.5
    places = [[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]]
    for number, expected_px in enumerate(places):
        line_m = shown_m(scene, packets[f"field/{sensor}/{number + 1}"], times) - satellite_m
        length_m = np.linalg.norm(line_m, axis=1)
        limb_m = np.sqrt(np.sum(satellite_m**2, axis=1) - 6_378_137.0**2)
        np.testing.assert_allclose(length_m, limb_m if reach_m is None else reach_m, rtol=1e-3)
        seen = ws.apparent_direction(line_m / length_m[:, None], velocity_m_s)
        for direction, at in zip(seen, axes, strict=True):
            xy_px, in_front = camera.project(direction[None], at)
            assert in_front[0]
            np.testing.assert_allclose(xy_px[0], expected_px, rtol=0, atol=2 * FIELD_RTOL * camera.n_col)


@pytest.mark.ci
def test_a_camera_that_steps_has_a_field_in_pieces(scene, tmp_path):
    """Before and after a step the corners are those of the one direction and the other, up to the step itself."""
    steps = [{"start_s": 0.0, "ra_dec_deg": [10.0, 80.0]}, {"start_s": 640.0, "ra_dec_deg": [200.0, -30.0]}]
    stepping = scene.replace(pointing={"kind": "schedule", "steps": steps})
    packets = written_packets(stepping, tmp_path / "steps.czml")
    pieces = packets["field/sat13/1"]["position"]
    spans = [interval(scene, piece["interval"]) for piece in pieces]
    np.testing.assert_allclose(spans, [(0.0, 640.0), (640.0, 1614.0)], rtol=0, atol=TIME_ATOL_S)
    check_corners(stepping, packets, "sat13", 6e6, np.array([1.0, 600.0, 639.999, 640.001, 700.0, 1600.0]))


@pytest.mark.ci
def test_a_line_of_sight_follows_the_steps_of_a_sensor(two, tmp_path):
    steps = [{"start_s": 0.0, "track": "main"}, {"start_s": 900.0, "track": "second"}]
    data = two.to_dict()["sensors"]
    data[0]["pointing"] = [{"kind": "schedule", "steps": steps}]
    stepping = two.replace(sensors=data[:1], access_rules={})
    packets = written_packets(stepping, tmp_path / "steps.czml")
    before, after = (shown_spans(stepping, packets[f"access/sat11/{name}"]) for name in ("center", "bus"))
    assert before[-1][1] == pytest.approx(900.0, abs=TIME_ATOL_S)
    assert after[0][0] == pytest.approx(900.0, abs=TIME_ATOL_S) and after[-1][1] <= 1400.0 + TIME_ATOL_S


@pytest.mark.ci
def test_a_scene_without_targets_is_written(scene, tmp_path):
    pointing = {"kind": "fixed", "azimuth_elevation_deg": [0, -20]}
    empty = scene.replace(groups=[], sensors__0__pointing=pointing)
    assert ws.write_czml(empty, tmp_path / "empty.czml") < POSITION_ATOL_M
    packets = read(tmp_path / "empty.czml")
    assert len(packets) == 1 + 28 + 28 * 5
