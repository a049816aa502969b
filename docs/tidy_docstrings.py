"""Docstrings and signatures as the reference shows them: short names of types, and words that napoleon leaves alone."""

from __future__ import annotations

import re
from typing import Any, Generic, NewType, TypeVar

Item = TypeVar("Item")

COLON = "\ue000"  # stands for a colon while napoleon looks for "type: description"


class NDArray(Generic[Item]):
    """Stands for numpy's type, whose full name takes a line."""


def name_array_types() -> None:
    """Let annotations say ArrayLike, DTypeLike and NDArray instead of what numpy makes of them."""
    import numpy.typing

    names = {"ArrayLike": NewType("ArrayLike", object), "DTypeLike": NewType("DTypeLike", object), "NDArray": NDArray}
    for name, stand_in in names.items():
        setattr(numpy.typing, name, stand_in)


def hide_colons(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Keep napoleon from taking words before a colon for a type; ours stand in the signature."""
    if what in ("property", "attribute", "data") and lines:
        lines[0] = lines[0].replace(":", COLON)
    for number, line in enumerate(lines[:-1]):
        if line.strip() in ("Returns:", "Yields:"):
            lines[number + 1] = lines[number + 1].replace(":", COLON)


def show_colons(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Put the colons back."""
    lines[:] = [line.replace(COLON, ":") for line in lines]


def plain_types(text: str) -> str:
    """A signature without what only checks need: the rules of `Annotated`, modules of types."""
    text = re.sub(r"\b(?:npt|np|numpy|os|collections\.abc)\.(?=[A-Z]|float|int|uint|bool)", "", text)
    while (start := text.find("Annotated[")) >= 0:
        depth, first_end, end = 0, None, start + len("Annotated[")
        while depth or text[end] != "]":
            depth += (text[end] in "[({") - (text[end] in "])}")
            if text[end] == "," and not depth and first_end is None:
                first_end = end
            end += 1
        text = text[:start] + text[start + len("Annotated[") : first_end] + text[end + 1 :]
    return text


def plain_signature(
    app: Any, what: str, name: str, thing: Any, options: Any, signature: str | None, returned: str | None
) -> tuple[str | None, str | None] | None:
    """Signatures for readers; none for classes that only warpsim itself makes."""
    if signature is None:
        return None
    if what == "class" and re.search(r"[(,] ?_\w+:", signature):
        return "", None
    signature = re.sub(r", (?:\*, )?kind: [^=]* = '\w+'", "", plain_types(signature))
    return signature, returned and plain_types(returned)


def connect(app: Any) -> None:
    """Hear of docstrings before and after napoleon, and of signatures."""
    app.connect("autodoc-process-docstring", hide_colons, priority=400)
    app.connect("autodoc-process-docstring", show_colons, priority=600)
    app.connect("autodoc-process-signature", plain_signature)
