"""What benchmarks share: devices, and of programs of their own command line, result, processor time."""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import warp as wp

from warpsim.errors import InputError
from warpsim.render.device import default_device


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


def benchmark_devices(config: pytest.Config) -> list[str]:
    """Names of the devices that benchmarks run on: those of `--device`, else the CPU and, where there is one, a GPU.

    Raises:
        pytest.UsageError: No such device.
    """
    given = config.getoption("--device")
    if given is None:
        return ["cpu", *(["cuda:0"] if wp.is_cuda_available() else [])]
    try:
        return [str(default_device(name.strip())) for name in given.split(",")]
    except InputError as error:
        raise pytest.UsageError(f"--device: {error}") from None
