"""Time of the first frame of a process: with an empty cache of compiled kernels, and with a full one.

    python -m pytest benchmarks/test_first_frame.py --benchmark-json=benchmarks/results/first_frame.json

Each round is a process of its own. Its clock starts behind `import warpsim`, which takes some milliseconds, so NumPy,
pydantic and Warp are imported within; Python's own compiled files are there. CPU seconds are those of all its threads:
on a busy machine they tell more than the wall clock.
"""

from __future__ import annotations

import itertools
import os
import statistics

import pytest

from benchmarks.first_frame import first_frame


@pytest.mark.parametrize("kernels", ["cold", "warm"])
def test_first_frame(benchmark, tmp_path, kernels, device):
    if not benchmark.enabled and kernels == "cold":
        pytest.skip("the other case compiles them, too")
    folder = tmp_path / "python"
    found: list[dict[str, float]] = []
    if benchmark.enabled or kernels == "warm":
        first_frame(tmp_path / "warm", folder, device)

    def one(number: int) -> None:
        found.append(first_frame(tmp_path / ("warm" if kernels == "warm" else f"cold{number}"), folder, device))

    numbers = itertools.count()
    benchmark.pedantic(one, setup=lambda: ((next(numbers),), {}), rounds=5 if kernels == "cold" else 15)
    steps = {step: statistics.median(each[step] for each in found) for step in found[0]}
    benchmark.extra_info.update(device=device, kernels=kernels, n_cpu=len(os.sched_getaffinity(0)), **steps)
