"""Check and measure a host with a GPU, in one go of less than 20 minutes.

    python -m benchmarks.gpu --out results_gpu
    python -m benchmarks.gpu --out results_gpu --quick --device cpu

In this order: versions and device; a few frames; the CPU against the device, scene by scene, and their derivatives;
threads, streams and passes beside each other; speed with counts left on the device; time of stages; the first frame of
a process; peers that are installed. Each step is a process of its own, as an error of CUDA is the end of a process:
what fails is printed and recorded, and the next step goes on. Rows are kept in OUT/STEP.json as they come, how it went
in OUT/summary.json. The exit status is 1 if anything failed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import warp as wp

from benchmarks.gpu.agree import agreement
from benchmarks.gpu.derivatives import derivatives
from benchmarks.gpu.host import first_frames, peers, smoke, versions
from benchmarks.gpu.plan import Plan, Row, line_of
from benchmarks.gpu.races import races
from benchmarks.gpu.resident import speed, stage_times
from warpsim.errors import InputError
from warpsim.render.device import default_device

STEPS: dict[str, tuple[Callable[[Plan], Iterator[Row]], float]] = {
    "versions": (versions, 60),
    "smoke": (smoke, 120),
    "agreement": (agreement, 360),
    "derivatives": (derivatives, 90),
    "races": (races, 240),
    "speed": (speed, 150),
    "stages": (stage_times, 90),
    "first_frame": (first_frames, 180),
    "peers": (peers, 120),
}
"""In order, each with the seconds that it may take."""

MOST_S = 20 * 60.0
"""Of all steps; what is left over is not begun."""


def run_step(name: str, plan: Plan, folder: Path) -> bool:
    """Make a step in this process; its rows are kept as they come. Returns whether all went well."""
    record: dict[str, Any] = {"step": name, "device": plan.device, "quick": plan.quick, "complete": False, "rows": []}
    begin, path = time.perf_counter(), folder / f"{name}.json"
    try:
        for row in STEPS[name][0](plan):
            record["rows"].append(row)
            print(line_of(row), flush=True)
            _write(path, record | {"seconds": time.perf_counter() - begin})
        record["complete"] = True
    except Exception as error:
        record["error"] = f"{type(error).__name__}: {error}"
        traceback.print_exc()
    _write(path, record | {"seconds": time.perf_counter() - begin})
    return bool(record["complete"]) and all(row.get("ok", True) for row in record["rows"])


def _write(path: Path, data: Any) -> None:
    path.write_text(json.dumps(data, indent=1, default=str) + "\n", "utf-8")


def run_apart(name: str, plan: Plan, folder: Path, most_s: float) -> Row:
    """Make a step in a process of its own, and say how it went."""
    print(f"\n== {name}", flush=True)
    begin, path = time.perf_counter(), folder / f"{name}.json"
    path.unlink(missing_ok=True)
    command = [sys.executable, "-m", "benchmarks.gpu", "--out", folder, "--device", plan.device, "--step", name]
    try:
        status = subprocess.run([*command, *(["--quick"] if plan.quick else [])], timeout=most_s).returncode
        why = {0: "", 1: "failed"}.get(status, f"ended with status {status}")
    except subprocess.TimeoutExpired:
        why = f"took more than {most_s:.0f} s"
    rows = json.loads(path.read_text("utf-8"))["rows"] if path.exists() else []
    bad = [row["name"] for row in rows if not row.get("ok", True)]
    seconds = time.perf_counter() - begin
    return {"name": name, "ok": not why, "rows": len(rows), "failed": bad, "why": why, "seconds": round(seconds, 1)}


def run_all(plan: Plan, folder: Path) -> bool:
    """Make all steps; print and write how they went. Returns whether all went well."""
    begin, results = time.perf_counter(), []
    for name, (_, most_s) in STEPS.items():
        left_s = MOST_S - (time.perf_counter() - begin)
        if left_s > 0:
            results.append(run_apart(name, plan, folder, min(most_s, left_s)))
        else:
            results.append({"name": name, "ok": False, "rows": 0, "failed": [], "why": "no time left", "seconds": 0.0})
        _write(folder / "summary.json", {"device": plan.device, "quick": plan.quick, "steps": results})
    print(f"\n{'step':<12} {'rows':>5} {'failed':>7} {'seconds':>8}")
    for row in results:
        reasons = "; ".join(filter(None, [row["why"], *row["failed"]]))
        print(f"{row['name']:<12} {row['rows']:>5} {len(row['failed']):>7} {row['seconds']:>8} {reasons}".rstrip())
    is_fine = all(row["ok"] for row in results)
    print("all went well" if is_fine else "FAILED", f"in {time.perf_counter() - begin:.0f} s; figures in {folder}")
    return is_fine


def main(arguments: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where figures are written")
    parser.add_argument("--device", default="cuda:0", help="a Warp device (default: cuda:0)")
    parser.add_argument("--quick", action="store_true", help="few and small cases: only see that it runs")
    parser.add_argument("--step", choices=STEPS, help="this one only, in this process")
    options = parser.parse_args(arguments)
    wp.config.log_level = wp.LOG_ERROR
    try:
        plan = Plan(str(default_device(options.device)), options.quick)
    except InputError as error:
        parser.error(str(error))
    options.out.mkdir(parents=True, exist_ok=True)
    is_fine = run_step(options.step, plan, options.out) if options.step else run_all(plan, options.out)
    return 0 if is_fine else 1


if __name__ == "__main__":
    sys.exit(main())
