"""Temperatures that are given: linear, constant and tabulated, on host and device, from files, and what is refused."""

import astropy.units as u
import numpy as np
import pytest
import warp as wp
from bodies import emission_s
from on_devices import launched
from refusals import refused_in_one_line
from warpsim_kernels import timed_tables

import warpsim as ws
from warpsim.render.target_field import make_temperatures
from warpsim.scene.scene_files import named_files
from warpsim.target.temperature import TemperatureRows, checked_rows

SEED = 161803

ROUNDING = 4e-16  # of a sum and a product
TRUTH_ATOL_K = 1e-9  # emission times from ranges printed in km


@wp.kernel(enable_backward=False)
def temperature_kernel(
    tables: timed_tables.TemperatureTables,
    first: int,
    count: int,
    time_s: wp.array[wp.float64],
    kelvin: wp.array[wp.float64],
):
    i = wp.tid()
    kelvin[i] = timed_tables.temperature_k(tables, first, count, time_s[i])


def on_device(all_rows, number, time_s, device):
    """Temperatures of one of several targets."""
    tables, spans, _ = make_temperatures(all_rows, wp.get_device(device))
    return launched(temperature_kernel, len(time_s), [tables, *spans[number], time_s], [wp.float64], device)[0]


def some_rows(n, last_s, seed=SEED):
    rng = np.random.default_rng(seed)
    time_s = np.concatenate([[0.0], np.sort(rng.uniform(0, last_s, n - 2)), [last_s]])
    return checked_rows(time_s, rng.uniform(100.0, 400.0, n))


def test_linear_constant_and_tabulated_are_the_same_on_device_and_host(device):
    all_rows = [
        ws.Temperature(350.0, 328.0).rows(0.0, 1614.0),
        some_rows(1000, 1614.0),
        ws.Temperature(300.0).rows(0.0, 1614.0),
        some_rows(2, 900.0, 1),
        ws.TemperatureTable([5.0], [77.0]).rows(None),
    ]
    times = np.concatenate(
        [np.random.default_rng(1).uniform(-0.9, 900.9, 5000), [0.0, 900.0], all_rows[1].time_s[:500]]
    )
    for number, rows in enumerate(all_rows):
        expected = np.interp(times, rows.time_s, rows.temperature_k)
        for seen in (rows.at(times), on_device(all_rows, number, times, device)):
            np.testing.assert_allclose(seen, expected, rtol=ROUNDING * 10, atol=0)
    assert all_rows[2].span_s == all_rows[4].span_s == (-np.inf, np.inf)


def test_ends_hold_for_a_second(device):
    rows = ws.Temperature(320.0, 270.0).rows(0.0, 400.0)
    times = np.array([-1.0, -1e-3, 400.001, 401.0])
    np.testing.assert_array_equal(rows.at(times), [320.0, 320.0, 270.0, 270.0])
    np.testing.assert_array_equal(on_device([rows], 0, times, device), [320.0, 320.0, 270.0, 270.0])
    for time in (-1.01, 401.1, np.nan):
        with pytest.raises(ws.InputError, match="time_s: must be within the temperatures, 0 to 400 s"):
            rows.at(time)


def test_rows_that_are_shared_lie_on_the_device_once(scene):
    tables, spans, span_k = make_temperatures(scene.scenario.temperatures, wp.get_device("cpu"))
    assert len(spans) == 30
    assert tables.time_s.shape == (2 * 4,)
    assert span_k == (328.0, 350.0)


# Tables


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "file, time_s: exactly one of a file, or time_s with temperature_k"),
        ({"file": "t.csv", "time_s": [0.0], "temperature_k": [300.0]}, "file, time_s: exactly one"),
        ({"time_s": [0.0]}, "time_s, temperature_k: both must be given"),
        ({"temperature_k": [300.0]}, "time_s, temperature_k: both must be given"),
        ({"time_s": [], "temperature_k": []}, "time_s: must hold at least one time"),
        ({"time_s": [0, 1], "temperature_k": [300.0]}, "temperature_k: must have one for each of 2 times, got 1"),
        ({"time_s": [0, 0], "temperature_k": [300.0] * 2}, "row 1: time_s: must ascend, got 0 after 0"),
        ({"time_s": [0, 2, 1], "temperature_k": [300.0] * 3}, "row 2: time_s: must ascend, got 1 after 2"),
        ({"time_s": [0, 1], "temperature_k": [300.0, np.nan]}, r"temperature_k\[1\]: must be finite, got nan"),
        ({"time_s": [0, np.inf], "temperature_k": [300.0] * 2}, r"time_s\[1\]: must be finite"),
        ({"time_s": [0, 1], "temperature_k": [300.0, 0.0]}, r"temperature_k\[1\]: must be > 0, got 0"),
        ({"time_s": [0, 1], "temperature_k": [300.0, 2e5]}, r"temperature_k\[1\]: must be in \[0, 100000\]"),
        ({"time_s": 3.0, "temperature_k": [300.0]}, "time_s: must be a list, got 3.0"),
        (
            {"time_s": [0, 60, 300, 360], "temperature_k": [300.0] * 4, "max_gap_s": 60.0},
            r"row 2: time_s: must be at most max_gap_s \(60 s\) after the row before, got a gap from 60 to 300 s",
        ),
        ({"time_s": [0], "temperature_k": [1.0], "max_gap_s": 0}, "max_gap_s: must be > 0"),
    ],
)
def test_bad_tables_are_refused_in_one_line(fields, message):
    with refused_in_one_line(message):
        ws.TemperatureTable(**fields)


def test_arrays_and_quantities_are_taken():
    table = ws.TemperatureTable(np.arange(3) * u.min, np.array([300.0, 310.0, 305.0]) * u.K)
    assert table.time_s == (0.0, 60.0, 120.0)
    assert table.rows(None).at(90.0)[0] == pytest.approx(307.5, abs=1e-12)
    assert ws.Temperature(0.3 * u.kK).start_k == pytest.approx(300.0, rel=1e-15)
    with pytest.raises(ws.InputError, match="time_s: must be convertible to s"):
        ws.TemperatureTable([1.0] * u.m, [300.0])


CSV = "# made by hand\ntime_s,temperature_k\n0,300\n800,310.5\n1700,290\n"


def with_file(scene, tmp_path, text, name="t.csv", **fields):
    """A saved scene whose spheres take their temperature from a file beside it."""
    (tmp_path / name).write_text(text)
    data = scene.to_dict()
    data["groups"][0]["targets"][1]["temperature"] = {"kind": "table", "file": str(tmp_path / name), **fields}
    path = tmp_path / "scene.json"
    ws.Scene.from_dict(data).save(path)
    return path


def test_a_file_beside_the_scene_is_read(scene, tmp_path):
    loaded = ws.Scene.load(with_file(scene, tmp_path, CSV))
    np.testing.assert_allclose(loaded.scenario.temperature_k("sphere04", [0.0, 400.0, 1250.0]), [300.0, 305.25, 300.25])
    assert loaded.scenario.temperatures[1] is loaded.scenario.temperatures[10]  # one table for the ten spheres
    assert named_files(loaded.to_dict()) == [str(tmp_path / "t.csv")]
    table = loaded.groups[0].targets[1].temperature
    assert len(table.checksum) == 64
    (tmp_path / "t.csv").unlink()  # read once
    assert table.rows(loaded.epoch).at(400.0)[0] == pytest.approx(305.25, abs=1e-9)


def test_a_file_is_counted_from_the_directory_of_its_table(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    table = ws.TemperatureTable(file="t.csv")
    monkeypatch.chdir(tmp_path.parent)
    assert table.file == str(tmp_path / "t.csv")
    with pytest.raises(ws.InputError, match=rf"^{table.file}: cannot be read"):
        table.rows(None)


def test_dates_and_units_of_columns_are_honoured(scene, tmp_path):
    dates = "time_utc,temperature_k\n2025-01-01T13:59:00,300\n2025-01-01T14:10:00,310\n2025-01-01T15:00:00,290\n"
    loaded = ws.Scene.load(with_file(scene, tmp_path, dates))
    assert loaded.scenario.temperature_k("sphere01", 600.0)[0] == pytest.approx(310.0, abs=1e-9)
    ecsv = (
        "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: time_s, unit: min, datatype: float64}\n"
        "# - {name: temperature_k, unit: mK, datatype: float64}\ntime_s temperature_k\n0 300000\n30 310000\n"
    )
    loaded = ws.Scene.load(with_file(scene, tmp_path, ecsv, "t.ecsv"))
    assert loaded.scenario.temperature_k("sphere01", 900.0)[0] == pytest.approx(305.0, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (CSV.replace("310.5", ""), r"t\.csv: line 4: temperature_k: must be given, a table must have no gap"),
        (CSV.replace("310.5", "nan"), r"line 4: temperature_k: must be given, a table must have no gap"),
        (CSV.replace("800", ""), r"t\.csv: line 4: time_s: must be finite, a table must have no gap"),
        (CSV.replace("310.5", "warm"), r"t\.csv: line 4: column temperature_k: must be a number, got 'warm'"),
        (CSV.replace("310.5", "-3"), r"t\.csv: line 4: temperature_k: must be in \(0, 100000\], got -3"),
        (CSV.replace("800", "1800"), r"t\.csv: line 5: time_s: must ascend, got 1700 after 1800"),
        (CSV.replace("1700", "1600"), r"t\.csv: must cover the scene, 0 to 1614 s, got 0 to 1600 s$"),
        (CSV.replace("\n0,", "\n0.5,"), r"t\.csv: must cover the scene, 0 to 1614 s, got 0\.5 to 1700 s$"),
        (CSV.replace("temperature_k", "kelvin"), r"must have columns of temperature .*, got time_s, kelvin"),
        (CSV.replace("time_s", "t"), r"must have one of the columns time_s .* and time_utc"),
        ("", r"t\.csv: must hold data, got an empty file"),
        ("time_s,temperature_k\n", r"must hold at least one row"),
    ],
)  # fmt: skip
def test_bad_files_are_named_with_line_and_target(scene, tmp_path, text, message):
    with pytest.raises(ws.InputError, match=message) as caught:
        _ = ws.Scene.load(with_file(scene, tmp_path, text)).scenario
    assert "targets[1].temperature: " in str(caught.value)
    assert "\n" not in str(caught.value)


def test_gaps_of_files_and_missing_files(scene, tmp_path):
    with pytest.raises(ws.InputError, match=r"t.csv: line 5: time_s: must be at most max_gap_s \(850 s\)"):
        _ = ws.Scene.load(with_file(scene, tmp_path, CSV, max_gap_s=850.0)).scenario
    path = with_file(scene, tmp_path, CSV)
    (tmp_path / "t.csv").unlink()
    with pytest.raises(ws.InputError, match=r"t\.csv: cannot be read"):
        _ = ws.Scene.load(path).scenario


# Scenes


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"kind": "liner"}, r"\.kind: must be one of 'linear', 'table', 'heat_balance', got 'liner'"),
        ({"start_k": -3.0}, r"\.start_k: must be > 0, got -3"),
        ({"start_k": 300.0, "end": 200.0}, r"\.end: is not a known field"),
        (
            {"kind": "table", "time_s": [0, 9], "temperature_k": [300, 310]},
            r"\.time_s: must cover the scene, 0 to 1614 s",
        ),
        (
            {"kind": "table", "time_s": [0, 0], "temperature_k": [300, 310]},
            r": row 1: time_s: must ascend, got 0 after 0",
        ),
    ],
)
def test_scenes_say_where_a_temperature_is_wrong(scene, fields, message):
    with refused_in_one_line(r"targets\[1\]\.temperature" + message):
        scene.replace(targets__1__temperature=fields)


def test_temperature_of_a_target_by_name(scene):
    kelvin = scene.scenario.temperature_k("center", [0.0, 807.0, 1614.0])
    np.testing.assert_allclose(kelvin, [350.0, 339.0, 328.0], rtol=1e-15)
    assert scene.scenario.temperature_k("cone02", 0.0).shape == (1,)
    with pytest.raises(ws.InputError, match="name: must be a target"):
        scene.scenario.temperature_k("sat11", 0.0)
    with pytest.raises(ws.InputError, match="center: time_s: must be within the scene, 0 to 1614 s, got 1700"):
        scene.scenario.temperature_k("center", 1700.0)


@pytest.mark.parametrize("ending", ["toml", "json"])
def test_scenes_with_all_models_load_back_equal(scene, tmp_path, ending):
    mixed = scene.replace(
        targets__0__temperature=ws.HeatBalance("equilibrium", 12.0, 900.0, earth_w_m2=240.0),
        targets__1__temperature=ws.TemperatureTable([0.0, 2000.0], [300.0, 310.0], max_gap_s=3000.0),
        targets__2__temperature=ws.HeatBalance(280.0, 12.0, 900.0),
    )
    mixed.save(tmp_path / f"m.{ending}")
    assert ws.Scene.load(tmp_path / f"m.{ending}") == mixed
    plain = scene.to_dict()
    for target in plain["groups"][0]["targets"]:
        assert target["temperature"].pop("kind") == "linear"  # scenes need not say it
    assert ws.Scene.from_dict(plain) == scene


def test_truth_is_the_temperature_at_emission(scene, device):
    """Linear, table and heat balance side by side."""
    rows = some_rows(40, scene.duration_s)
    mixed = scene.replace(
        sky__catalog="none",
        targets__1__temperature={"kind": "table", "time_s": rows.time_s.tolist(),
                                 "temperature_k": rows.temperature_k.tolist()},
        targets__2__temperature=ws.HeatBalance(290.0, 2.0, 900.0),
    )  # fmt: skip
    truth = ws.Renderer(mixed, device=device).render(range(60, 80), ["sat11"], ["A"]).truth
    for name in ("center", "sphere03", "cylinder01", "cylinder07", "cone01"):
        ours = truth[truth["target"] == name]
        expected = mixed.scenario.temperature_k(name, emission_s(ours))
        np.testing.assert_allclose(ours["temperature_k"], expected, rtol=0, atol=TRUTH_ATOL_K)


def test_rows_of_one_time_are_told_apart_from_a_span():
    rows = TemperatureRows(np.array([0.0, 10.0]), np.array([300.0, 310.0]))
    assert (rows.span_s, rows.error_k, rows.ripple_k) == ((0.0, 10.0), 0.0, 0.0)
