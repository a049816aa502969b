"""Latency of served frames: from when a frame was due to when another process had all its images.

    python -m benchmarks.serve_latency --json benchmarks/results/programs/serve.json
    chrt -f 10 python -m benchmarks.serve_latency --json benchmarks/results/programs/serve_fifo.json

The second one gives server and subscribers priority over other programs, as their machine would have none.
20 sensors of 128 x 128 pixels at 30 Hz, and one of 1024 x 1024 at 100 Hz, 100 stars in an image, one band; over
ZeroMQ (TCP of this machine) and by a ring of shared memory, each with two subscribers in processes of their own, of
which one is killed (SIGKILL) in the middle. The other one's clock is that of the server.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

import warpsim as ws
from benchmarks.programs import parser_of, processor_name, write_or_print
from warpsim.serving.packet import HEADER
from warpsim.speed.work import BAND, speed_work

CASES = {"20 x 128^2 at 30 Hz": (128, 20, 30.0), "1 x 1024^2 at 100 Hz": (1024, 1, 100.0)}
"""Pixels, sensors, rate [Hz]."""
DURATION_S = 20.0
LEAST_S = 10.0
TIMEOUT_S = 10.0


def subscribe(source: str, n_packet: int) -> None:
    """Receive packets; print how many, and the latency [ms] of each frame's last one."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "examples" / "serve"))
    import subscriber

    packets = subscriber.from_socket(source, "frame/", TIMEOUT_S) if "://" in source else None
    rows = []
    for packet in packets or subscriber.from_ring(source, TIMEOUT_S):
        now_ns = time.time_ns()
        (header,) = np.frombuffer(packet, HEADER, 1)
        rows.append((header["sequence"], header["frame"], now_ns - header["due_unix_ns"]))
        if header["sequence"] == n_packet - 1:
            break
    sequence, frame, latency_ns = np.array(rows, dtype=np.int64).T
    last = np.append(np.flatnonzero(np.diff(frame)), len(frame) - 1)
    found = {"n_packet": len(rows), "n_lost": int(sequence[-1] + 1 - sequence[0] - len(rows))}
    print(json.dumps(found | {"latency_ms": (latency_ns[last] / 1e6).tolist()}))


def measured(pixels: int, n_sensor: int, rate_hz: float, over: str, duration_s: float) -> dict[str, Any]:
    """Figures of one case over "zmq" or "ring"."""
    n_frame = int(rate_hz * duration_s)
    work = speed_work(pixels, 100, n_sensor, n_frame=n_frame // 4 + 1)
    renderer = ws.Renderer(work.scene, "cpu", catalog=work.catalog)
    renderer.render(range(4), work.sensors, [BAND])
    address, ring = ("tcp://127.0.0.1:*", None) if over == "zmq" else (None, f"warpsim-bench-{os.getpid()}")
    options: dict[str, Any] = {"rate_hz": rate_hz, "address": address, "ring": ring, "late": "drop"}
    options["wait_for"] = 4 if over == "zmq" else 0  # each subscribes to frames and to the scene
    with ws.FrameServer(renderer, range(n_frame), work.sensors, [BAND], **options) as server:
        source = server.address or server.ring
        asked = ["--subscribe", f"{source}", f"{n_frame * n_sensor}"]
        command = [sys.executable, "-m", "benchmarks.serve_latency", *asked]
        pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
        kept, killed = (subprocess.Popen(command, **pipes) for _ in range(2))
        while over == "ring" and not all(_has_mapped(child.pid, str(source)) for child in (kept, killed)):
            time.sleep(0.01)
        threading.Timer(0.5 * duration_s, killed.kill).start()
        stats = server.run()
    (text,) = kept.communicate(timeout=3 * TIMEOUT_S)[0].splitlines()
    killed.wait()
    received = json.loads(text)
    latency_ms = received.pop("latency_ms")
    p50, p99, most = np.percentile(latency_ms, [50, 99, 100]).round(3)
    found = {"n_frame": stats.n_frame, "n_dropped": stats.n_dropped, "n_late": stats.n_late, **received}
    found |= {"n_killed": int(killed.returncode == -9), "rate_hz": round(stats.rate_hz, 3)}
    return found | {"latency_p50_ms": p50, "latency_p99_ms": p99, "latency_max_ms": most}


def _has_mapped(pid: int, path: str) -> bool:
    """Whether a process has a file in its memory."""
    return path in Path(f"/proc/{pid}/maps").read_text()


def main() -> None:
    """Measure, and print the result or write it."""
    parser = parser_of(__doc__)
    parser.add_argument("--duration", type=float, default=DURATION_S, help="of each case [s]")
    parser.add_argument("--subscribe", nargs=2, metavar=("SOURCE", "N"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.subscribe:
        subscribe(options.subscribe[0], int(options.subscribe[1]))
        return
    if options.duration < LEAST_S:
        parser.error(f"--duration: must be at least {LEAST_S:g} s, as subscribers take some to begin")
    is_first = os.sched_getscheduler(0) == os.SCHED_FIFO
    found: dict[str, Any] = {
        "processor": processor_name(),
        "load_of_others": round(os.getloadavg()[0], 1),
        "duration_s": options.duration,
        "cases": {
            f"{name}, {over}": measured(*case, over, options.duration)
            for name, case in CASES.items()
            for over in ("zmq", "ring")
        },
    }
    command = ("chrt -f 10 " if is_first else "") + "python -m benchmarks.serve_latency"
    write_or_print(command, found, options.json)


if __name__ == "__main__":
    main()
