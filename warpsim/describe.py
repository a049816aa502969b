"""Descriptions: the immutable, validated parts that scenes are made of.

`@part` turns a class body of annotated fields into a frozen dataclass that checks every value on construction. The
field types below carry the rules. Numbers may be given as astropy Quantity: the unit to convert to is read from the
end of the field's name (`altitude_km`, `fov_deg`, `nei_w_cm2`), once, at this boundary.

A bad value raises `InputError`, whose text is one line: where, rule, value.
"""

from __future__ import annotations

import difflib
import functools
import math
import os
import re
from collections.abc import Callable
from typing import Annotated, Any, TypeVar, dataclass_transform

import numpy as np
from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, Tag, ValidationError, ValidationInfo
from pydantic.dataclasses import dataclass as pydantic_dataclass
from pydantic.dataclasses import rebuild_dataclass
from pydantic_core import ErrorDetails, PydanticCustomError

from warpsim.errors import InputError
from warpsim.files import absolute_path

T = TypeVar("T")

# Longest suffix first, so that `_m_s` is not read as `_s`.
_UNIT_OF_SUFFIX = {
    "_w_cm2_sr": "W / (cm2 sr)",
    "_j_kg_k": "J / (kg K)",
    "_mjy_sr": "MJy / sr",
    "_w_cm2": "W / cm2",
    "_w_m2": "W / m2",
    "_rev_s": "1 / s",
    "_m_s": "m / s",
    "_e_s": "electron / s",
    "_deg": "deg",
    "_rad": "rad",
    "_urad": "urad",
    "_km": "km",
    "_um": "um",
    "_hz": "Hz",
    "_jy": "Jy",
    "_px": "pix",
    "_kg": "kg",
    "_m": "m",
    "_e": "electron",
    "_s": "s",
    "_k": "K",
}


def _plain_number(value: Any, info: ValidationInfo) -> float:
    """Return value as a Python float, converting a Quantity to the unit its field is named after."""
    if hasattr(value, "unit") and hasattr(value, "to_value"):
        name = info.field_name or ""
        suffix = next((s for s in _UNIT_OF_SUFFIX if name.endswith(s)), None)
        unit = _UNIT_OF_SUFFIX[suffix] if suffix else ""
        try:
            value = value.to_value(unit)
        except Exception:
            raise PydanticCustomError("unit", f"must be convertible to {unit or 'a plain number'}") from None
    if (isinstance(value, np.ndarray) and value.ndim == 0) or isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise PydanticCustomError("number", "must be a number")
    if not math.isfinite(value):
        raise PydanticCustomError("finite", "must be finite")
    return float(value)


def _in_interval(low: float, high: float, open_low: bool, open_high: bool) -> Callable[[float], float]:
    if math.isinf(high):
        rule = f"must be {'>' if open_low else '>='} {low:g}"
    else:
        rule = f"must be in {'(' if open_low else '['}{_plain(low)}, {_plain(high)}{')' if open_high else ']'}"

    def check(value: float) -> float:
        above = value > low if open_low else value >= low
        below = value < high if open_high else value <= high
        if not (above and below):
            raise PydanticCustomError("interval", rule)
        return value

    return check


def _plain(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:g}"


def number_within(value: Any, info: ValidationInfo, low: float, high: float, open_low: bool = False) -> float:
    """A number from low to high, for validators that decide by hand; its unit by the field's name.

    Raises:
        PydanticCustomError: It is none.
    """
    return _in_interval(low, high, open_low, False)(_plain_number(value, info))


def rows_in(unit: str) -> BeforeValidator:
    """Rule: a list; arrays become lists, quantities numbers in a unit."""

    def check(value: Any) -> Any:
        if hasattr(value, "unit") and hasattr(value, "to_value"):
            try:
                value = value.to_value(unit)
            except Exception:
                raise rule_error(f"must be convertible to {unit or 'plain numbers'}") from None
        if isinstance(value, np.ndarray):
            value = value.tolist()
        if not isinstance(value, list | tuple):
            raise rule_error("must be a list")
        return tuple(value)

    return BeforeValidator(check)


def _whole_number(value: Any) -> Any:
    if isinstance(value, np.integer):
        return int(value)
    if isinstance(value, bool) or not isinstance(value, int):
        raise PydanticCustomError("integer", "must be a whole number")
    return value


def _true_or_false(value: Any) -> Any:
    if not isinstance(value, bool | np.bool_):
        raise PydanticCustomError("switch", "must be true or false")
    return bool(value)


def open_interval(low: float, high: float) -> AfterValidator:
    """Rule: low < value < high."""
    return AfterValidator(_in_interval(low, high, True, True))


def closed_interval(low: float, high: float) -> AfterValidator:
    """Rule: low <= value <= high."""
    return AfterValidator(_in_interval(low, high, False, False))


Number = Annotated[float, BeforeValidator(_plain_number)]
"""Any finite number."""
Positive = Annotated[Number, AfterValidator(_in_interval(0, math.inf, True, True))]
NonNegative = Annotated[Number, AfterValidator(_in_interval(0, math.inf, False, True))]
Length = Annotated[Positive, closed_interval(0, 1e5)]
"""A body's dimension [m]; far larger ones would overflow float32 irradiances."""
Integer = Annotated[int, BeforeValidator(_whole_number)]
Count = Annotated[Integer, AfterValidator(_in_interval(1, math.inf, False, True)), closed_interval(1, 10**9)]
Group = Annotated[Count, closed_interval(1, 100_000)]
"""A number of satellites or targets."""
Switch = Annotated[bool, BeforeValidator(_true_or_false)]
Vector = tuple[Number, Number, Number]


def _file_name(value: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", value):
        raise PydanticCustomError("name", "must be letters, digits, '_', '.' or '-'")
    return value


Name = Annotated[str, AfterValidator(_file_name)]
"""A name that can also be a file name."""


def whole_path(value: Any, rule: str = "must be the path of a file") -> str:
    """The path of a file, absolute from here on: the current directory may change before the file is read.

    Raises:
        PydanticCustomError: It is no path.
    """
    try:
        path = os.fspath(value)
        if isinstance(path, str) and path and b"\0" not in os.fsencode(path):
            return absolute_path(path)
    except (TypeError, ValueError, OSError):  # no path, no name of this system, or the current directory is gone
        pass
    raise rule_error(rule)


FileName = Annotated[str, BeforeValidator(whole_path)]
"""Path of a file, as text or os.PathLike; becomes absolute, counted from the current directory."""


def choice(tag: str) -> Tag:
    """The tag of a member of a union that has no kinds; places in messages leave it out."""
    _KINDS.add(tag)
    return Tag(tag)


def as_tuple(value: Any) -> Any:
    """Lists of scene files become tuples; a single name is a list of one."""
    if isinstance(value, str):
        return (value,)
    if not isinstance(value, list | tuple):
        raise rule_error("must be a list")
    return tuple(value)


TOO_DEEP = "is nested too deeply"
"""The rule that parts within parts within parts break."""

CONFIG = ConfigDict(extra="forbid", arbitrary_types_allowed=True)


def rule_error(rule: str) -> PydanticCustomError:
    """The error to raise from a field's validator: its text is the rule; place and value are added."""
    return PydanticCustomError("rule", "{rule}", {"rule": rule})


def part_error(rule: str) -> PydanticCustomError:
    """The error to raise from a validator over several fields: its text names them and is shown as it is."""
    return PydanticCustomError("whole", "{rule}", {"rule": rule})


def _place(location: tuple[int | str, ...], positional: list[str]) -> str:
    """`targets[2].shape.radius_m`; the tag that a union puts into the path is left out."""
    text = ""
    if location and isinstance(location[0], int) and location[0] < len(positional):
        location = (positional[location[0]], *location[1:])
    after_tag = True  # a tag follows the union's own place, and is followed by a field, which may be spelled like one
    for item in location:
        after_tag = not after_tag and item in _KINDS
        if isinstance(item, int):
            text += f"[{item}]"
        elif not after_tag:
            text += f".{item}" if text else item
    return text if len(text) <= 120 else f"{text[:60]}...{text[-40:]}"


def _is_place(text: str) -> bool:
    """Whether text is a path of known fields, `targets[0].count`: a file's name looks much like one."""
    names = [re.sub(r"(\[\d+\])*$", "", name) for name in text.split(".")]
    return all(name in _FIELD_NAMES for name in names)


def _unknown_field(name: str) -> str:
    """The rule for a field that a part does not have."""
    if name in _FIELD_NAMES:
        return "is not a known field here (other parts have it)"
    whole = sorted(field for field in _FIELD_NAMES if field.startswith(f"{name}_"))
    close = whole if len(whole) == 1 else [] if whole else difflib.get_close_matches(name, _FIELD_NAMES, n=1)
    return "is not a known field" + (f" (did you mean {close[0]}?)" if close else "")


_RULES = {
    "dataclass_type": "must be a table of fields",
    "model_attributes_type": "must be a table of fields",
    "string_type": "must be text",
    "tuple_type": "must be a list",
}
"""What pydantic says in its own words, by its name of the error."""


def _sentence(error: ErrorDetails, positional: list[str]) -> str:
    """One error of pydantic's report as `field: rule, got value`."""
    place, kind, context = _place(error["loc"], positional), error["type"], error.get("ctx", {})
    rule, value = error["msg"].removeprefix("Value error, "), error["input"]
    if kind in ("missing", "missing_argument"):
        return f"{place}: is required"
    if kind == "union_tag_not_found":
        return f"{place}.kind: is required"
    if kind in ("unexpected_keyword_argument", "extra_forbidden"):
        return f"{place}: {_unknown_field(str(error['loc'][-1]))}"
    if kind == "union_tag_invalid":
        place, rule, value = f"{place}.kind", f"must be one of {context.get('expected_tags')}", context.get("tag")
    if kind == "literal_error":
        rule = f"must be {context.get('expected')}"
    if kind == "too_long":
        rule = f"must hold at most {context.get('max_length')}"
    rule = _RULES.get(kind, rule)
    head = f"{place}: " if place else ""
    if kind == "whole":  # the rule may begin with the field it is about
        return f"{place}.{rule}" if place and _is_place(rule.partition(": ")[0]) else head + rule
    return f"{head}{rule}, got {_shown(value)}"


def _shown(value: Any) -> str:
    try:
        shown = " ".join(repr(value).split())  # arrays print over several lines
    except RecursionError:
        return f"a {type(value).__name__}"
    return shown if len(shown) <= 60 else shown[:57] + "..."


def input_error(error: ValidationError, where: str, positional: list[str] | None = None) -> InputError:
    """Turn pydantic's report into one line: `where: field: rule, got value`, several joined by semicolons."""
    details = error.errors(include_url=False)
    if any(e["type"].startswith("recursion") for e in details):
        return InputError(f"{where}: {TOO_DEEP}")
    sentences = [_sentence(e, positional or []) for e in details[:4]]
    more = f" (and {len(details) - 4} more)" if len(details) > 4 else ""
    return InputError(f"{where}: " + "; ".join(sentences) + more)


# Names seen by @part: tags to leave out of paths, and fields to suggest for a misspelt one.
_KINDS: set[str] = set()
_FIELD_NAMES: set[str] = set()


@dataclass_transform(frozen_default=True, field_specifiers=(Field,))
def part(cls: type[T]) -> type[T]:
    """Make cls a frozen dataclass that validates its fields and raises InputError with one clear line."""
    decorated: Any = pydantic_dataclass(frozen=True, config=CONFIG)(cls)
    names = list(decorated.__dataclass_fields__)
    _FIELD_NAMES.update(names)
    kind = getattr(cls, "kind", None)
    if isinstance(kind, str):
        _KINDS.add(kind)
    _raise_input_errors(decorated, names)
    return decorated  # type: ignore[no-any-return]


def complete(cls: type[Any], **later: Any) -> None:
    """Make a part usable whose annotations name types defined after it; `later` holds them by name."""
    rebuild_dataclass(cls, force=True, raise_errors=True, _types_namespace=later)
    _raise_input_errors(cls, list(cls.__dataclass_fields__))


def _raise_input_errors(decorated: Any, names: list[str]) -> None:
    """Let the constructor raise InputError where pydantic's raises ValidationError."""
    validated_init = decorated.__init__

    @functools.wraps(validated_init)
    def __init__(self: Any, *args: Any, **kwargs: Any) -> None:
        try:
            validated_init(self, *args, **kwargs)
        except ValidationError as error:
            raise input_error(error, decorated.__name__, names) from None
        except RecursionError:
            raise InputError(f"{decorated.__name__}: {TOO_DEEP}") from None

    decorated.__init__ = __init__
