"""What tests share: a quiet Warp, the devices to run on, the paper's scene, the checkout for child processes."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import warp as wp

import warpsim as ws

ROOT = Path(__file__).parents[1]

wp.config.log_level = wp.LOG_ERROR


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that asks for `device` on the CPU, and on the first GPU where there is one."""
    if "device" in metafunc.fixturenames:
        metafunc.parametrize("device", ["cpu", "cuda:0"] if wp.is_cuda_available() else ["cpu"])


@pytest.fixture(scope="session")
def scene() -> ws.Scene:
    """The preset `stss`; scenes do not change, so one serves all."""
    return ws.Scene.load("stss")


@pytest.fixture(scope="session")
def checkout_environment() -> dict[str, str]:
    """Environment in which a child process imports the packages of this checkout."""
    folders = (str(ROOT / name) for name in (".", "kernels", "catalogs"))
    return {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}
