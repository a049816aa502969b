"""The command view: a page in the browser that shows a scene, a run or a data set."""

from __future__ import annotations

import argparse
import contextlib
from pathlib import Path

from warpsim.commands.options import SENSORS_HELP, frame_numbers, names, number, start_warp, whole_number
from warpsim.errors import InputError


def add_commands(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the parser of this command."""
    view = commands.add_parser("view", help="show a scene, a run or a data set in the browser, until Ctrl-C")
    view.add_argument("source", metavar="SOURCE", help="preset, scene file, folder of a run or of a data set")
    view.add_argument("--port", default="8080", metavar="N", help="of the page on this machine (8080); 0: a free one")
    view.add_argument("--sensors", metavar="NAMES", help=SENSORS_HELP)
    view.add_argument("--band", metavar="NAME", help="band that is shown; the first of each sensor if left out")
    view.add_argument("--sequence", default="0", metavar="N", help="of a data set")
    view.add_argument("--follow", metavar="ADDRESS", help="show what `warpsim serve SOURCE --address ADDRESS` sends")
    view.add_argument("--record", metavar="FILE", help="write a recording instead: .html, .mp4 or .gif")
    view.add_argument("--frames", metavar="A:B[:STEP]", help="of the recording; all if left out")
    view.add_argument("--fps", metavar="N", help="frames per second of the recording (10)")
    view.add_argument("--overwrite", action="store_true", help="replace an existing recording")
    view.set_defaults(command=_view)


def _view(options: argparse.Namespace) -> int:
    from warpsim.live.follow import Follower
    from warpsim.live.recording import record
    from warpsim.live.sources import images_from
    from warpsim.live.view import View

    _check_together(options)
    port = 0 if options.record else whole_number("--port", options.port)
    fps, chosen = number("--fps", options.fps or "10"), frame_numbers(options.frames)
    sequence = whole_number("--sequence", options.sequence)
    start_warp()
    with View(images_from(options.source, sequence), port, names(options.sensors), options.band) as page:
        if options.record is None:
            page.watch()
            with Follower(page, options.follow) if options.follow else contextlib.nullcontext():
                print(f"{page.url} shows {page.scenario.scene.name}; Ctrl-C ends", flush=True)
                page.run()
            return 0
        frames = page.frames[chosen or slice(None)] if chosen is None or isinstance(chosen, slice) else chosen
        if not frames:
            raise InputError(f"must be some of {page.frames[0]} to {page.frames[-1]}", "--frames", options.frames)
        if unknown := sorted(set(frames) - set(page.frames)):
            raise InputError("is no frame that the page has", "--frames", unknown[0])
        record(page, options.record, frames, fps, options.overwrite)
        size_mb = Path(options.record).stat().st_size / 1e6
        print(f"{options.record}: {len(frames)} frames, {size_mb:.3g} MB")
    return 0


def _check_together(options: argparse.Namespace) -> None:
    """Check that options which belong to a recording come with one, and that it follows nobody."""
    for name in ("frames", "fps", "overwrite"):
        if getattr(options, name) and not options.record:
            raise InputError("goes with --record alone", f"--{name}")
    if options.record and options.follow:
        raise InputError("must not come with --record: a page follows, a recording is rendered", "--follow")
