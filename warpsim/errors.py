"""Errors that name the place, the rule and the value in one line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

LONGEST_VALUE = 60
"""Characters of a value that are shown."""

LONGEST_FIELD = 120
"""Characters of a path of fields that are shown."""


class _NoValue:
    """Stands for a value that is not given: None may be one."""

    def __repr__(self) -> str:
        return "no value"


NO_VALUE = _NoValue()


class _Step(NamedTuple):
    """A part of a place: a path of fields, or the name of a file, a line, a body."""

    name: str
    is_field: bool


class InputError(ValueError):
    """Bad input.

    The text is one line: place, rule, value. `scene.toml: camera.fov_deg: must be in (0, 120), got -1.0`

    Args:
        rule: What is asked for, as in "must be in (0, 120)"; or the whole sentence.
        field: Path of the field or argument that breaks it, as in "camera.fov_deg".
        value: What it is instead; shown behind the rule.
        form: Format of a number that is shown, as in "g"; the number in full when left out.

    Attributes:
        rule: As given.
        value: As given; NO_VALUE where there is none.
        errors: The single errors, where several are told at once.
    """

    def __init__(self, rule: str, field: str = "", value: Any = NO_VALUE, form: str = "") -> None:
        self.rule, self.value, self._form = rule, value, form
        self._steps: tuple[_Step, ...] = (_Step(field, True),) if field else ()
        self.errors: tuple[InputError, ...] = ()
        super().__init__(self._text())

    @classmethod
    def several(cls, errors: Sequence[InputError], more: int = 0) -> Self:
        """One error that tells of some, and says how many more there are."""
        error = cls("")
        error.errors = tuple(errors)
        error.rule = "; ".join(map(str, errors)) + (f" (and {more} more)" if more else "")
        return error._retold(())

    @property
    def place(self) -> str:
        """Where it is: `scene.toml: camera.fov_deg`; empty where nobody said."""
        text = ""
        for before, step in zip((None, *self._steps), self._steps, strict=False):
            joins = before is not None and before.is_field and step.is_field
            text += ("" if not text or (joins and step.name.startswith("[")) else "." if joins else ": ") + step.name
        return text

    def within(self, field: str) -> Self:
        """The same error, of the part that a field holds: its path comes before the place."""
        return self._retold((_Step(field, True),)) if field else self

    def of(self, name: str) -> Self:
        """The same error, told of a file, a line, a body: its name comes before the place."""
        return self._retold((_Step(name, False),)) if name else self

    def _retold(self, steps: tuple[_Step, ...]) -> Self:
        """A copy with steps before the place."""
        error = type(self)(self.rule, "", self.value, self._form)
        error.errors, error._steps = self.errors, (*steps, *self._steps)
        error.args = (error._text(),)
        return error

    def _text(self) -> str:
        got = "" if self.value is NO_VALUE else f", got {shown(self.value, self._form)}"
        place = self.place
        if len(place) > LONGEST_FIELD and not any(not step.is_field for step in self._steps):
            place = f"{place[:60]}...{place[-40:]}"
        return f"{place}: {self.rule}{got}" if place else f"{self.rule}{got}"


def shown(value: Any, form: str = "") -> str:
    """A value as messages show it: on one line, not too long."""
    try:
        if form:
            return format(value, form)
        item = value.item() if hasattr(value, "item") and getattr(value, "ndim", None) == 0 else value
        text = " ".join(repr(item).split())  # arrays print over several lines
    except RecursionError:
        return f"a {type(value).__name__}"
    return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 3] + "..."
