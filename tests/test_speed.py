"""The work that speed is measured on is what it says, and `warpsim bench` reports it; nothing here is about speed."""

import json
import re

import numpy as np
import pytest
import warp as wp
from command_line import printed, refused, run

import warpsim as ws
from warpsim.render.image_stack import ImageStack
from warpsim.speed.report import PAPER_FPS, Speed, row
from warpsim.speed.work import (
    BAND,
    FLUX_RANGE_NEI,
    N_CALL,
    power_law_nei,
    render_call,
    speed_catalog,
    speed_work,
    stage_times_us,
    synchronised_s,
    timed_stages,
    work_fps,
)

STAGES = ["aim", "observe_targets", "gather_stars", "deposit", "read_out"]
TINY = ("--device", "cpu", "--pixels", "16,24", "--quick")

# Counts of stars in single views scatter like their square root; the bounds leave 5 standard deviations.
N_SIGMA = 5.0


@pytest.fixture(scope="module")
def work():
    return speed_work(32, n_star=60, n_sensor=5, n_frame=40)


@pytest.fixture(scope="module")
def rendered(work):
    """Frames from the first to the last of all calls."""
    renderer = ws.Renderer(work.scene, "cpu", catalog=work.catalog)
    frames = [0, N_CALL * work.n_frame // 2, N_CALL * work.n_frame - 1]
    return renderer.render(frames, work.sensors, [BAND], keep_stars=True)


@pytest.mark.ci
def test_every_sensor_has_its_stars_and_targets(work, rendered):
    stars, truth = rendered.stars, rendered.truth
    for sensor in work.sensors:
        for frame in rendered.frames:
            here = (stars["sensor"] == sensor) & (stars["frame"] == frame) & stars["in_fov"]
            assert abs(here.sum() - work.n_star) < N_SIGMA * np.sqrt(work.n_star)
            targets = truth[(truth["sensor"] == sensor) & (truth["frame"] == frame)]
            assert targets["in_fov"].all() and (targets["snr"] > 1.0).all()


def test_stars_are_as_dense_at_the_edge_as_in_the_middle(rendered):
    stars = rendered.stars[rendered.stars["in_fov"]]
    outer = np.maximum(abs(stars["x_px"] - 15.5), abs(stars["y_px"] - 15.5)) > 16 * np.sqrt(0.5)
    assert abs(outer.sum() - len(stars) / 2) < N_SIGMA * np.sqrt(len(stars)) / 2


def test_stars_of_two_sensors_that_look_alike_are_there_once(work):
    one = speed_catalog(work.scene.scenario, work.sensors[:1], 4, 60)
    assert len(speed_catalog(work.scene.scenario, work.sensors[:1] * 2, 4, 60)) == len(one) > 100


def test_light_of_stars_follows_its_power_law(work):
    light = power_law_nei(200_000)
    low, high = FLUX_RANGE_NEI
    assert low <= light.min() and light.max() <= high
    for edge in (40.0, 200.0, 2000.0):
        expected = (edge**-1.5 - high**-1.5) / (low**-1.5 - high**-1.5) * len(light)
        assert abs((light > edge).sum() - expected) < N_SIGMA * np.sqrt(expected)
    irradiance = work.catalog.irradiance_w_cm2(BAND) / work.scene.scenario.instrument.nei_w_cm2(BAND)
    np.testing.assert_allclose(irradiance, power_law_nei(len(work.catalog)), rtol=1e-12)


def test_calls_come_again(work):
    assert work.frames(0) == range(40) and work.frames(3) == range(120, 160) and work.frames(4) == range(40)
    assert work.n_view == 200 and work.n_pixel == 32


def test_without_stars_there_are_none():
    assert len(speed_work(16, n_star=0, n_frame=1).catalog) == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"psf": "table"}, "psf: must be airy or gaussian, got 'table'"),
        ({"n_star": -1}, "n_star: must be >= 0, got -1"),
        ({"n_sensor": 0}, "n_sensor: must be >= 1, got 0"),
    ],
)
def test_bad_work(changes, message):
    with pytest.raises(ws.InputError, match=re.escape(message)):
        speed_work(16, **{"n_frame": 1, **changes})


def test_every_stage_is_timed_for_every_pass_and_then_no_more(work):
    with timed_stages() as times:
        renderer = ws.Renderer(work.scene, "cpu", 1, work.catalog)
        counts = render_call(work, renderer, 0)
    render_call(work, ws.Renderer(work.scene, "cpu", 1, work.catalog), 0)
    assert counts.shape == (40, 5, 1, 32, 32)
    assert list(times) == STAGES
    views = {name: sum(n_view for n_view, _ in spans) for name, spans in times.items()}
    assert set(views.values()) <= {work.n_view, 2 * work.n_view}  # twice where source lists were too short


def test_trace_is_timed_where_light_moves():
    moving = ws.Scene.load("stss").replace(sky__catalog="none", detector__exposure_s=0.1, detector__streaks=True)
    renderer = ws.Renderer(moving, "cpu", 1)
    renderer.render([0], ["sat11"], [BAND])  # chooses how light is followed, by stages too
    with timed_stages() as times:
        renderer.render(range(3), ["sat11"], [BAND])
    assert list(times) == [*STAGES[:3], "trace", *STAGES[3:]]
    assert [n_view for n_view, _ in times["trace"]] == [3]


def test_measures_are_positive(work):
    assert work_fps(work, ws.Renderer(work.scene, "cpu", 1, work.catalog), 1) > 0
    assert min(stage_times_us(work, "cpu", 1).values()) > 0
    assert ws.measure_fps(16, "cpu", "gaussian", 1, n_star=3, n_sensor=2, n_thread=1) > 0
    assert ws.measure_fps(16, "cpu", n_round=1, n_star=3, n_frame=4, resident=True) > 0


def test_bench_prints_both_tables_and_writes_the_figures(capsys, tmp_path):
    path = tmp_path / "speed.json"
    out = printed(capsys, "bench", *TINY, "--sensors", "1,3", "--stars", "7", "--psf", "gaussian", "--json", path)
    assert "about 7 stars in view, a Gaussian of 0.7 px" in out
    assert re.findall(r"^cpu +(\d+)\^2 +(\d+) +(\d+) +[\d,]+ +- ", out, re.MULTILINE) == [
        ("16", "1", "64"), ("16", "3", "21"), ("24", "1", "64"), ("24", "3", "21"),
    ]  # fmt: skip
    assert re.findall(r"^(\w+) +[\d.,]+ +[\d.,]+$", out, re.MULTILINE) == [*STAGES, "sum", "whole"]
    data = json.loads(path.read_text())
    assert [(case["n_pixel"], case["n_sensor"]) for case in data["cases"]] == [(16, 1), (16, 3), (24, 1), (24, 3)]
    case = data["cases"][0]
    assert case["n_sensor_at_30_hz"] == case["fps"] // 30 and case["paper_fps"] is None
    assert list(case["stage_us"]) == STAGES and data["cases"][1]["stage_us"] is None
    assert data["warpsim"] == ws.__version__ and set(data["device_names"]) == {"cpu"}

    code, out, err = run(capsys, "bench", *TINY, "--json", path)
    assert (code, out, err.count("\n")) == (2, "", 1) and "is there already" in err


def test_bench_leaves_counts_on_the_device_and_takes_frames_of_a_call(capsys, tmp_path, monkeypatch, device):
    copied = []
    numpy = ImageStack.numpy
    monkeypatch.setattr(ImageStack, "numpy", lambda images: copied.append(images.shape) or numpy(images))
    size = ("--pixels", "16", "--sensors", "2", "--stars", "3", "--frames", "5", "--quick", "--device", device)
    out = printed(capsys, "bench", *size, "--resident", "--json", tmp_path / "resident.json")
    assert not copied and "counts left on the device" in out
    data = json.loads((tmp_path / "resident.json").read_text())
    assert data["plan"]["resident"] and [case["n_frame"] for case in data["cases"]] == [5]
    out = printed(capsys, "bench", *size)
    assert set(copied) == {(5, 2, 1, 16, 16)} and "counts in host memory" in out


def test_time_between_idle_moments_holds_what_is_launched(monkeypatch, device):
    events = []
    monkeypatch.setattr(wp, "synchronize_device", lambda where: events.append(str(where)))
    assert synchronised_s(lambda: events.append("call"), wp.get_device(device)) > 0
    assert events == [device, "call", device]


def test_resident_counts_are_those_of_the_host(work, device):
    renderer = ws.Renderer(work.scene, device, 1, work.catalog)
    resident = render_call(work, renderer, 1, resident=True)
    assert str(resident.device) == device
    np.testing.assert_array_equal(resident.numpy(), render_call(work, renderer, 1))


def test_rows_have_the_papers_figures_beside_ours():
    assert {n: int(fps // 30) for n, fps in PAPER_FPS.items()} == {128: 20, 256: 10, 512: 2, 1024: 1}
    text = row(Speed("cpu", 2, 128, 20, 100, "airy", 60_700.0, None, 1024))
    assert text.split() == ["cpu", "128^2", "20", "1,024", "60,700", "607", "100.0", "2,023", "20"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--pixels", "0"], "--pixels: must be whole numbers >= 1, got '0'"),
        (["--pixels", "128,9000000"], "--pixels: 9000000 is not possible: Scene: camera: n_row * n_col: must be"),
        (["--sensors", "1,14285"], "--sensors: 14285 is not possible: Scene: constellation.n_satellite: must be"),
        (["--device", ","], "--device: must name a device, got ','"),
        (["--pixels", "128x128"], "--pixels: must be a whole number, got '128x128'"),
        (["--sensors", "1,"], "--sensors: must be a whole number, got ''"),
        (["--stars", "-1"], "--stars: must be >= 0, got -1"),
        (["--psf", "table"], "--psf: must be airy or gaussian, got 'table'"),
        (["--frames", "0"], "--frames: must be whole numbers >= 1, got '0'"),
        (["--frames", "2,4"], "--frames: must be one number, got '2,4'"),
        (["--frames", "25001"], "--frames: must be <= 25000, got 25001"),
        (["--device", "tpu"], "device: must be one of cpu"),
        (["--json", "speed.txt"], "speed.txt: must end in .json"),
    ],
)
def test_bad_options_of_bench(capsys, arguments, message):
    assert message in refused(capsys, "bench", *arguments)


@pytest.mark.ci
def test_bench_measures_each_kind_of_a_scene(capsys, tmp_path):
    stss = ws.Scene.load("stss")
    wide = {**stss.to_dict()["sensors"][0], "name": "wide", "on": ["sat4?"], "bands": ["A"]}
    both = stss.replace(sensors=[{**stss.to_dict()["sensors"][0], "name": "narrow"}, wide], sky__catalog="none")
    small = both.replace(sensors__0__camera__n_row=16, sensors__0__camera__n_col=24, frames__count=4)
    small.save(tmp_path / "both.toml")
    out = printed(capsys, "bench", tmp_path / "both.toml", "--quick", "--device", "cpu", "--json", tmp_path / "x.json")
    assert re.findall(r"^cpu +(\w+) +(\d+ x \d+) +(\d) ", out, re.MULTILINE) == [
        ("narrow", "16 x 24", "3"), ("wide", "128 x 128", "1"),
    ]  # fmt: skip
    cases = json.loads((tmp_path / "x.json").read_text())["cases"]
    assert [case["kind"] for case in cases] == ["narrow", "wide"] and all(case["images_per_s"] > 0 for case in cases)
    assert [case["n_frame"] for case in cases] == [4, 4] and not cases[0]["resident"]
    out = printed(capsys, "bench", tmp_path / "both.toml", "--quick", "--device", "cpu", "--resident", "--frames", 2)
    assert "counts left on the device" in out
    assert re.findall(r"^cpu +\w+ +\d+ x \d+ +\d +\d+ +(\d) ", out, re.MULTILINE) == ["2", "2"]
    code, _, err = run(capsys, "bench", tmp_path / "both.toml", "--pixels", "16")
    assert (code, err) == (2, "warpsim: --pixels: must not be given with a scene, which has its own\n")
