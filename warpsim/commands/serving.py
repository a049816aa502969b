"""The command serve: frames for other processes in real time."""

from __future__ import annotations

import argparse
import signal
from typing import Any

from warpsim.commands.options import (
    SENSORS_HELP,
    add_scene,
    frame_numbers,
    names,
    number,
    scenario_of,
    start_warp,
    whole_number,
)
from warpsim.errors import printable


def add_commands(commands: Any) -> None:
    """Add the parser of this command."""
    serve = commands.add_parser("serve", help="send frames to other processes in real time, until Ctrl-C")
    add_scene(serve)
    serve.add_argument("--address", metavar="ADDRESS", help="publish over ZeroMQ: tcp://*:5555, ipc:///tmp/frames")
    serve.add_argument("--ring", metavar="NAME", help="write to a ring of shared memory: a name in /dev/shm, or a path")
    serve.add_argument("--control", metavar="ADDRESS", help="take pointing commands over ZeroMQ")
    serve.add_argument("--rate", metavar="HZ", help="frames per second; the pace of the scene if left out")
    serve.add_argument("--late", default="drop", metavar="NAME", help="frames that are late: drop (default) or send")
    serve.add_argument("--loop", action="store_true", help="begin anew after the last frame")
    serve.add_argument("--wait-for", default="0", metavar="N", help="subscriptions to wait for, none if left out")
    serve.add_argument("--frames", metavar="A:B[:STEP]", help="frame numbers, like a Python slice")
    serve.add_argument("--sensors", metavar="NAMES", help=SENSORS_HELP)
    serve.add_argument("--bands", metavar="NAMES", help="comma-separated band names")
    serve.add_argument("--ahead", metavar="N", help="frames rendered ahead at most; chosen by rate if left out")
    serve.add_argument("--device", help="Warp device: cpu, cuda:0, ...")
    serve.set_defaults(command=_serve)


def _serve(options: argparse.Namespace) -> int:
    from warpsim.render.renderer import Renderer
    from warpsim.render.request import checked_names
    from warpsim.serving.server import FrameServer

    scenario = scenario_of(options.scene)
    start_warp()
    sensors = names(options.sensors)
    instrument = checked_names(scenario, sensors, None)[0]
    frames = frame_numbers(options.frames)
    with FrameServer(
        Renderer(scenario, options.device),
        range(instrument.frames.count)[frames] if isinstance(frames, slice) else frames,
        sensors,
        names(options.bands),
        rate_hz=None if options.rate is None else number("--rate", options.rate),
        address=options.address,
        ring=options.ring,
        control=options.control,
        late=options.late,
        loop=options.loop,
        wait_for=whole_number("--wait-for", options.wait_for),
        n_ahead=None if options.ahead is None else whole_number("--ahead", options.ahead),
    ) as server:
        where = [f"{name} {at}" for name in ("address", "ring", "control") if (at := getattr(server, name))]
        print(printable(f"serving {scenario.scene.name}: {', '.join(where)}"), flush=True)
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)  # it ends the server as Ctrl-C does
        try:
            server.run()
        except KeyboardInterrupt:
            print()
        finally:
            signal.signal(signal.SIGTERM, before)
        stats = server.stats
        p50_ms, p99_ms = 1e3 * stats.latency_p50_s, 1e3 * stats.latency_p99_s
        print(
            f"{stats.n_frame} frames, {server.n_packet} packets at {stats.rate_hz:.2f} Hz, sent {p50_ms:.2f} ms after "
            f"they were due (99 %: {p99_ms:.2f} ms); {stats.n_dropped} dropped, {stats.n_late} late"
        )
    return 0
