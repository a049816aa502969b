"""Lines of a text that hold data, with their numbers in the file, and whether the last one is closed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.tables.cells import decoded


@dataclass(frozen=True)
class Lines:
    """Lines of a text that hold data, without their line breaks."""

    text: Sequence[bytes]
    number: NDArray[np.int64]
    """Line number of each in the file, counted from 1, shape (n,)."""

    ends_with_break: bool
    """Whether the last of them is closed by a line break."""

    def __len__(self) -> int:
        return len(self.text)


def lines_of(data: bytes, skip: tuple[bytes, ...] = ()) -> Lines:
    """Lines of a file that are neither blank nor begin with one of `skip`."""
    rows = data.split(b"\n")
    kept, numbers = [], []
    for number, row in enumerate(rows, start=1):
        line = row.removesuffix(b"\r")
        if line.strip() and not line.startswith(skip):
            kept.append(line)
            numbers.append(number)
    ends_with_break = not numbers or numbers[-1] < len(rows)
    return Lines(kept, np.array(numbers, dtype=np.int64), ends_with_break)


def lines_after(lines: Lines, n_line: int) -> Lines:
    """Lines behind the first n_line of the file."""
    first = int((lines.number <= n_line).sum())
    return Lines(lines.text[first:], lines.number[first:], lines.ends_with_break)


def open_end(lines: Lines) -> InputError | None:
    """The error of a last line that no line break closes: a number cut short would read as another number."""
    if not len(lines) or lines.ends_with_break:
        return None
    shown = decoded(lines.text[-1]).strip()[-30:]
    return InputError("must end with a line break, or the file may be cut off", value=shown).of(
        f"line {lines.number[-1]}"
    )


def check_last_line(lines: Lines) -> None:
    """Raise unless the last line is closed by a line break."""
    error = open_end(lines)
    if error is not None:
        raise error
