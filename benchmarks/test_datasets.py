"""Data sets: images a second with files, tables and annotations, size, and peak memory of a process.

    python -m pytest benchmarks/test_datasets.py --benchmark-json=benchmarks/results/datasets.json
    python benchmarks/report.py benchmarks/results/datasets.json

Ten thousand images of 128 x 128 pixels: 100 sequences of `stss` with 100 frames each, drawn NEI, aperture and number of
spheres, masks included; written by two processes of this machine, by two Dask workers, or by two processes that are
killed at a random moment, and again. Each is a program of its own, and peak memory that of its largest process. The
time holds all: starting processes, loading kernels, drawing scenes, writing, checksums; not `import warpsim`.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import warpsim as ws
from warpsim.dataset.recipe import FORMATS

N_SEQUENCE, N_FRAME = 100, 100
SAMPLE = {
    "detector.nei_w_cm2": {"log_uniform": [1e-18, 3e-18]},
    "optics.aperture_m": {"uniform": [0.3, 0.5]},
    "targets.1.count": {"integer": [1, 20]},
}
MB = 1e6


def recipe(format: str, full: bool) -> dict[str, Any]:
    size = {"n_sequence": N_SEQUENCE, "n_frame": N_FRAME} if full else {"n_sequence": 2, "n_frame": 2}
    given = {"scene": "stss", "bands": ["A"], "interval_s": 0.1, "sample": SAMPLE, "masks": True, "format": format}
    return given | size


def write(given: dict[str, Any], folder: str, n_worker: int, dask: bool, device: str) -> None:
    """The program that is measured: what it did, as JSON on its standard output."""
    if dask:
        import distributed

        with (
            distributed.LocalCluster(n_workers=n_worker, threads_per_worker=1, dashboard_address=None) as cluster,
            distributed.Client(cluster) as client,
        ):
            report = ws.write_dataset(ws.Recipe(**given), folder, client.get_executor(), device=device)
    else:
        report = ws.write_dataset(ws.Recipe(**given), folder, n_worker=n_worker, device=device)
    print(json.dumps({"n_image": report.n_image, "n_byte": report.n_byte, "total_s": report.total_s}))


def start(given: dict[str, Any], folder: Path, n_worker: int, device: str, dask: bool = False) -> subprocess.Popen[str]:
    arguments = [json.dumps(given), str(folder), str(n_worker), str(int(dask)), device]
    command = [sys.executable, __file__, *arguments]
    path = os.pathsep.join(filter(None, sys.path))
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": path})


def run(given: dict[str, Any], folder: Path, n_worker: int, device: str, dask: bool = False) -> dict[str, Any]:
    """What a program did, and the peak memory of its processes."""
    process = start(given, folder, n_worker, device, dask)
    assert process.stdout is not None
    words = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    assert status == 0
    return json.loads(words.splitlines()[-1]) | {"peak_memory_mb": usage.ru_maxrss * 1024 / MB}


def record(benchmark: Any, format: str, workers: str, device: str, done: dict[str, Any]) -> None:
    n_image = done["n_image"]
    benchmark.extra_info |= {
        "format": format,
        "workers": workers,
        "device": device,
        "images": n_image,
        "s": done["total_s"],
        "images per s": n_image / done["total_s"],
        "MB": done["n_byte"] / MB,
        "bytes per pixel": done["n_byte"] / (n_image * 128 * 128),
        "peak MB of a process": done["peak_memory_mb"],
    }


@pytest.mark.parametrize("format", FORMATS)
def test_processes(benchmark, tmp_path, format, device):
    if not benchmark.enabled and format != "fits":
        pytest.skip("is measured, or not run")
    given = recipe(format, benchmark.enabled)
    done = benchmark.pedantic(lambda: run(given, tmp_path / "data", 2 if benchmark.enabled else 1, device), rounds=1)
    shutil.rmtree(tmp_path / "data")
    record(benchmark, format, "2 processes", device, done)


@pytest.mark.parametrize("format", ["fits", "zarr"])
def test_dask(benchmark, tmp_path, format, device):
    pytest.importorskip("distributed")
    if not benchmark.enabled and format != "zarr":
        pytest.skip("is measured, or not run")
    given = recipe(format, benchmark.enabled)
    done = benchmark.pedantic(lambda: run(given, tmp_path / "data", 2, device, dask=True), rounds=1)
    shutil.rmtree(tmp_path / "data")
    record(benchmark, format, "2 of Dask", device, done)


def test_killed_and_resumed(benchmark, tmp_path, device):
    """Killed at a random moment; the rest is written by a second run, and the bytes are those of an undisturbed one."""
    if not benchmark.enabled:
        pytest.skip("is measured, or not run")
    given = recipe("fits", True)
    whole = run(given, tmp_path / "whole", 2, device)
    moment_s = random.uniform(0.2, 0.8) * whole["total_s"]

    def disturbed() -> dict[str, Any]:
        begin = time.perf_counter()
        process = start(given, tmp_path / "data", 2, device)
        time.sleep(moment_s)
        process.send_signal(signal.SIGKILL)
        process.wait()
        before_s = time.perf_counter() - begin
        again = run(given, tmp_path / "data", 2, device)
        return again | {"total_s": before_s + again["total_s"]}

    done = benchmark.pedantic(disturbed, rounds=1)
    manifests = [json.loads((tmp_path / name / "manifest.json").read_text()) for name in ("whole", "data")]
    assert manifests[0] == manifests[1]  # with the checksums of all files
    assert subprocess.run(["diff", "-r", tmp_path / "whole", tmp_path / "data"]).returncode == 0
    for name in ("whole", "data"):
        shutil.rmtree(tmp_path / name)
    record(benchmark, "fits", f"2 processes, killed after {moment_s:.1f} s and run again", device, done)


if __name__ == "__main__":
    write(json.loads(sys.argv[1]), sys.argv[2], int(sys.argv[3]), sys.argv[4] == "1", sys.argv[5])
