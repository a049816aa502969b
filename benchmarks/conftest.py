"""Fixtures of all benchmarks: the devices to run on, and the facts about the machine that speed depends on."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import pytest

from benchmarks.devices import benchmark_devices
from warpsim.render.renderer import Renderer
from warpsim.speed.work import SpeedWork, render_call


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--device=cuda:0`: where benchmarks run that take the fixture `device`; `--resident`: where counts end."""
    text = "comma-separated Warp devices; the CPU and, where there is one, the first GPU if left out"
    parser.addoption("--device", metavar="NAMES", help=text)
    parser.addoption("--resident", action="store_true", help="test_fps and test_stages leave counts on the device")


def pytest_configure(config: pytest.Config) -> None:
    """Refuse a device that is not there before anything is collected."""
    benchmark_devices(config)


@pytest.fixture
def resident(request: pytest.FixtureRequest) -> bool:
    """Whether counts stay on the device, instead of being copied to host memory in every timed call."""
    return bool(request.config.getoption("--resident"))


@pytest.fixture
def us_per_image(benchmark: Any) -> Callable[..., float | None]:
    """Function of work and a renderer: median time of an image, other frames in each call; None where disabled."""

    def measured(
        work: SpeedWork, renderer: Renderer, resident: bool = False, rounds: int = 7, warmup_rounds: int = 1
    ) -> float | None:
        calls = itertools.count()
        benchmark.pedantic(
            lambda: render_call(work, renderer, next(calls), resident), rounds=rounds, warmup_rounds=warmup_rounds
        )
        return None if benchmark.stats is None else benchmark.stats.stats.median / work.n_view * 1e6

    return measured


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a benchmark that asks for `device` on each."""
    if "device" in metafunc.fixturenames:
        metafunc.parametrize("device", benchmark_devices(metafunc.config))


def pytest_benchmark_update_machine_info(machine_info: dict[str, Any]) -> None:
    """Leave out the machine's name and the release of its kernel."""
    for key in ("node", "release"):
        machine_info.pop(key, None)


def pytest_benchmark_update_json(output_json: dict[str, Any]) -> None:
    """Leave out the state of the checkout: results are committed with the code they were taken from."""
    output_json.pop("commit_info", None)
