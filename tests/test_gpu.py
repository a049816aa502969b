"""Threads, streams and passes beside each other, and the CPU against the GPU: the checks of benchmarks/gpu, in short.

`python -m pytest -m gpu` runs those that need a GPU. On the CPU the same checks run where they make sense there.
"""

import pytest
import warp as wp

from benchmarks.gpu.agree import agreement
from benchmarks.gpu.plan import Plan, line_of
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
