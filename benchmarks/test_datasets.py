"""Data sets: images a second with files, tables and annotations, size, and peak memory of a process.

    python -m pytest benchmarks/test_datasets.py --benchmark-json=benchmarks/results/datasets.json

Ten thousand images of 128 x 128 pixels: 100 sequences of `stss` with 100 frames each, drawn NEI, aperture and number of
spheres, masks included; written by two processes of this machine, or by two Dask workers. Peak memory is that of the
process that took most. The time holds all: starting processes, loading kernels, drawing scenes, writing, checksums.
"""

from __future__ import annotations

import resource
import shutil
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


def recipe(format: str, full: bool) -> ws.Recipe:
    size = {"n_sequence": N_SEQUENCE, "n_frame": N_FRAME} if full else {"n_sequence": 2, "n_frame": 2}
    return ws.Recipe(scene="stss", bands="A", interval_s=0.1, sample=SAMPLE, masks=True, format=format, **size)


def measure(benchmark: Any, tmp_path: Any, format: str, executor: Any = None) -> None:
    given = recipe(format, benchmark.enabled)
    n_worker = 2 if benchmark.enabled else 1

    def write() -> ws.DatasetReport:
        return ws.write_dataset(given, tmp_path / "data", executor, n_worker, device="cpu")

    report = benchmark.pedantic(write, rounds=1)
    shutil.rmtree(tmp_path / "data")
    benchmark.extra_info |= {
        "format": format,
        "workers": "2 of Dask" if executor else "2 processes",
        "n_image": report.n_image,
        "images_per_s": report.n_image / report.total_s,
        "size_mb": report.n_byte / MB,
        "bytes_per_pixel": report.n_byte / (report.n_image * 128 * 128),
        "peak_memory_mb": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024 / MB,
        "own_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / MB,
    }


@pytest.mark.parametrize("format", FORMATS)
def test_processes(benchmark, tmp_path, format):
    measure(benchmark, tmp_path, format)


@pytest.mark.parametrize("format", ["fits", "zarr"])
def test_dask(benchmark, tmp_path, format):
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        measure(benchmark, tmp_path, format, client.get_executor())
