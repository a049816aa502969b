"""Cost of light curves as functions of parameters, and of their Jacobians.

    python -m benchmarks.gradients --json benchmarks/results/programs/gradients.json

The main target of the preset in sunlight, 1,000 times, one sensor, band A, eight parameters: one set of them on one
thread, and 10,000 sets on all cores; medians of 5. Processor time is that of all threads together.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np

import warpsim as ws
from benchmarks.programs import parser_of, write_or_print

PARAMETERS = (
    "precession_rev_s", "precession_phase_rev", "precession_angle_deg", "axis_ra_deg", "axis_dec_deg", "scale",
    "temperature_start_k", "emissivity.A",
)  # fmt: skip
TERMS = {
    "emission": {"sun": False, "earth": False, "albedo": False},
    "emission, Sun": {"sun": True, "earth": False, "albedo": False},
    "all terms": {"sun": True, "earth": True, "albedo": True},
}
IN_SUNLIGHT = {"epoch_utc": "2025-03-20T06:00:00", "sky__catalog": "none", "duration_s": 1600.0, "frames__count": 100}
N_ROUND = 5


def seconds(call: Callable[[], Any], n_call: int) -> dict[str, float]:
    """Median elapsed and processor time of a call."""
    call()
    elapsed, processor = [], []
    for _ in range(N_ROUND):
        start, start_cpu = time.perf_counter(), time.process_time()
        for _ in range(n_call):
            call()
        elapsed.append((time.perf_counter() - start) / n_call)
        processor.append((time.process_time() - start_cpu) / n_call)
    return {"s": median(elapsed), "processor_s": median(processor)}


def measured(scene: ws.Scene, device: str) -> dict[str, Any]:
    """Times of one set and of 10,000, and ratios of Jacobian and forward call by processor time."""
    time_s = np.linspace(600.0, 610.0, 1000)

    def curve(n_thread: int | None) -> ws.LightCurve:
        return ws.LightCurve(scene, "center", PARAMETERS, time_s, "sat47", "A", device, n_thread)

    one, many = curve(1), curve(None)
    sets = np.repeat(one.values[None], 10_000, axis=0)
    sets[:, 1] = np.linspace(0.0, 1.0, len(sets))
    parts = np.split(sets, 10)  # of a Jacobian that all at once would take 640 MB
    found: dict[str, Any] = {
        "one set": seconds(lambda: one(one.values), 100),
        "one set, Jacobian": seconds(lambda: one.jacobian(one.values), 100),
        "10,000 sets": seconds(lambda: many(sets), 1),
        "10,000 sets, Jacobian": seconds(lambda: [many.jacobian(part) for part in parts], 1),
    }
    for name in ("one set", "10,000 sets"):
        ratio = found[f"{name}, Jacobian"]["processor_s"] / found[name]["processor_s"]
        found[f"{name}, Jacobian"]["over forward"] = ratio
    return found


def main() -> None:
    """Measure, and print the result or write it."""
    parser = parser_of(__doc__)
    parser.add_argument("--device", default="cpu")
    options = parser.parse_args()
    scene = ws.Scene.load("stss").replace(**IN_SUNLIGHT)
    found: dict[str, Any] = {}
    for name, terms in TERMS.items():
        lighting = ws.Lighting(**terms, leave_out_nei=0.0)
        found[name] = measured(scene.replace(lighting=lighting), options.device)
    write_or_print("python -m benchmarks.gradients", found, options.json)


if __name__ == "__main__":
    main()
