"""Errors that name the place, the rule and the value in one line: field path or file, requirement, input."""

from __future__ import annotations

import numbers
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple, Self

LONGEST_VALUE = 60
"""Characters of a value that are shown."""

LONGEST_FIELD = 120
"""Characters of a path of fields that are shown."""

LONGEST_RULE = 500
"""Characters of a rule with its value that are shown: it may quote a long list of columns."""


class _NoValue:
    """Marker of a value that is not given: None may be one."""

    def __repr__(self) -> str:
        return "no value"

    def __reduce__(self) -> str:
        return "NO_VALUE"  # copies, also those from other processes, are the same object


NO_VALUE = _NoValue()


class _Step(NamedTuple):
    """A part of a place: a path of fields, or the name of a file, a line, a body."""

    name: str
    is_field: bool


class InputError(ValueError):
    """Bad input.

    The text is one printable line: place, rule, value. `scene.toml: camera.fov_deg: must be in (0, 120), got -1.0`

    Args:
        rule: Requirement, as in "must be in (0, 120)"; or the whole sentence.
        field: Path of the field or argument that breaks it, as in "camera.fov_deg"; or of several, "time_s, file".
        value: Input given instead; shown behind the rule.
        form: Format in which the value is shown: "g" for a number, "s" for words without quotes; in full when left out.
        row: Which row of a table or of arrays breaks the rule, counted from 0; shown behind the value.
        n_row: How many rows break it, where all were looked at.

    Attributes:
        rule: As given.
        field: As given; where none was, the first that it was found within.
        value: As given; NO_VALUE where there is none.
        row: As given; None where there is none.
        errors: The single errors, where several are reported at once.
    """

    def __init__(
        self,
        rule: str,
        field: str = "",
        value: Any = NO_VALUE,
        form: str = "",
        *,
        row: int | None = None,
        n_row: int | None = None,
    ) -> None:
        self.rule, self.field, self.value, self.row = rule, field, value, row
        self._form, self._n_row = form, n_row
        self._steps: tuple[_Step, ...] = (_Step(str(field), True),) if field else ()
        self.errors: tuple[InputError, ...] = ()
        super().__init__(self._text())

    @classmethod
    def several(cls, errors: Sequence[InputError], more: int = 0) -> Self:
        """One error for several, with the number of those not shown."""
        error = cls("")
        error.errors = tuple(errors)
        error.rule = "; ".join(map(str, errors)) + (f" (and {more} more)" if more else "")
        return error._with_steps(())

    @property
    def place(self) -> str:
        """Location of the error: `scene.toml: camera.fov_deg`; empty if unknown."""
        text = ""
        for before, step in zip((None, *self._steps), self._steps, strict=False):
            joins = before is not None and before.is_field and step.is_field and ", " not in step.name
            text += ("" if not text or (joins and step.name.startswith("[")) else "." if joins else ": ") + step.name
        return text

    def within(self, field: str) -> Self:
        """Return the error with a field's path before the place."""
        if not field:
            return self
        error = self._with_steps((_Step(str(field), True),))
        error.field = self.field or field
        return error

    def of(self, name: str | os.PathLike[str]) -> Self:
        """Return the error with the name of a file, a line or a body before the place."""
        return self._with_steps((_Step(os.fspath(name), False),)) if name else self

    def at_row(self, name: str) -> Self:
        """Return the error with the name of its row, "line 3" of a file, before the place."""
        error = self._with_steps((_Step(name, False),))
        error.row = None
        error.args = (error._text(),)
        return error

    def _with_steps(self, steps: tuple[_Step, ...]) -> Self:
        """A copy with steps before the place."""
        error = type(self)(self.rule, self.field, self.value, self._form, row=self.row, n_row=self._n_row)
        error.errors, error._steps = self.errors, (*steps, *self._steps)
        error.args = (error._text(),)
        return error

    def _text(self) -> str:
        place = self.place
        if len(place) > LONGEST_FIELD and not any(not step.is_field for step in self._steps):
            place = f"{place[:60]}...{place[-40:]}"
        rule = self.rule if self.value is NO_VALUE else f"{self.rule}, got {shown(self.value, self._form)}"
        if self.row is not None:
            rule += f" in row {self.row}"
        if self._n_row is not None and self._n_row > 1:
            rule += f" ({self._n_row} such rows)"
        if len(rule) > LONGEST_RULE and not self.errors:
            rule = f"{rule[:LONGEST_RULE]} ..."
        return printable(f"{place}: {rule}" if place else rule)


@contextmanager
def errors_at(field: str, name: str = "") -> Iterator[None]:
    """Put a field's path, and the name of a file or a body in it, before the location of errors raised within."""
    try:
        yield
    except InputError as error:
        raise error.of(name).within(field) from None


def shown(value: Any, form: str = "") -> str:
    """A value as messages show it: on one line, not too long."""
    try:
        if form and isinstance(value, str if form == "s" else numbers.Number):
            return format(value, form)
        item = value.item() if hasattr(value, "item") and getattr(value, "ndim", None) == 0 else value
        text = " ".join(repr(item).split())  # arrays print over several lines
    except (RecursionError, ValueError, OverflowError):  # whole numbers of thousands of digits among them
        return f"a {type(value).__name__}{' of very many digits' if isinstance(value, int) else ''}"
    return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 3] + "..."


_PYTHON = (AssertionError, AttributeError, LookupError, NameError, RecursionError)
"""Errors of another library's code, where it did not foresee a damaged file: their texts are about Python."""


def one_line(error: BaseException) -> str:
    """First line of what another library says, or its kind of error."""
    if isinstance(error, _PYTHON):
        return "it is damaged, or of another form"
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0][:200] if lines else type(error).__name__


def printable_lines(text: str) -> str:
    """A text of several lines, each printable."""
    return "\n".join(map(printable, text.split("\n")))


def printable(text: str) -> str:
    """A text as one line: blanks of any kind are plain ones, and what cannot be printed is a question mark."""
    return "".join(c if c.isprintable() else " " if c.isspace() else "?" for c in text)
