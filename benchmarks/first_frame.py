"""The first frame of a process of its own, with its clock inside."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

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


def first_frame(kernel_folder: Path, python_folder: Path, device: str) -> dict[str, float]:
    """Seconds of the steps up to the first frame, in a process that finds these folders."""
    folders = [str(ROOT / name) for name in (".", "kernels", "catalogs")]
    others = filter(None, [os.environ.get("PYTHONPATH")])  # as packages may be in folders of their own
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([*folders, *others]),
        "PYTHONPYCACHEPREFIX": str(python_folder),
        "WARP_CACHE_PATH": str(kernel_folder),
        "DEVICE": device,
        "N_THREAD": str(len(os.sched_getaffinity(0))),
    }
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    done = subprocess.run([sys.executable, "-c", CHILD], env=environment, capture_output=True, text=True, check=True)
    steps: dict[str, float] = json.loads(done.stdout.strip().splitlines()[-1])
    return steps
