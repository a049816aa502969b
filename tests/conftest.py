"""What all tests share: a quiet Warp, and the devices to run on."""

from __future__ import annotations

import pytest
import warp as wp

wp.config.log_level = wp.LOG_ERROR


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that asks for `device` on the CPU, and on the first GPU where there is one."""
    if "device" in metafunc.fixturenames:
        metafunc.parametrize("device", ["cpu", "cuda:0"] if wp.is_cuda_available() else ["cpu"])
