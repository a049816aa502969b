"""Threads, streams and passes beside each other, and the CPU against the GPU: the checks of benchmarks/gpu, in short.

`python -m pytest -m gpu` runs those that need a GPU. On the CPU the same checks run where they make sense there.
"""

import json
import subprocess
import sys

import numpy as np
import pytest
import warp as wp
from conftest import ROOT
from warpsim_kernels.deposit_read_out import make_deposit_read_out_kernel
from warpsim_kernels.detector import ReadOutFeatures
from warpsim_kernels.spots import gaussian_spots

import warpsim as ws
from benchmarks.gpu import __main__ as program
from benchmarks.gpu import agree, races
from benchmarks.gpu.agree import agreement
from benchmarks.gpu.plan import Plan, line_of, rows_of
from benchmarks.gpu.races import RACES
from warpsim.render import device_stars, pipeline, stages
from warpsim.speed.work import speed_work

N_FRAME = 12
GPU = [pytest.mark.gpu, pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")]
DEVICES = ["cpu", pytest.param("cuda:0", marks=GPU)]


@pytest.mark.parametrize("where", DEVICES)
@pytest.mark.parametrize("name", RACES)
@pytest.mark.ci
def test_bits_do_not_depend_on_what_runs_beside(name, where):
    row = RACES[name](where, N_FRAME)
    if "skipped" in row:
        pytest.skip(row["skipped"])


@pytest.mark.parametrize("where", DEVICES)
@pytest.mark.ci
def test_device_agrees_with_the_cpu(where):
    """On the CPU with itself, few scenes: that all of it runs."""
    rows = list(agreement(Plan(where, quick=where == "cpu")))
    assert rows and not [line_of(row) for row in rows if not row["ok"]]


CPU = Plan("cpu", quick=True)
STEPS = ["versions", "smoke", "agreement", "derivatives", "races", "speed", "stages", "first_frame", "peers"]


@pytest.mark.slow
def test_program_on_the_cpu(tmp_path, checkout_environment):
    command = [sys.executable, "-m", "benchmarks.gpu", "--out", tmp_path, "--quick", "--device", "cpu"]
    done = subprocess.run(command, cwd=ROOT, env=checkout_environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert [step["name"] for step in summary["steps"]] == STEPS
    for step in summary["steps"]:
        record = json.loads((tmp_path / f"{step['name']}.json").read_text())
        assert record["complete"] and len(record["rows"]) == step["rows"] > 0 and step["failed"] == []
    speeds = json.loads((tmp_path / "speed.json").read_text())["rows"]
    assert all(row["fps"] > 0 and row["buffer_mb"] > 0 for row in speeds)
    assert "all went well" in done.stdout


def failing(plan):
    yield {"name": "first", "ok": True}
    raise RuntimeError("out of luck")


def test_rows_before_an_error_are_kept(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(program.STEPS, "smoke", (failing, 1.0))
    assert program.main(["--out", str(tmp_path), "--device", "cpu", "--step", "smoke"]) == 1
    record = json.loads((tmp_path / "smoke.json").read_text())
    assert not record["complete"] and record["rows"] == [{"name": "first", "ok": True}]
    assert record["error"] == "RuntimeError: out of luck"
    assert "ok   first: done" in capsys.readouterr().out


def test_steps_that_fail_or_hang_do_not_keep_others_from_being_made(tmp_path, monkeypatch, capsys):
    def run(command, timeout):
        name = command[command.index("--step") + 1]
        if name == "smoke":
            raise subprocess.TimeoutExpired(command, timeout)
        record = {"rows": [{"name": "case", "ok": name != "races"}]}
        (tmp_path / f"{name}.json").write_text(json.dumps(record))
        return subprocess.CompletedProcess(command, {"races": 1, "speed": -11}.get(name, 0))

    monkeypatch.setattr(program.subprocess, "run", run)
    (tmp_path / "smoke.json").write_text("of an earlier run")
    assert not program.run_all(CPU, tmp_path)
    steps = {step["name"]: step for step in json.loads((tmp_path / "summary.json").read_text())["steps"]}
    assert list(steps) == STEPS
    assert {name for name, step in steps.items() if not step["ok"]} == {"smoke", "races", "speed"}
    assert steps["smoke"]["why"] == "took more than 120 s" and steps["smoke"]["rows"] == 0
    assert steps["speed"]["why"] == "ended with status -11" and steps["races"]["failed"] == ["case"]
    assert "FAILED" in capsys.readouterr().out


def test_all_steps_take_less_than_the_time_there_is():
    assert sum(most_s for _, most_s in program.STEPS.values()) <= 1.25 * program.MOST_S  # not all take their most
    assert program.MOST_S <= 20 * 60


def test_a_check_that_fails_is_a_row():
    def fails():
        raise races.DifferentError("pixel 7")

    rows = list(rows_of([("bad", fails), ("good", lambda: {"n": 2, "us": {"aim": 1.25}})]))
    assert [row["ok"] for row in rows] == [False, True]
    assert line_of(rows[0]) == "FAIL bad: error DifferentError: pixel 7"
    assert line_of(rows[1]) == "ok   good: n 2, us {aim 1.25}"


def test_unknown_device_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit) as stopped:
        program.main(["--out", str(tmp_path), "--device", "cuda:99"])
    assert stopped.value.code == 2 and "device: must be" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"detector__counts_per_nei": 2.0}, "counts_differ"),
        ({"detector__counts_per_nei": 2.0}, "counts without signal"),
        ({"optics__psf": "gaussian"}, "over_limit"),
        ({"sky__catalog": "none"}, "same_stars"),
        ({"pointing": [{"track": "group", "bias": {"urad": [1.0, 0.0]}}]}, "truth_differs"),
    ],
)
@pytest.mark.ci
def test_disagreement_is_seen(scene, monkeypatch, changes, what):
    """Another scene instead of the device's: each limit is passed by something."""
    other = scene.replace(**changes)
    # On the CPU, on the device, and there without signal that is kept: all of the device's, or the last alone.
    scenes, make = [scene, scene if what == "counts without signal" else other, other], ws.Renderer

    def renderer(_, device, catalog):
        return make(scenes.pop(0), "cpu", catalog=catalog)

    monkeypatch.setattr(agree.ws, "Renderer", renderer)
    row = agree.compared(agree.Case(scene, [60], ["sat11"]), "cpu")
    limits = {"counts_differ": agree.DIFFERING, "over_limit": 1.0, "truth_differs": agree.OF_TRUTH}
    assert not row["ok"]
    if what == "same_stars":
        assert not row["same_stars"]
    else:
        name = "counts_differ" if what == "counts without signal" else what
        assert row[name] > limits[name]


def test_different_bits_are_seen():
    with pytest.raises(races.DifferentError, match=r"image: 0\.25 of the numbers differ"):
        races.expect("image", np.array([1, 2, 3, 4]), np.array([1, 2, 3, 5]))
    races.expect("truth", np.array([1.0, np.nan]), np.array([1.0, np.nan]))


GAUSSIAN = {"optics__psf": "gaussian", "optics__sigma_px": 0.7}
NEI_TERMS = {
    "detector__prnu": 0.02, "detector__dsnu_nei": 1.0, "detector__column_noise_nei": 0.5,
    "detector__dead_fraction": 0.01, "detector__hot_fraction": 0.01, "detector__nonlinearity": 0.05,
}  # fmt: skip
ELECTRONS = ws.ElectronDetector(
    exposure_s=0.1, full_well_e=2e4, gain_e_per_count=1.0, bits=16, transmission=0.6, quantum_efficiency=0.5,
    dark_e_s=40.0, read_noise_e=2.0, prnu=0.01, dsnu=0.3, column_noise_e=3.0, dead_fraction=0.01, hot_fraction=0.01,
    nonlinearity=0.1, streaks=False,
)  # fmt: skip


def shape(n_row, n_col):
    return {"camera__n_row": n_row, "camera__n_col": n_col}


CASES = {
    "Airy": {},
    "Gaussian": GAUSSIAN,
    "NEI, all terms": NEI_TERMS,
    "electrons, all terms": {"detector": ELECTRONS},
    "runs that begin within a row": shape(96, 120),
    "less than a block of strips": {**GAUSSIAN, **shape(16, 24)},
    "pixels higher than wide": {**GAUSSIAN, "camera__pixel_aspect": 1.3},
    "nothing in the sky": {
        "groups": [],
        "sky__catalog": "none",
        "pointing": {"kind": "fixed", "ra_dec_deg": [10.0, 20.0]},
    },
    "wide stamps, beyond the table": {"optics__stamp_cut_nei": 1e-5, **shape(64, 256)},
}
"""By name, what is changed of `stss`."""


@pytest.fixture
def blocks(monkeypatch):
    """Lets the CPU launch blocks of several threads."""
    monkeypatch.setattr(wp.config, "enable_cpu_blocks", True)


@pytest.fixture
def at_once(blocks, monkeypatch):
    """Makes the CPU render as CUDA would."""

    def is_read_out_at_once(scene):
        camera = scene.instrument.sensor.camera
        return not scene.streaks.enabled and camera.n_row * camera.n_col % stages.STRIP_PIXELS == 0

    monkeypatch.setattr(pipeline, "is_read_out_at_once", is_read_out_at_once)


def counts_of(scene, **arguments):
    renderer = ws.Renderer(scene, device="cpu", n_thread=1)
    frames = renderer.render(
        [0, 7, 150], sensors=(renderer.sensors_with_access or scene.scenario.instrument.names)[:2], **arguments
    )
    (pipelines,) = renderer._pipelines.values()
    return frames.counts.numpy(), pipelines._pipelines[0]


@pytest.mark.parametrize("name", CASES)
@pytest.mark.ci
def test_counts_are_those_of_deposit_and_read_out(name, at_once, monkeypatch):
    scene = ws.Scene.load("stss").replace(**CASES[name])
    counts, made = counts_of(scene)
    assert made._at_once is not None and made._images is None
    with monkeypatch.context() as patch:
        patch.setattr(pipeline, "is_read_out_at_once", lambda scene: False)
        expected, other = counts_of(scene)
    assert other._at_once is None
    np.testing.assert_array_equal(counts, expected)
    assert np.ptp(expected) > (100 if scene.scenario.targets else 20)


@pytest.mark.parametrize("psf", ["airy", "gaussian"])
@pytest.mark.ci
def test_more_sources_than_threads(psf, at_once):
    """They are looked at some at a time, in order; sums of overlapping stars are those of the signal that is kept."""
    work = speed_work(96, 700, 1, psf)
    renderer = ws.Renderer(work.scene, device="cpu", n_thread=1, catalog=work.catalog)
    counts = renderer.render(range(2), work.sensors, keep_stars=True)
    kept = renderer.render(range(2), work.sensors, keep_signal=True)
    assert len(counts.stars) > 2 * stages.RUN_THREADS
    assert counts.signal_w_cm2 is None and kept.signal_w_cm2 is not None
    np.testing.assert_array_equal(counts.counts.numpy(), kept.counts.numpy())


@pytest.mark.ci
def test_frames_are_the_same_alone_and_in_any_batch(at_once):
    renderer = ws.Renderer(ws.Scene.load("stss"), device="cpu", n_thread=1)
    sensors = renderer.sensors_with_access[:2]
    batch = renderer.render([4, 9, 2], sensors).counts.numpy()
    np.testing.assert_array_equal(renderer.render([9], sensors[1]).counts.numpy()[0, 0], batch[1, 1])


@pytest.mark.ci
def test_images_that_strips_do_not_fill_take_both_stages(at_once):
    _, made = counts_of(ws.Scene.load("stss").replace(**shape(33, 57)))
    assert made._at_once is None


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"sky__parallax": True, "sky__light_deflection": True},
        {"camera__distortion": {"k1": 0.01}, "detector__exposure_s": 0.01},
    ],
    ids=["stss", "all shifts", "a lens, streaks"],
)
def test_stars_gathered_by_32_threads(changes, blocks, monkeypatch):
    """The same stars, in the same order and with the same bits: more than a round of threads can take."""
    work = speed_work(128, 300, 1, "gaussian")
    scene = work.scene.replace(**changes)

    def gathered(n_thread):
        for module in (stages, device_stars):
            monkeypatch.setattr(module, "star_threads", lambda device: n_thread)
        renderer = ws.Renderer(scene, device="cpu", n_thread=1, catalog=work.catalog)
        return renderer.render([0, 80, 161], sensors=scene.scenario.instrument.names[:4], keep_stars=True).stars

    one, many = gathered(1), gathered(32)
    assert one.colnames == many.colnames and len(one) > 500
    for name in one.colnames:
        np.testing.assert_array_equal(many[name], one[name], err_msg=name)


@pytest.mark.parametrize("n_thread", [1, 32, 192, 2048])
def test_threads_that_do_not_own_pixels_evenly_are_refused(n_thread):
    with pytest.raises(ValueError, match=f"n_thread: must be one of .*, got {n_thread}"):
        make_deposit_read_out_kernel(gaussian_spots(), ReadOutFeatures(), n_thread)
