"""Options: texts of the command line as numbers, names and scenes."""

from __future__ import annotations

import argparse
import ctypes.util
import math
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from warpsim.errors import InputError, printable_lines

if TYPE_CHECKING:
    from warpsim.commands.compile_notice import CompileNotice
    from warpsim.scene.scenario import Scenario

SENSORS_HELP = "comma-separated sensors, kinds of them, or patterns like 'sat1*'"


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Add the scene to the arguments of a command."""
    parser.add_argument("scene", metavar="SCENE", help="preset name (stss), or path of a .toml or .json file")


def start_warp(quiet: bool = False, in_workers: bool = False) -> None:
    """Start Warp without its messages: the report is for a person, who is told while kernels are compiled.

    On a machine without an NVIDIA driver Warp's native part warns on the error stream at every start; that such a
    machine has no CUDA is known, so the stream is closed to it for that moment.

    Args:
        quiet: Whether nothing is said of kernels.
        in_workers: Whether other processes compile, whose progress is not known here.
    """
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    if ctypes.util.find_library("cuda") is not None:
        wp.init()
    else:
        sys.stderr.flush()
        kept = os.dup(2)
        try:
            with open(os.devnull, "wb") as nowhere:  # noqa: PTH123
                os.dup2(nowhere.fileno(), 2)
                wp.init()
        finally:
            os.dup2(kept, 2)
            os.close(kept)
    if not quiet:
        _announce_compilation(Path(str(wp.config.kernel_cache_dir)), in_workers)


def _announce_compilation(folder: Path, in_workers: bool) -> None:
    """Let a person know, now or later, what the first command on a machine waits for."""
    if in_workers:
        if sys.stderr.isatty() and not any(folder.glob("wp_*")):
            print(f"compiling kernels: about half a minute, once; they are kept in {folder}", file=sys.stderr)
        return
    from warpsim.commands.compile_notice import CompileNotice
    from warpsim.render.device import when_loading

    if not _NOTICES:
        _NOTICES.append(CompileNotice(str(folder)))
        when_loading(_NOTICES[0].add)


_NOTICES: list[CompileNotice] = []  # one at most: a process may run several commands


def scenario_of(source: str) -> Scenario:
    """The scenario of a preset or a scene file; errors begin with its name."""
    from warpsim.scene.scene import Scene

    scene = Scene.load(source)
    try:
        return scene.scenario
    except InputError as error:
        raise error.of(source) from None


def say(text: str) -> None:
    """Print a text: what it quotes of scenes and files must not steer the terminal."""
    print(printable_lines(text))


def whole_number(where: str, text: str) -> int:
    """A whole number such as 1000000 or 1e6."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not number.is_integer():
        raise InputError("must be a whole number", value=text).of(where)
    return int(number)


def number(where: str, text: str) -> float:
    """Return a number; InputError, of `where`, for another text."""
    try:
        return float(text)
    except ValueError:
        raise InputError("must be a number", value=text).of(where) from None


def counts(where: str, text: str | None) -> tuple[int, ...] | None:
    """Return whole numbers >= 1 of a comma-separated list."""
    if text is None:
        return None
    numbers = tuple(whole_number(where, item) for item in text.split(","))
    if min(numbers) < 1:
        raise InputError("must be whole numbers >= 1", value=text).of(where)
    return numbers


def names(text: str | None) -> list[str] | None:
    """Return the names of a comma-separated list."""
    return None if text is None else [name.strip() for name in text.split(",") if name.strip()]


def frame_numbers(text: str | None) -> list[int] | slice | None:
    """Frame numbers of A:B, A:B:STEP (a slice of the frames of each sensor) or a single number."""
    if text is None:
        return None
    try:
        numbers = [int(item) if item.strip() else None for item in text.split(":")]
        if len(numbers) == 1 and numbers[0] is not None:
            return [numbers[0]]
        if len(numbers) not in (2, 3) or 0 in numbers[2:]:
            raise ValueError
        return slice(*numbers)
    except ValueError:
        raise InputError("must be A:B, A:B:STEP or one number", "--frames", text) from None
