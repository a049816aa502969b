"""Results tell of the machine what speed hangs on, and nothing else."""

from __future__ import annotations

from typing import Any


def pytest_benchmark_update_machine_info(machine_info: dict[str, Any]) -> None:
    """Leave out the machine's name and the release of its kernel."""
    for key in ("node", "release"):
        machine_info.pop(key, None)


def pytest_benchmark_update_json(output_json: dict[str, Any]) -> None:
    """Leave out the state of the checkout: results are committed with the code they were taken from."""
    output_json.pop("commit_info", None)
