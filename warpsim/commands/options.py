"""Options: texts of the command line as numbers, names and scenes."""

from __future__ import annotations

import argparse
import ctypes.util
import math
import os
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from warpsim.errors import InputError, errors_at, printable_lines

if TYPE_CHECKING:
    from warpsim.commands.compile_notice import CompileNotice
    from warpsim.scene.scenario import Scenario


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
    with errors_at("", source):
        return scene.scenario


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


def counts(where: str, text: str) -> tuple[int, ...]:
    """Return whole numbers >= 1 of a comma-separated list."""
    numbers = tuple(whole_number(where, item) for item in text.split(","))
    if min(numbers) < 1:
        raise InputError("must be whole numbers >= 1", value=text).of(where)
    return numbers


def names(where: str, text: str) -> list[str]:
    """Return the names of a comma-separated list."""
    return [name.strip() for name in text.split(",") if name.strip()]


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


def chosen_frames(text: str | None, known: Sequence[int]) -> Sequence[int]:
    """Frames among known ones, by the text of frame_numbers, all for None; a single number whether known or not."""
    numbers = frame_numbers(text)
    return numbers if isinstance(numbers, list) else known[numbers or slice(None)]


class Option(NamedTuple):
    """An argument of a command."""

    usage: str
    """As help shows it: `SCENE`, `[SCENE]`, `-o, --output DIR`, `--step S`; `--stars` is a switch."""
    text: str
    convert: Callable[[str, str], Any] | None = None
    """Value of an option, from its name, which errors have, and its text; that text itself when left out."""
    default: Any = None
    required: bool = False


SCENE = Option("SCENE", "preset name (stss), or path of a .toml or .json file")
FOLDER = Option("-o, --output DIR", "folder to write to", required=True)
FRAMES = Option("--frames A:B[:STEP]", "frame numbers, like a Python slice")
SENSORS = Option("--sensors NAMES", "comma-separated sensors, kinds of them, or patterns like 'sat1*'", names)
BANDS = Option("--bands NAMES", "comma-separated band names", names)
DEVICE = Option("--device DEVICE", "Warp device: cpu, cuda:0, ...")
OVERWRITE = Option("--overwrite", "replace existing files")


def add_command(
    commands: Any,
    name: str,
    text: str,
    run: Callable[[argparse.Namespace], int],
    *options: Option,
    resumes: bool = False,
) -> None:
    """Add a command; `resumes` if it goes on where it was interrupted."""
    parser = commands.add_parser(name, help=text)
    for option in options:
        *flags, last = re.split(",? ", option.usage)
        if last.startswith("-"):
            parser.add_argument(*flags, last, action="store_true", help=option.text)
        elif not flags:
            name, nargs = last.strip("[]"), "?" if last.startswith("[") else None
            parser.add_argument(name.lower(), metavar=name, nargs=nargs, help=option.text)
        else:
            action = _converted(option.convert) if option.convert else "store"
            more = {"default": option.default, "required": option.required}
            parser.add_argument(*flags, metavar=last, action=action, help=option.text, **more)
    parser.set_defaults(command=run, resumes=resumes)


def is_given(options: argparse.Namespace, name: str) -> bool:
    """Return whether an option without a default, or a switch, was given."""
    value = getattr(options, name)
    return value is not None and value is not False


def _converted(convert: Callable[[str, str], Any]) -> type[argparse.Action]:
    """The action of an option whose text becomes a value."""

    class Converted(argparse.Action):
        def __call__(self, parser: Any, namespace: argparse.Namespace, text: Any, option: str | None = None) -> None:
            setattr(namespace, self.dest, convert(self.option_strings[-1], text))

    return Converted
