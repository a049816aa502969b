"""Commands: warpsim render | access | check | plot | czml | detect | serve | view | catalog | dataset | ...."""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from warpsim.commands import catalogs, scenes, serving, speed
from warpsim.errors import InputError, printable
from warpsim.version import __version__


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; exit code 0, 1 for files not written or want of memory, 2 for bad input, 130 when interrupted."""
    # UTC has no leap seconds announced beyond the next half year; later epochs count without further ones.
    warnings.filterwarnings("ignore", message='.*"dubious year')
    parser, options = make_parser(), argparse.Namespace()
    try:
        parser.parse_args(arguments, options)
        command: Callable[[argparse.Namespace], int] = options.command
        return command(options)
    except InputError as error:
        print(f"warpsim: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader of a pipe has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:  # a full disk, say
        print(f"warpsim: {printable(str(error))}", file=sys.stderr)
        return 1
    except (MemoryError, RuntimeError) as error:  # Warp's own is a RuntimeError
        if not isinstance(error, MemoryError) and "Failed to allocate" not in str(error):
            raise
        print(f"warpsim: there is not enough memory: {printable(str(error) or 'MemoryError')}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        more = "; the same command goes on where it stopped" if getattr(options, "resumes", False) else ""
        print(f"warpsim: interrupted{more}", file=sys.stderr)
        return 130


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    """Show a warning as one line, without its source location."""
    print(f"warpsim: warning: {printable(' '.join(str(message).split()))}", file=sys.stderr)


class _Parser(argparse.ArgumentParser):
    """A parser whose refusals are printable."""

    def error(self, message: str) -> NoReturn:
        """Exit with what is wrong."""
        super().error(printable(message))


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line, with those of all commands."""
    parser = _Parser(prog="warpsim", description="Render what space-based infrared sensors see.")
    parser.add_argument("--version", action="version", version=f"warpsim {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for module in (scenes, serving, catalogs, speed):
        module.add_commands(commands)
    return parser


def run() -> None:
    """Entry point of the `warpsim` command."""
    warnings.showwarning = _show_warning
    sys.exit(main())


if __name__ == "__main__":
    run()
