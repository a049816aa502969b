"""Config models: frozen dataclasses that check every value on construction.

`@config_model` turns a class body of annotated fields into one; the field types of `config.fields` carry the rules. A
bad value raises `InputError`, whose text is one line: path, rule, value. A rule over several fields is a validator
that raises `InputError` itself, with the path of the field that it is about.
"""

from __future__ import annotations

import difflib
import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar, dataclass_transform

from pydantic import ConfigDict, Field, Tag, TypeAdapter, ValidationError, model_validator
from pydantic.dataclasses import dataclass as pydantic_dataclass
from pydantic.dataclasses import rebuild_dataclass
from pydantic_core import ErrorDetails

from warpsim.errors import NO_VALUE, InputError

T = TypeVar("T")

CONFIG = ConfigDict(extra="forbid", arbitrary_types_allowed=True, populate_by_name=True)

TOO_DEEP = "is nested too deeply"
"""Rule for parts nested too deeply."""

MOST_ERRORS = 4
"""Most errors shown in one report."""

Location = tuple[int | str, ...]
"""Where pydantic found an error: fields, items of lists, tags of unions."""

# Names seen by config_model: tags to leave out of paths, and fields to suggest for a misspelt one.
_KINDS: set[str] = set()
_FIELD_NAMES: set[str] = set()


@dataclass_transform(frozen_default=True, field_specifiers=(Field,))
def config_model(cls: type[T]) -> type[T]:
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
    """Make a config model usable whose annotations name types defined after it; `later` holds them by name."""
    rebuild_dataclass(cls, force=True, raise_errors=True, _types_namespace=later)
    _raise_input_errors(cls, list(cls.__dataclass_fields__))


def exactly_one(part: object, *names: str) -> None:
    """Check that a config model has exactly one of some fields; InputError otherwise."""
    if sum(getattr(part, name) is not None for name in names) != 1:
        raise InputError("exactly one must be given", ", ".join(names))


def one_of(*names: str) -> Any:
    """Return the validator of a config model that has exactly one of some fields."""

    def check(part: Any) -> Any:
        exactly_one(part, *names)
        return part

    return model_validator(mode="after")(check)


def parts_with_files(part: Any) -> Iterator[tuple[Any, list[str]]]:
    """Yield the config models in a config model, or in a tuple of some, that name files, with the paths of these."""
    if isinstance(part, tuple):
        for item in part:
            yield from parts_with_files(item)
    elif is_dataclass(part):
        if paths := [path for path in (getattr(part, "file", None), *(getattr(part, "files", None) or ())) if path]:
            yield part, paths
        for field in fields(part):
            yield from parts_with_files(getattr(part, field.name))


def choice(tag: str) -> Tag:
    """Return the tag of a member of a union that has no kinds; field paths in messages leave it out."""
    _KINDS.add(tag)
    return Tag(tag)


def input_error(
    report: ValidationError, positional: Sequence[str] = (), shorten: Callable[[Location], Location] | None = None
) -> InputError:
    """Return pydantic's report as one error of one line; several errors are joined by semicolons.

    Args:
        report: What pydantic raised.
        positional: Names of the fields that were given by position.
        shorten: Leaves out of a path what the user's short form of the input does not have.
    """
    details = report.errors(include_url=False)
    if any(detail["type"].startswith("recursion") for detail in details):
        return InputError(TOO_DEEP)
    errors = [_one_error(detail, positional, shorten or (lambda path: path)) for detail in details[:MOST_ERRORS]]
    return errors[0] if len(details) == 1 else InputError.several(errors, len(details) - len(errors))


_RULES = {
    "dataclass_type": "must be a table of fields",
    "model_attributes_type": "must be a table of fields",
    "string_type": "must be text",
    "tuple_type": "must be a list",
}
"""Rules in warpsim's words, by pydantic's type of error."""


def _one_error(detail: ErrorDetails, positional: Sequence[str], shorten: Callable[[Location], Location]) -> InputError:
    """One error of pydantic's report."""
    path, kind, context = _path(detail["loc"], positional, shorten), detail["type"], detail.get("ctx", {})
    rule, value = detail["msg"], detail["input"]
    raised = context.get("error")
    if isinstance(raised, InputError):
        return raised.within(path)
    if kind in ("missing", "missing_argument"):
        rule, value = "is required", NO_VALUE
    elif kind == "union_tag_not_found":
        path, rule, value = f"{path}.kind" if path else "kind", "is required", NO_VALUE
    elif kind in ("unexpected_keyword_argument", "extra_forbidden"):
        name, value = str(detail["loc"][-1]), NO_VALUE
        rule = f"is not a known field{' here (other parts have it)' if name in _FIELD_NAMES else nearest_field(name)}"
    elif kind == "union_tag_invalid":
        path, rule, value = f"{path}.kind", f"must be one of {context.get('expected_tags')}", context.get("tag")
    elif kind == "literal_error":
        rule = f"must be {context.get('expected')}"
    elif kind == "too_long":
        rule = f"must hold at most {context.get('max_length')}"
    return InputError(_RULES.get(kind, rule), path, value)


def _path(location: Location, positional: Sequence[str], shorten: Callable[[Location], Location]) -> str:
    """Return `targets[2].shape.radius_m`; the tags that unions put into the path are left out."""
    if location and isinstance(location[0], int) and location[0] < len(positional):
        location = (positional[location[0]], *location[1:])
    kept: list[int | str] = []
    after_tag = True  # a tag follows the union's own path, and is followed by a field, which may be spelled like one
    for item in location:
        after_tag = not after_tag and item in _KINDS
        if not after_tag:
            kept.append(item)
    text = ""
    for item in shorten(tuple(kept)):
        text += f"[{item}]" if isinstance(item, int) else f".{item}" if text else item
    return text


def nearest_field(name: str) -> str:
    """Return " (did you mean NAME?)" of a misspelt field; empty for a known one, and where none is near."""
    whole = sorted(field for field in _FIELD_NAMES if field.startswith(f"{name}_"))
    close = whole if len(whole) == 1 else [] if whole else difflib.get_close_matches(name, _FIELD_NAMES, n=1)
    return f" (did you mean {close[0]}?)" if close and name not in _FIELD_NAMES else ""


def _raise_input_errors(decorated: Any, names: list[str]) -> None:
    """Let the constructor raise InputError where pydantic's raises ValidationError."""
    validated_init = decorated.__init__

    @functools.wraps(validated_init)
    def __init__(self: Any, *args: Any, **kwargs: Any) -> None:
        try:
            validated_init(self, *args, **kwargs)
        except ValidationError as error:
            shorten = getattr(decorated, "shortened_path", None)
            raise input_error(error, names, shorten and shorten(kwargs)).of(decorated.__name__) from None
        except RecursionError:
            raise InputError(TOO_DEEP).of(decorated.__name__) from None

    decorated.__init__ = __init__


_ADAPTERS: dict[type[Any], TypeAdapter[Any]] = {}


def adapter(kind: type[Any]) -> TypeAdapter[Any]:
    """Return the validator of a kind of config model; cached, as it is slow to make."""
    if kind not in _ADAPTERS:
        _ADAPTERS[kind] = TypeAdapter(kind)
    return _ADAPTERS[kind]
