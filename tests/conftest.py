"""What tests share: a quiet Warp, the devices to run on, the paper's scene, the checkout for child processes."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import accuracy_records
import pytest
import warp as wp
from hypothesis import settings

import warpsim as ws

ROOT = Path(__file__).parents[1]

wp.config.log_level = wp.LOG_ERROR
settings.register_profile("repeatable", derandomize=True)  # `python -m tests.fuzz` looks for new cases
settings.load_profile("repeatable")


def slow(*values: Any, **named: Any) -> Any:
    """Case of `parametrize` that runs with -m slow."""
    return pytest.param(*values, marks=pytest.mark.slow, **named)


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--accuracy=FILE` (with =, as FILE may exist), for the figures of docs/accuracy.md."""
    parser.addoption("--accuracy", type=Path, metavar="FILE", help="write the errors that tests record to a JSON file")


def pytest_configure(config: pytest.Config) -> None:
    """Collect records where they are asked for: in the process that hears of all reports."""
    path = config.getoption("--accuracy")
    if path and not hasattr(config, "workerinput"):
        config.pluginmanager.register(accuracy_records.Records(path))


@pytest.hookimpl(tryfirst=True)  # before -m chooses
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that record accuracy, so that `-m accuracy` runs them."""
    for item in items:
        if "record_accuracy" in getattr(item, "fixturenames", ()):
            item.add_marker("accuracy")


@pytest.fixture
def record_accuracy(request: pytest.FixtureRequest) -> Callable[..., None]:
    """`record_accuracy(name, measured, limit, unit, oracle)`: an error for docs/accuracy.md; fails beyond its limit."""
    return partial(accuracy_records.record, request.node)


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
    folders = [str(ROOT / name) for name in (".", "kernels", "catalogs")]
    others = filter(None, [os.environ.get("PYTHONPATH")])
    return {**os.environ, "PYTHONPATH": os.pathsep.join([*folders, *others])}
