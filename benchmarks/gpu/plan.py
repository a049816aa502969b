"""Settings of the program's steps, and the rows that they return."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

Row = dict[str, Any]
"""A result: `name`, figures, and of a check `ok`."""

Check = Callable[[], Row]
"""Something that is checked or measured; an exception, or `ok` that is False, is a failure."""


@dataclass(frozen=True)
class Plan:
    """Device and amount of work of the steps."""

    device: str
    quick: bool = False
    """Few and small cases: that the program runs is seen, speed is not measured."""

    @property
    def is_cuda(self) -> bool:
        """Whether it is a GPU."""
        return self.device.startswith("cuda")


def lack_of_torch(device: str) -> Row | None:
    """Return the row of a check that needs PyTorch on a device, where it is not there."""
    if importlib.util.find_spec("torch") is None:
        return {"skipped": "needs PyTorch"}
    import torch

    is_there = not device.startswith("cuda") or torch.cuda.is_available()
    return None if is_there else {"skipped": "needs PyTorch with CUDA"}


def rows_of(checks: Iterable[tuple[str, Check]]) -> Iterator[Row]:
    """Make checks one by one; one that fails does not keep the others from being made."""
    for name, check in checks:
        try:
            yield {"name": name, "ok": True, **check()}
        except Exception as error:
            yield {"name": name, "ok": False, "error": f"{type(error).__name__}: {error}"}


def line_of(row: Row) -> str:
    """A row as it is printed."""
    shown = (f"{key} {_shown(value)}" for key, value in row.items() if key not in ("name", "ok"))
    return f"{'ok  ' if row.get('ok', True) else 'FAIL'} {row['name']}: {', '.join(shown) or 'done'}"


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} {_shown(item)}" for key, item in value.items()) + "}"
    return str(value)
