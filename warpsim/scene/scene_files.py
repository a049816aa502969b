"""Scene files: TOML and JSON, and the shipped presets."""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

from warpsim.config.fields import FUNCTION
from warpsim.config.model import TOO_DEEP
from warpsim.errors import InputError
from warpsim.files import absolute_path, whole_file
from warpsim.scene.environment import BUILT_IN_CATALOGS

DEEPEST = 60
"""Levels of lists and tables within each other in a scene; mixtures of mixtures may go down 20 levels."""

WIDTH = 116
"""Characters up to which a table within a table is written on one line."""


def presets() -> list[str]:
    """Names of the shipped scenes."""
    folder = resources.files("warpsim.scene") / "presets"
    return sorted(Path(item.name).stem for item in folder.iterdir() if item.name.endswith(".toml"))


def read_scene_data(source: str | os.PathLike[str]) -> dict[str, Any]:
    """The nested dicts of a preset or a scene file."""
    text = os.fspath(source)
    if text in presets():
        return tomllib.loads((resources.files("warpsim.scene") / "presets" / f"{text}.toml").read_text("utf-8"))
    path = Path(text)
    if path.suffix not in (".toml", ".json"):
        raise InputError(f"must be a preset ({', '.join(presets())}) or a .toml or .json file").of(text)
    try:
        content = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
        raise InputError(f"cannot be read: {reason}").of(text) from None
    try:
        data = tomllib.loads(content) if path.suffix == ".toml" else json.loads(content)
    except (tomllib.TOMLDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"{error}", f"is not valid {path.suffix[1:].upper()}").of(text) from None
    except RecursionError:
        raise InputError(f"{TOO_DEEP}").of(text) from None
    if not isinstance(data, dict):
        raise InputError(f"must hold a table of fields, got {type(data).__name__}").of(text)
    check_depth(data, text)
    return {key: _with_plain_times(value) for key, value in data.items()}


def check_depth(data: Any, where: str) -> None:
    """Check that lists and dicts are not nested deeper than any scene needs, level by level."""
    level = [data] if isinstance(data, dict | list | tuple) else []
    for _ in range(DEEPEST):
        values = (value.values() if isinstance(value, dict) else value for value in level)
        level = [item for items in values for item in items if isinstance(item, dict | list | tuple)]
        if not level:
            return
    raise InputError(f"{TOO_DEEP}, more than {DEEPEST} lists and tables within each other").of(where)


def write_scene_data(data: dict[str, Any], path: str | os.PathLike[str]) -> None:
    """Write a scene's nested dicts; the file appears whole or not at all."""
    target = Path(path)
    if target.suffix not in (".toml", ".json"):
        raise InputError("must end in .toml or .json").of(target)
    text = to_toml(data) if target.suffix == ".toml" else json.dumps(data, indent=2) + "\n"
    try:
        with whole_file(target) as partial:
            partial.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}").of(target) from None


PATH_KEYS = {"file", "files", "psf_file", "sky_map", "image", "maps_file"}
"""Fields of scenes whose values are paths of files."""


def with_absolute_paths(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Nested dicts in which paths relative to a folder become absolute.

    Paths are the values of PATH_KEYS (one, or a table by band) anywhere, and `sky.catalog` where it is none of the
    built-in ones.
    """

    def absolute(path: Any) -> Any:
        is_path = isinstance(path, str) and path and not path.startswith(FUNCTION)
        return str(folder.absolute() / path) if is_path else path

    return _with_paths(data, absolute)


def with_relative_paths(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Nested dicts in which absolute paths in a folder, or below it, become relative to it.

    with_absolute_paths() undoes it.
    """
    home = absolute_path(str(folder))

    def relative(path: str) -> str:
        if not Path(path).is_relative_to(home):
            return path
        rest = str(Path(path).relative_to(home))
        if ".." in Path(rest).parts:
            return path
        return f"./{rest}" if rest in BUILT_IN_CATALOGS else rest

    return _with_paths(data, relative)


def _with_paths(data: dict[str, Any], change: Callable[[Any], Any]) -> dict[str, Any]:
    """Nested dicts with each path changed."""
    data = _changed(data, change, PATH_KEYS)
    sky = data.get("sky")
    if isinstance(sky, dict) and sky.get("catalog", "default") not in BUILT_IN_CATALOGS:
        data = {**data, "sky": {**sky, "catalog": change(sky["catalog"])}}
    return data


def _changed(value: Any, change: Callable[[Any], Any], keys: set[str]) -> Any:
    """Nested dicts and lists with what stands under some keys changed: one value, a list, or a table by band."""
    if isinstance(value, list):
        return [_changed(item, change, keys) for item in value]
    if not isinstance(value, dict):
        return value
    result = {}
    for name, item in value.items():
        if name not in keys:
            result[name] = _changed(item, change, keys)
        elif isinstance(item, dict) and name == "psf_file":
            result[name] = {band: change(path) for band, path in item.items()}
        else:
            result[name] = [change(path) for path in item] if isinstance(item, list) else change(item)
    return result


def named_files(value: Any) -> list[str]:
    """All paths under PATH_KEYS in nested dicts, once each, in order; but for maps: each sensor has its own."""
    found: list[Any] = []
    _changed(value, found.append, PATH_KEYS - {"maps_file"})
    return list(dict.fromkeys(path for path in found if isinstance(path, str) and not path.startswith(FUNCTION)))


def to_toml(data: dict[str, Any]) -> str:
    """TOML text of nested dicts, lists, strings, numbers and booleans.

    Tables of the first level have a heading each; deeper ones too where they do not fit on one line.
    """
    return "\n".join(_table_lines(data, "")) + "\n"


def _table_lines(table: dict[str, Any], heading: str) -> list[str]:
    """Lines of one table: first its single-line values, then its tables."""

    def fits(key: str, value: Any) -> bool:
        return bool(heading) and len(key) + len(_toml_value(value)) <= WIDTH

    parts = {key: value for key, value in table.items() if _is_table(value) and not fits(key, value)}
    lines = [f"{_toml_key(key)} = {_toml_value(value)}" for key, value in table.items() if key not in parts]
    for key, value in parts.items():
        name = f"{heading}.{_toml_key(key)}" if heading else _toml_key(key)
        if isinstance(value, dict):
            lines += ["", f"[{name}]", *_table_lines(value, name)]
        else:
            lines += [line for item in value for line in ("", f"[[{name}]]", *_table_lines(item, name))]
    return lines


def _is_table(value: Any) -> bool:
    """True for what becomes a [table], or a list that becomes [[tables]]."""
    if isinstance(value, list):
        return bool(value) and all(isinstance(item, dict) for item in value)
    return isinstance(value, dict)


def _toml_key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _toml_value(key)


def _toml_value(value: Any) -> str:
    if isinstance(value, dict):
        if not value:
            return "{}"
        return "{ " + ", ".join(f"{_toml_key(key)} = {_toml_value(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml_value(item) for item in value) + "]"
    if isinstance(value, str):
        # JSON strings are TOML basic strings, except that TOML forbids a bare DEL.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value)  # repr is the shortest text that reads back to the same float
    return str(value)


def _with_plain_times(value: Any) -> Any:
    """TOML date-times as ISO text: an epoch may be written with or without quotes."""
    if isinstance(value, dict):
        return {key: _with_plain_times(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_with_plain_times(item) for item in value]
    if hasattr(value, "isoformat"):
        return str(value.isoformat()).replace("+00:00", "")
    return value
