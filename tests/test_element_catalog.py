"""Catalogs of element sets with bad ones among them: what is left out, said and kept."""

from __future__ import annotations

import json
import re
import resource
import subprocess
import sys

import numpy as np
import pytest
from command_line import printed
from element_sets import (
    FAULTS,
    catalog,
    checksummed,
    decayed,
    low_orbit,
    not_a_number,
    one_line,
    parse_element_sets,
    uneven,
    wrong_checksum,
)
from sgp4.api import Satrec

import warpsim as ws
from warpsim.instant import utc_time

EPOCH = "2025-03-20T12:00:00"
MOST_MB = 1000.0  # asked for, of 10,000 satellites over an hour; measured 730


def by_catalog(path, **more):
    """A scene of an hour whose satellites are those of a file."""
    orbit = {"kind": "elements", "altitude_km": 900.0, "inclination_deg": 60.0}
    return ws.Scene.load("stss").replace(
        epoch_utc=EPOCH,
        duration_s=3600.0,
        frames={"count": 2, "interval_s": 60.0},
        constellation={"kind": "tle", "file": str(path), **more},
        trajectory=orbit,
        access_rules={},
        sky={"catalog": "none"},
    )


def diving(below_m):
    """Lines of a satellite that is below SGP4's ground by so much in perigee, and seconds at which it is, by sgp4."""
    time_s = np.arange(150.0, 260.0, 0.01)
    eccentricity = 2_086_000
    while True:
        lines = ["DIVING", *(checksummed(line) for line in (
            "1 00077U 25001A   25079.50000000  .00000000  00000-0  00000-0 0  999",
            f"2 00077  50.0000 100.0000 {eccentricity:07d}   0.0000 350.0000 12.00000000    1",
        ))]  # fmt: skip
        satrec = Satrec.twoline2rv(*lines[1:])
        code, r, _ = satrec.sgp4_array(np.full_like(time_s, satrec.jdsatepoch), satrec.jdsatepochF + time_s / 86400.0)
        above_m = 1e3 * (np.linalg.norm(r, axis=1).min() - satrec.radiusearthkm) + below_m
        if above_m <= 0.0:
            return lines, time_s[code != 0]
        eccentricity += max(1, int(above_m))  # 0.8 m each


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A catalog of 200 satellites, every tenth of them bad."""
    path = tmp_path_factory.mktemp("catalogs") / "small.tle"
    lines, bad = catalog(200, every=10)
    path.write_text("\n".join(lines) + "\n")
    return path, bad


def test_bad_sets_are_left_out_and_listed(small):
    path, bad = small
    scenario = by_catalog(path).scenario
    assert scenario.satellite_names == [f"SAT_{number}" for number in range(1, 201) if number not in bad]
    table = scenario.left_out
    assert sorted(table["norad_id"]) == sorted(bad) and set(table["part"]) == {"constellation"}
    reasons = dict(zip(table["norad_id"].tolist(), table["reason"], strict=True))
    words = {
        wrong_checksum: r"checksum (column 69): must be",
        one_line: r"must be followed by line 2 of its set",
        decayed: r"no state at 2025-03-20T1",
        not_a_number: r": eccentricity (column 27-33): must be seven digits, got '12O4567'",
    }
    assert all(words[fault] in reasons[number] for number, fault in bad.items())
    assert set(bad.values()) == set(FAULTS)
    assert table[0]["location"] == "line 14" and table[0]["name"] == "SAT_5"


def test_those_that_are_kept_fly_as_they_do_alone(small):
    path, bad = small
    text = path.read_text().split("\n")
    keep = [index for index, line in enumerate(text) if line.startswith("SAT ") and int(line[4:]) not in bad]
    good = [text[index + row] for index in keep for row in range(3)]
    alone = ws.TleSatellites(lines=good).states(utc_time(EPOCH), [0.0, 1800.0])[0]
    within, gone = ws.TleSatellites(file=path).within(utc_time(EPOCH), 0.0, 3600.0)
    assert np.array_equal(within.states(utc_time(EPOCH), [0.0, 1800.0])[0], alone) and len(gone) == 5


def test_skip_false_refuses_the_first(small):
    path, _ = small
    with pytest.raises(ws.InputError, match=r"^constellation: .*small.tle: line 14: SAT 5, 00005: checksum"):
        _ = by_catalog(path, skip=False).scenario
    lines = [*low_orbit(1, np.random.default_rng(2)), *decayed(low_orbit(2, np.random.default_rng(3)))]
    path = path.with_name("decayed.tle")
    path.write_text("\n".join(lines))
    assert by_catalog(path).sensor_names == ["SAT_1"]
    with pytest.raises(ws.InputError, match=r"constellation: SAT_2: no state at"):
        _ = by_catalog(path, skip=False).scenario.tracks


def test_a_catalog_of_one_set_or_without_a_good_one_is_refused():
    lines = low_orbit(1, np.random.default_rng(2))
    with pytest.raises(ws.InputError, match=r"lines: line 2: SAT 1, 00001: checksum"):
        ws.TleSatellites(lines=wrong_checksum(lines))
    both = [*wrong_checksum(lines), *one_line(low_orbit(2, np.random.default_rng(2)))]
    with pytest.raises(ws.InputError, match=r"lines: must leave an element set, got none of 2 \(line 2: checksum"):
        ws.TleSatellites(lines=both)
    for skip in (None, True):
        with pytest.raises(ws.InputError, match=r"no state at .*\(as all others\)$" if skip else "no state at"):
            _ = (
                ws.TleSatellites(lines=decayed(lines), skip=skip)
                .within(utc_time(EPOCH), 0.0, 60.0)[0]
                .states(utc_time(EPOCH), [0.0, 60.0])
            )


def test_satellites_are_excluded_by_name_and_number(small):
    path, _ = small
    left = ws.TleSatellites(file=path, exclude=["SAT 1?", "sat_2", 3, "SAT 5", "GONE"])
    assert left.names[:3] == ["SAT_1", "SAT_4", "SAT_6"] and "SAT_12" not in left.names
    assert 5 not in [item.norad_id for item in left.left_out]  # nobody asked for it
    assert left.notes(utc_time(EPOCH), 60.0) == ["exclude: no object is called GONE"]
    assert ws.TleSatellites(file=path, only="SAT 2*", exclude=[20, "SAT_2??"]).names[:2] == ["SAT_2", "SAT_21"]


def test_only_what_is_named_is_parsed(small, monkeypatch):
    path, _ = small
    parsed = []
    real = Satrec.twoline2rv
    monkeypatch.setattr(Satrec, "twoline2rv", staticmethod(lambda *lines: parsed.append(lines[0][2:7]) or real(*lines)))
    chosen = ws.TleSatellites(file=path, only=["SAT 7", 9])
    assert chosen.names == ["SAT_7", "SAT_9"] and parsed == ["00007", "00009"] and chosen.left_out == ()
    assert ws.TleOrbit(file=path, object="SAT 7").satellite.sets[0].norad_id == 7 and parsed[2:] == ["00007"]
    with pytest.raises(ws.InputError, match=r"small.tle: line 14: SAT 5, 00005: checksum"):
        _ = ws.TleOrbit(file=path, object=5).satellites
    with pytest.raises(ws.InputError, match=r"only: no object .*, got 'SAT 777'"):
        _ = ws.TleSatellites(file=path, only=["SAT 777"]).names


def test_blank_signs_of_exponents_are_read():
    """As by sgp4's own reader, which takes a blank for a plus."""
    _, first, second = low_orbit(1, np.random.default_rng(2))
    for text, value in ((" 38792 0", 0.38792), (" 38792-0", 0.38792), ("-38792 1", -3.8792), (" 00000 0", 0.0)):
        line = checksummed(first.replace(" 10000-4", text))
        (item,) = parse_element_sets(f"{line}\n{second}")
        assert item.satrec.bstar == pytest.approx(value, abs=0, rel=1e-15) == Satrec.twoline2rv(line, second).bstar


OMM = {
    "OBJECT_NAME": "A", "OBJECT_ID": "2025-001A", "EPOCH": "2025-03-20T12:00:00", "MEAN_MOTION": 15.0,
    "ECCENTRICITY": 0.001, "INCLINATION": 50.0, "RA_OF_ASC_NODE": 10.0, "ARG_OF_PERICENTER": 20.0,
    "MEAN_ANOMALY": 30.0, "NORAD_CAT_ID": 1, "BSTAR": 1e-5,
}  # fmt: skip


def kvn(fields):
    return "CCSDS_OMM_VERS = 2.0\n" + "".join(f"{name} = {value}\n" for name, value in fields.items())


def xml(fields):
    return "<omm>" + "".join(f"<{name}>{value}</{name}>" for name, value in fields.items()) + "</omm>"


LAYOUTS = {
    "kvn": lambda some: "".join(map(kvn, some)),
    "xml": lambda some: f"<ndm>{''.join(map(xml, some))}</ndm>",
    "json": json.dumps,
    "csv": lambda some: "\n".join([",".join(OMM), *(",".join(map(str, one.values())) for one in some)]),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_bad_messages_are_left_out_of_every_layout(layout):
    some = [OMM, {**OMM, "NORAD_CAT_ID": 2, "ECCENTRICITY": 2.0}, {**OMM, "NORAD_CAT_ID": 3, "OBJECT_NAME": "C"}]
    satellites = ws.TleSatellites(lines=LAYOUTS[layout](some))
    assert satellites.names == ["A-00001", "C"]
    assert [(one.norad_id, one.reason) for one in satellites.left_out] == [
        (2, "ECCENTRICITY: must be in [0, 1), got '2.0'")
    ]


def test_messages_of_broken_layout_are_left_out():
    broken = {
        "kvn": kvn(OMM) + kvn({**OMM, "NORAD_CAT_ID": 2}) + "what\n" + kvn({**OMM, "NORAD_CAT_ID": 3}),
        "json": json.dumps([OMM, {**OMM, "BSTAR": []}, 7, {**OMM, "NORAD_CAT_ID": 3}]),
        "csv": LAYOUTS["csv"]([OMM, OMM]).replace("\n", "\n1,2\n", 1) + "\n" + ",".join(
            map(str, {**OMM, "NORAD_CAT_ID": 3}.values())
        ),
        "3le": "\n".join(
            [*low_orbit(1, np.random.default_rng(1)), "LOST", *low_orbit(3, np.random.default_rng(1)), "LAST"]
        ),
    }  # fmt: skip
    for name, text in broken.items():
        satellites = ws.TleSatellites(lines=text)
        assert [one.sets[0].norad_id for one in satellites.satellites] == [1, 3], name
        assert satellites.left_out, name


@pytest.mark.ci
def test_check_and_manifest_list_what_is_left_out(tmp_path, capsys):
    lines, bad = catalog(20, every=10)
    (tmp_path / "few.tle").write_text("\n".join(lines))
    group = {
        "name": "debris",
        "orbits": {"kind": "tle", "file": str(tmp_path / "few.tle")},
        "targets": [ws.Scene.load("stss").to_dict()["groups"][0]["targets"][0]],
    }
    scene = ws.Scene.load("stss").replace(
        epoch_utc=EPOCH, duration_s=60.0, frames={"count": 1, "interval_s": 60.0}, groups=[group], access_target="any",
        access_rules={}, sky={"catalog": "none"}, camera__n_row=16, camera__n_col=16,
        pointing={"kind": "fixed", "ra_dec_deg": [0.0, 0.0]},
    )  # fmt: skip
    assert scene.target_names == [f"SAT_{number}" for number in range(1, 21) if number not in bad]
    scene.save(tmp_path / "scene.toml")
    report = printed(capsys, "check", tmp_path / "scene.toml")
    assert "  left out   2 element sets\n             SAT_5, line 14 of" in report
    ws.render_to_folder(scene, tmp_path / "run", sensors=scene.sensor_names[:1], every_frame=True)
    listed = json.loads((tmp_path / "run" / "manifest.json").read_text())["left_out"]
    assert [item["norad_id"] for item in listed] == sorted(bad)
    assert listed[0]["reason"].startswith("checksum (column 69)")


@pytest.mark.ci
def test_manifests_of_data_sets_list_what_is_left_out(tmp_path):
    """Of the recipe's scene, and of each sequence what its own epoch costs besides: the satellite dives at 12:03:24."""
    pytest.importorskip("pyarrow")
    lines = [
        *diving(100.0)[0],
        *low_orbit(1, np.random.default_rng(2)),
        *wrong_checksum(low_orbit(5, np.random.default_rng(3))),
    ]
    (tmp_path / "few.tle").write_text("\n".join(lines))
    scene = by_catalog(tmp_path / "few.tle").replace(
        duration_s=60.0, frames={"count": 1, "interval_s": 60.0}, camera__n_row=16, camera__n_col=16,
        pointing={"kind": "fixed", "ra_dec_deg": [0.0, 0.0]},
    )  # fmt: skip
    epochs = {EPOCH: [], EPOCH.replace("12:00", "12:01"): [77]}
    recipe = ws.Recipe(scene=scene, n_sequence=6, n_frame=1, every_frame=True, bands=["A"],
                       sample={"epoch_utc": {"choice": list(epochs)}})  # fmt: skip
    ws.write_dataset(recipe, tmp_path / "set", n_worker=1, device="cpu")
    manifest = json.loads((tmp_path / "set" / "manifest.json").read_text())
    (known,) = manifest["left_out"]
    assert (known["norad_id"], known["part"], known["location"]) == (5, "constellation", "line 8")
    assert known["reason"].startswith("checksum (column 69)")
    drawn = [one for shard in manifest["shards"].values() for one in shard["sequences"]]
    assert {one["epoch_utc"] for one in drawn} == set(epochs)
    for one in drawn:
        assert [more["norad_id"] for more in one.get("left_out", [])] == epochs[one["epoch_utc"]]


@pytest.mark.slow
@pytest.mark.parametrize(("n", "n_uneven"), [(1000, 0), (10_000, 0), (10_600, 26)])
def test_large_catalogs_take_little_memory(tmp_path, n, n_uneven):
    """Tracks of an hour, in a process of its own: its peak of memory is that of the scene."""
    lines, bad = catalog(n)
    lines += [line for number in range(20_000, 20_000 + n_uneven) for line in uneven(number)]
    (tmp_path / "large.tle").write_text("\n".join(lines))
    by_catalog(tmp_path / "large.tle").save(tmp_path / "scene.toml")
    code = (
        "import sys, warpsim as ws\n"
        "scenario = ws.Scene.load(sys.argv[1]).scenario\n"
        "even = scenario.tracks.satellites[: int(sys.argv[2])]\n"
        "print(len(scenario.satellite_names), len(scenario.left_out), max(track.error_m for track in even))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "scene.toml"), str(n - len(bad))],
        capture_output=True,
        text=True,
        check=True,
    )
    n_good, n_bad, error_m = done.stdout.split()[-3:]
    assert (int(n_good), int(n_bad)) == (n + n_uneven - len(bad), len(bad)) and float(error_m) < 1e-3
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024 < MOST_MB


@pytest.mark.parametrize("below_m", [0.5, 100.0])
def test_dives_between_two_looks_are_found(below_m):
    """A perigee that is without a state for seconds, within a minute at whose ends there are states."""
    lines, gone_s = diving(below_m)
    assert 180.0 < gone_s.min() < gone_s.max() < 240.0 and np.ptp(gone_s) < 25.0
    both = [*lines, *low_orbit(1, np.random.default_rng(2))]
    satellites = ws.TleSatellites(lines=both)
    satellites.states(utc_time(EPOCH), 60.0 * np.arange(11))  # every minute has one
    rest, (one,) = satellites.within(utc_time(EPOCH), 0.0, 600.0)
    assert rest.names == ["SAT_1"] and (one.name, one.norad_id, one.location) == ("DIVING", 77, "line 2")
    found_s = float(re.search(r"\(([\d.]+) s\): SGP4: mrt is less than 1\.0", one.reason)[1])
    assert gone_s.min() - 0.1 <= found_s <= gone_s.max() + 0.1
    assert ws.TleSatellites(lines=both, skip=False).within(utc_time(EPOCH), 0.0, 600.0)[0].names == satellites.names


def test_low_perigees_above_the_ground_are_kept():
    lines, _ = diving(-2.0)  # a metre or two above it
    both = ws.TleSatellites(lines=[*lines, *low_orbit(1, np.random.default_rng(2))])
    assert both.within(utc_time(EPOCH), 0.0, 600.0) == (both, [])
    assert both.within(utc_time(EPOCH), 250.0, 400.0) == (both, [])  # rises throughout, below 6,400 km at first


def test_scenes_do_without_what_dives_between_two_looks(tmp_path):
    path = tmp_path / "two.tle"
    path.write_text("\n".join([*diving(100.0)[0], *low_orbit(1, np.random.default_rng(2))]))
    scenario = by_catalog(path).scenario
    assert scenario.satellite_names == ["SAT_1"] and list(scenario.left_out["name"]) == ["DIVING"]
    assert [track.name for track in scenario.tracks.satellites] == ["SAT_1"]
    with pytest.raises(ws.InputError, match="constellation: DIVING: no state at 2025-03-20T12:03:"):
        _ = by_catalog(path, skip=False).scenario.tracks


def test_scenes_with_decayed_satellites_and_targets_are_rendered(tmp_path):
    """In mixtures of constellations and groups of orbits too; the description stays as it was given."""
    rng = np.random.default_rng(4)
    lines = [*low_orbit(1, rng), *decayed(low_orbit(2, rng)), *low_orbit(3, rng)]
    others = [*low_orbit(7, rng), *decayed(low_orbit(8, rng))]
    for name, some in {"one.tle": lines, "two.tle": others}.items():
        (tmp_path / name).write_text("\n".join(some))
    walker = {
        "kind": "walker",
        "n_satellite": 2,
        "n_plane": 1,
        "phasing": 0,
        "altitude_km": 1400.0,
        "inclination_deg": 60.0,
    }
    scene = ws.Scene.load("stss").replace(
        epoch_utc=EPOCH, duration_s=60.0, frames={"count": 1, "interval_s": 60.0}, access_rules={},
        sky={"catalog": "none"}, pointing={"kind": "fixed", "ra_dec_deg": [0.0, 0.0]},
        constellation={"kind": "mixed", "parts": [walker, {"kind": "tle", "file": str(tmp_path / "one.tle")}]},
        groups=[{"name": "debris", "orbits": {"kind": "tle", "file": str(tmp_path / "two.tle")},
                 "targets": [ws.Scene.load("stss").to_dict()["groups"][0]["targets"][0]]}],
    )  # fmt: skip
    scenario = scene.scenario
    assert scenario.satellite_names == ["sat11", "sat12", "SAT_1", "SAT_3"] and scenario.target_names == ["SAT_7"]
    assert sorted(zip(scenario.left_out["part"], scenario.left_out["norad_id"], strict=True)) == [
        ("constellation", 2),
        ("orbits", 8),
    ]
    assert scenario.scene.to_dict() == scene.to_dict() and scenario.scene.sensor_names == scenario.sensor_names
    frames = ws.Renderer(scene, "cpu").render([0], sensors=["SAT_3"])
    assert set(frames.truth["target"]) == {"SAT_7"}
