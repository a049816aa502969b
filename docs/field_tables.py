"""Tables that Sphinx makes of the program: fields of config models, commands and options of the command line.

Names, units, rules and defaults are those that the program checks; words are those beside the field in the code.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import itertools
import json
import re
import textwrap
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import TypeAdapter

from warpsim.config import fields

NAMED_RULES = {fields._file_name: "letters, digits, `_ . -`", fields.whole_path: "path"}
UNITS = {"pix": "px", "electron": "e", "electron / s": "e/s"}
PLAIN_TYPES = {str: "text", int: "whole number", float: "", bool: "true or false", type(None): ""}


@dataclass(frozen=True)
class FieldRow:
    """A field of one or several config models, as a table shows it."""

    name: str
    unit: str
    rule: str
    default: str
    meaning: str


def is_model(annotation: Any) -> bool:
    """Return whether an annotation is a config model."""
    return hasattr(annotation, "__pydantic_fields__")


def meanings(model: type[Any]) -> dict[str, str]:
    """Return what the docstrings of a config model and of its bases say of each field: under it, or under `Args:`."""
    found = {}
    for cls in reversed([cls for cls in model.__mro__ if cls.__module__.startswith("warpsim.")]):
        arguments = re.search(r"^Args:\n((?:    .*\n?|\n)*)", inspect.getdoc(cls) or "", re.MULTILINE)
        entries = re.findall(r"^    (\w+): (.*(?:\n        .*)*)", arguments[1] if arguments else "", re.MULTILINE)
        body = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0].body
        for field, text in itertools.pairwise(body):
            match field, text:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(words))):
                    entries.append((name, words))
        found |= {name: " ".join(words.split()) for name, words in entries}
    return found


def rule_of(annotation: Any, metadata: tuple[Any, ...] = ()) -> str:
    """Return the rule of a field's type in words; empty for any number."""
    origin, parts = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return rule_of(parts[0], (*parts[1:], *metadata))
    functions = [getattr(item, "func", None) for item in metadata]
    named = [NAMED_RULES[function] for function in functions if function in NAMED_RULES]
    intervals = [function for function in functions if isinstance(function, fields.Interval)]
    if named:
        return named[-1]
    if intervals:
        low, open_low = max((interval.low, interval.open_low) for interval in intervals)
        high, closed = min((interval.high, not interval.open_high) for interval in intervals)
        return str(fields.Interval(low, high, open_low, not closed))
    if is_model(annotation):
        return "table"
    if origin is typing.Literal:
        return ", ".join(json.dumps(value) for value in parts)
    if origin in (typing.Union, types.UnionType):
        kinds = [part for part in parts if part is not type(None)]
        if any(typing.get_origin(part) is Mapping for part in kinds):
            return f"one {'number' if float in kinds else 'file'}, or a table by band"
        return ", or ".join(dict.fromkeys(filter(None, map(rule_of, kinds))))
    if origin is tuple:
        items = [rule_of(part).removeprefix("in ") or "number" for part in parts if part is not Ellipsis]
        return f"list: {items[0]}" if Ellipsis in parts else f"[{', '.join(items)}]"
    if origin in (dict, Mapping):
        return "table by name"
    return PLAIN_TYPES.get(annotation, "")


def default_of(info: Any) -> str:
    """Return the default of a pydantic field, as a scene file would give it; "-" where it may be left out."""
    if info.is_required():
        return "required"
    value = info.get_default(call_default_factory=True)
    plain = TypeAdapter(Any).dump_python(value, mode="json") if not isinstance(value, Mapping) else None
    if isinstance(plain, dict) or plain in (None, [], ""):
        return "-"
    return "defaults" if isinstance(plain, list) and isinstance(plain[0], dict) else json.dumps(plain)


def models_within(annotation: Any, found: dict[str, type[Any]] | None = None) -> dict[str, type[Any]]:
    """Return the config models that an annotation names, and those that their fields name, by name."""
    found = {} if found is None else found
    if not is_model(annotation):
        for part in typing.get_args(annotation):
            models_within(part, found)
    elif annotation.__name__ not in found:
        found[annotation.__name__] = annotation
        for info in annotation.__pydantic_fields__.values():
            models_within(info.annotation, found)
    return found


def field_rows(models: list[type[Any]]) -> list[FieldRow]:
    """Return the fields of config models: their kinds first, and one that several have alike once."""
    rows: list[FieldRow] = []
    kinds = [info["kind"].annotation for info in (model.__pydantic_fields__ for model in models) if "kind" in info]
    if kinds:
        rows.append(FieldRow("kind", "", ", ".join(map(rule_of, kinds)), "", ""))
    for model in models:
        words = meanings(model)
        for name, info in model.__pydantic_fields__.items():
            meaning, unit = (
                words.get(name, info.description or ""),
                UNITS.get(fields.unit_of(name), fields.unit_of(name)),
            )
            if stated := re.search(r" \[([\w /()]+)\]", meaning):
                unit, meaning = stated[1], meaning.replace(stated[0], "", 1)
            rule = rule_of(info.annotation, tuple(info.metadata))
            row = FieldRow(info.alias or name, unit, rule, default_of(info), meaning)
            if name != "kind" and row not in rows:
                rows.append(row)
    return rows


def field_table(models: list[type[Any]]) -> list[str]:
    """Return the table of the fields of config models in Markdown."""
    lines = ["| field | unit | rule | default | meaning |", "|---|---|---|---|---|"]
    for row in field_rows(models):
        default = row.default if row.default in ("required", "-", "") else f"`{row.default}`"
        lines.append(plain(f"| `{row.name}` | {row.unit} | {row.rule} | {default} | {row.meaning} |"))
    return lines


def plain(line: str) -> str:
    """Return a line of Markdown whose stars outside of code are stars."""
    return re.sub(r"(`[^`]*`)|\*", lambda found: found[1] or r"\*", line)


def commands() -> dict[str, tuple[str, argparse.ArgumentParser]]:
    """Return the commands of the command line: what each does, and its parser."""
    from warpsim.cli import make_parser

    (found,) = (action for action in make_parser()._actions if isinstance(action, argparse._SubParsersAction))
    return {action.dest: (action.help or "", found.choices[action.dest]) for action in found._choices_actions}


def command_table(name: str) -> list[str]:
    """Return the table of the options of a command in Markdown."""
    does, parser = commands()[name]
    lines = [f"`{' '.join(parser.format_usage().split()[1:])}`", "", f"{does[0].upper()}{does[1:]}.", ""]
    lines += ["| argument | meaning |", "|---|---|"]
    for action in parser._actions:
        if not isinstance(action, argparse._HelpAction):
            words = ", ".join(f"`{word}`" for word in action.option_strings or [action.metavar or action.dest.upper()])
            value = f" {action.metavar or action.dest.upper()}" if action.option_strings and action.nargs != 0 else ""
            lines.append(plain(f"| {words}{value} | {action.help} |"))
    return lines


def connect(app: Any) -> None:
    """Add the directives `config-fields` and `command-options`, whose content names config models and commands."""
    from sphinx.util.docutils import SphinxDirective

    from warpsim.scene.scene import Scene

    models = models_within(Scene)

    class ConfigFields(SphinxDirective):
        has_content = True

        def run(self) -> list[Any]:
            return self.parse_text_to_nodes("\n".join(field_table([models[name] for name in self.content])))

    class CommandOptions(SphinxDirective):
        has_content = True

        def run(self) -> list[Any]:
            return self.parse_text_to_nodes("\n".join(line for name in self.content for line in command_table(name)))

    app.add_directive("config-fields", ConfigFields)
    app.add_directive("command-options", CommandOptions)
