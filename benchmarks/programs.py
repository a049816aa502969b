"""What benchmarks that are programs of their own share: command line, result, processor time."""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def parser_of(text: str | None) -> argparse.ArgumentParser:
    """Return a parser with the option --json, which says what a docstring says."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the result there instead of printing it")
    return parser


def write_or_print(command: str, found: dict[str, Any], path: Path | None) -> None:
    """Write a result as JSON with the command and the usable cores, or print it where no path is given."""
    found = {"command": command, "n_cpu": len(os.sched_getaffinity(0)), **found}
    text = json.dumps(found, indent=1) + "\n"
    if path:
        path.write_text(text)
    else:
        print(text)


def processor_s(call: Callable[..., object], *arguments: Any, **options: Any) -> float:
    """Processor time of a call, of all threads [s]."""
    begin = time.process_time()
    call(*arguments, **options)
    return time.process_time() - begin


def processor_name() -> str:
    """Name of the processor."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.partition(": ")[2] for line in lines if line.startswith("model name")), platform.machine())
