"""The commands serve (frames for other processes in real time) and view (a page in the browser)."""

from __future__ import annotations

import argparse
import contextlib
import signal
from pathlib import Path
from typing import Any

from warpsim.commands.options import (
    BANDS,
    DEVICE,
    FRAMES,
    SCENE,
    SENSORS,
    Option,
    add_command,
    chosen_frames,
    is_given,
    number,
    scenario_of,
    start_warp,
    whole_number,
)
from warpsim.errors import InputError, printable


def add_commands(commands: Any) -> None:
    """Add the parsers of these commands."""
    add_command(
        commands, "serve", "send frames to other processes in real time, until Ctrl-C", _serve,
        SCENE,
        Option("--address ADDRESS", "publish over ZeroMQ: tcp://*:5555, ipc:///tmp/frames"),
        Option("--ring NAME", "write to a ring of shared memory: a name in /dev/shm, or a path"),
        Option("--control ADDRESS", "take pointing commands over ZeroMQ"),
        Option("--rate HZ", "frames per second; the pace of the scene if left out", number),
        Option("--late NAME", "frames that are late: drop (default) or send", default="drop"),
        Option("--loop", "begin anew after the last frame"),
        Option("--wait-for N", "subscriptions to wait for, none if left out", whole_number, 0),
        FRAMES, SENSORS, BANDS,
        Option("--ahead N", "frames rendered ahead at most; chosen by rate if left out", whole_number),
        DEVICE,
    )  # fmt: skip
    add_command(
        commands, "view", "show a scene, a run or a data set in the browser, until Ctrl-C", _view,
        Option("SOURCE", "preset, scene file, folder of a run or of a data set"),
        Option("--port N", "of the page on this machine (8080); 0: a free one", whole_number, 8080),
        SENSORS,
        Option("--band NAME", "band that is shown; the first of each sensor if left out"),
        Option("--sequence N", "of a data set", whole_number, 0),
        Option("--follow ADDRESS", "show what `warpsim serve SOURCE --address ADDRESS` sends"),
        Option("--record FILE", "write a recording instead: .html, .mp4 or .gif"),
        Option("--frames A:B[:STEP]", "of the recording; all if left out"),
        Option("--fps N", "frames per second of the recording (10)", number),
        Option("--overwrite", "replace an existing recording"),
    )  # fmt: skip


def _serve(options: argparse.Namespace) -> int:
    from warpsim.render.renderer import Renderer
    from warpsim.render.request import checked_names
    from warpsim.serving.server import FrameServer

    scenario = scenario_of(options.scene)
    start_warp()
    instrument = checked_names(scenario, options.sensors, None)[0]
    with FrameServer(
        Renderer(scenario, options.device),
        chosen_frames(options.frames, range(instrument.frames.count)),
        options.sensors,
        options.bands,
        rate_hz=options.rate,
        address=options.address,
        ring=options.ring,
        control=options.control,
        late=options.late,
        loop=options.loop,
        wait_for=options.wait_for,
        n_ahead=options.ahead,
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


def _view(options: argparse.Namespace) -> int:
    from warpsim.live.follow import Follower
    from warpsim.live.recording import record
    from warpsim.live.sources import images_from
    from warpsim.live.view import View

    _check_together(options)
    port = 0 if options.record else options.port
    start_warp()
    with View(images_from(options.source, options.sequence), port, options.sensors, options.band) as page:
        if options.record is None:
            page.watch()
            with Follower(page, options.follow) if options.follow else contextlib.nullcontext():
                print(f"{page.url} shows {page.scenario.scene.name}; Ctrl-C ends", flush=True)
                page.run()
            return 0
        frames = chosen_frames(options.frames, page.frames)
        if not frames:
            raise InputError(f"must be some of {page.frames[0]} to {page.frames[-1]}", "--frames", options.frames)
        if unknown := sorted(set(frames) - set(page.frames)):
            raise InputError("is no frame that the page has", "--frames", unknown[0])
        fps = 10.0 if options.fps is None else options.fps
        record(page, options.record, frames, fps, options.overwrite)
        size_mb = Path(options.record).stat().st_size / 1e6
        print(f"{options.record}: {len(frames)} frames, {size_mb:.3g} MB")
    return 0


def _check_together(options: argparse.Namespace) -> None:
    """Check that options which belong to a recording come with one, and that it follows nobody."""
    for name in ("frames", "fps", "overwrite"):
        if is_given(options, name) and not options.record:
            raise InputError("goes with --record alone", f"--{name}")
    if options.record and options.follow:
        raise InputError("must not come with --record: a page follows, a recording is rendered", "--follow")
