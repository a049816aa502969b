"""Markdown tables and the cells in them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

Case = dict[str, Any]


def table(head: str, rows: Iterable[Sequence[object]]) -> list[str]:
    """Lines of a table.

    Args:
        head: Names of the columns, with " | " between them.
        rows: Cells of each row, as they are to be shown.
    """
    n_column = head.count(" | ") + 1
    lines = [f"| {head} |", "|" + "---|" * n_column]
    return lines + ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]


def shown(value: float | None, form: str) -> str:
    """A number, or a dash where there is none."""
    return "-" if value is None else format(value, form)


def cases_of(data: dict[str, Any]) -> list[Case]:
    """Facts that each benchmark of a result records."""
    return [case for benchmark in data["benchmarks"] if (case := benchmark["extra_info"])]
