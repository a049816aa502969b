"""How long the first frame of a process takes: with an empty cache of compiled kernels, and with a full one.

    python -m pytest benchmarks/test_first_frame.py --benchmark-json=benchmarks/results/first_frame.json

Each round is a process of its own. Its clock starts behind `import warpsim`, which takes some milliseconds, so NumPy,
pydantic and Warp are imported within; Python's own compiled files are there. CPU seconds are those of all its threads:
on a busy machine they tell more than the wall clock.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

CHILD = """
import json, os, resource, time
import warpsim as ws

steps, before = {}, time.perf_counter()
used = resource.getrusage(resource.RUSAGE_SELF)

def lap(step):
    global before
    now = time.perf_counter()
    steps[step], before = now - before, now

scene = ws.Scene.load("stss"); lap("load_s")
renderer = ws.Renderer(scene, os.environ["DEVICE"], n_thread=int(os.environ["N_THREAD"])); lap("renderer_s")
renderer.render([60]).counts.numpy(); lap("render_s")
steps["wall_s"] = sum(steps.values())
now = resource.getrusage(resource.RUSAGE_SELF)
steps["cpu_s"] = now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime
print(json.dumps(steps))
"""


@pytest.mark.parametrize("kernels", ["cold", "warm"])
def test_first_frame(benchmark, tmp_path, kernels, device):
    if not benchmark.enabled and kernels == "cold":
        pytest.skip("the other case compiles them, too")
    rounds = (5 if kernels == "cold" else 15) if benchmark.enabled else 1
    folder = tmp_path / "python"
    found: list[dict[str, float]] = []
    if benchmark.enabled or kernels == "warm":
        first_frame(tmp_path / "warm", folder, device)

    def one(number: int) -> None:
        found.append(first_frame(tmp_path / ("warm" if kernels == "warm" else f"cold{number}"), folder, device))

    numbers = iter(range(rounds))
    benchmark.pedantic(one, setup=lambda: ((next(numbers),), {}), rounds=rounds)
    steps = {step: statistics.median(each[step] for each in found) for step in found[0]}
    benchmark.extra_info.update(device=device, kernels=kernels, n_cpu=len(os.sched_getaffinity(0)), **steps)


def first_frame(kernel_folder: Path, python_folder: Path, device: str) -> dict[str, float]:
    """Seconds of the steps up to the first frame, in a process that finds these folders."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(str(ROOT / name) for name in (".", "kernels", "catalogs")),
        "PYTHONPYCACHEPREFIX": str(python_folder),
        "WARP_CACHE_PATH": str(kernel_folder),
        "DEVICE": device,
        "N_THREAD": str(len(os.sched_getaffinity(0))),
    }
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    done = subprocess.run([sys.executable, "-c", CHILD], env=environment, capture_output=True, text=True, check=True)
    steps: dict[str, float] = json.loads(done.stdout.strip().splitlines()[-1])
    return steps
