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

import warpsim as ws
from benchmarks.gpu import __main__ as program
from benchmarks.gpu import agree, races
from benchmarks.gpu.agree import agreement
from benchmarks.gpu.plan import Plan, line_of, rows_of
from benchmarks.gpu.races import RACES

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
STEPS = ["versions", "smoke", "agreement", "races", "speed", "stages", "first_frame", "peers"]


@pytest.mark.ci
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
    assert stopped.value.code == 2 and "must be one of" in capsys.readouterr().err


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
