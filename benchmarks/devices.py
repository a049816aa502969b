"""Devices that the benchmarks run on: those of the option `--device`, else the CPU and, where there is one, a GPU."""

from __future__ import annotations

import pytest
import warp as wp

from warpsim.errors import InputError
from warpsim.render.device import default_device


def benchmark_devices(config: pytest.Config) -> list[str]:
    """Names of the devices.

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
