"""Scene files: TOML and JSON, and the shipped presets."""

from __future__ import annotations

import contextlib
import json
import os
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

from warpsim.errors import InputError
from warpsim.scene.parts import BUILT_IN_CATALOGS


def presets() -> list[str]:
    """Names of the shipped scenes."""
    folder = resources.files("warpsim.scene") / "presets"
    return sorted(Path(item.name).stem for item in folder.iterdir() if item.name.endswith(".toml"))


def read_scene_data(source: str | os.PathLike[str]) -> dict[str, Any]:
    """The nested dicts of a preset or a scene file.

    Raises:
        InputError: No such preset or file, or its text is not TOML or JSON.
    """
    text = os.fspath(source)
    if text in presets():
        return tomllib.loads((resources.files("warpsim.scene") / "presets" / f"{text}.toml").read_text("utf-8"))
    path = Path(text)
    if path.suffix not in (".toml", ".json"):
        raise InputError(f"{text}: must be a preset ({', '.join(presets())}) or a .toml or .json file")
    try:
        content = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
        raise InputError(f"{text}: cannot be read: {reason}") from None
    try:
        data = tomllib.loads(content) if path.suffix == ".toml" else json.loads(content)
    except (tomllib.TOMLDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"{text}: is not valid {path.suffix[1:].upper()}: {error}") from None
    if not isinstance(data, dict):
        raise InputError(f"{text}: must hold a table of fields, got {type(data).__name__}")
    return {key: _with_plain_times(value) for key, value in data.items()}


def write_scene_data(data: dict[str, Any], path: str | os.PathLike[str]) -> None:
    """Write a scene's nested dicts; the file appears whole or not at all.

    Raises:
        InputError: The path cannot be written or has another ending.
    """
    target = Path(path)
    if target.suffix not in (".toml", ".json"):
        raise InputError(f"{target}: must end in .toml or .json")
    text = to_toml(data) if target.suffix == ".toml" else json.dumps(data, indent=2) + "\n"
    partial = target.with_name(f".{target.name}.partial")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(target)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror}") from None
    finally:
        with contextlib.suppress(OSError):
            partial.unlink()


def with_absolute_paths(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Nested dicts in which relative paths are taken from a folder, whatever the current one is.

    Paths are the values of `file` and `files` anywhere, and `sky.catalog` where it is none of the built-in ones.
    """

    def absolute(path: Any) -> Any:
        return str(folder.absolute() / path) if isinstance(path, str) else path

    def walk(value: Any) -> Any:
        if isinstance(value, list):
            return [walk(item) for item in value]
        if not isinstance(value, dict):
            return value
        result = {name: walk(item) for name, item in value.items()}
        if "file" in value:
            result["file"] = absolute(value["file"])
        if isinstance(value.get("files"), list):
            result["files"] = [absolute(path) for path in value["files"]]
        elif "files" in value:
            result["files"] = absolute(value["files"])
        return result

    data = walk(data)
    sky = data.get("sky")
    if isinstance(sky, dict) and sky.get("catalog", "default") not in BUILT_IN_CATALOGS:
        data = {**data, "sky": {**sky, "catalog": absolute(sky["catalog"])}}
    return data


def named_files(value: Any) -> list[str]:
    """All paths under `file` and `files` in nested dicts, once each, in order."""
    if isinstance(value, list):
        paths = [path for item in value for path in named_files(item)]
    elif isinstance(value, dict):
        own = [value["file"]] if isinstance(value.get("file"), str) else []
        own += [path for path in value.get("files", ()) if isinstance(path, str)]
        paths = [*own, *(path for item in value.values() for path in named_files(item))]
    else:
        paths = []
    return list(dict.fromkeys(paths))


def to_toml(data: dict[str, Any]) -> str:
    """TOML text of nested dicts, lists, strings, numbers and booleans.

    Tables inside lists of tables are written inline, so that each target stays together.
    """
    lines = [f"{key} = {_toml_value(value)}" for key, value in data.items() if not _is_table(value)]
    for key, value in data.items():
        if isinstance(value, dict):
            lines += ["", f"[{key}]", *(f"{name} = {_toml_value(item)}" for name, item in value.items())]
        elif _is_table(value):
            for table in value:
                lines += ["", f"[[{key}]]", *(f"{name} = {_toml_value(item)}" for name, item in table.items())]
    return "\n".join(lines) + "\n"


def _is_table(value: Any) -> bool:
    """True for what becomes a [table], or a list that becomes [[tables]]."""
    if isinstance(value, list):
        return bool(value) and all(isinstance(item, dict) for item in value)
    return isinstance(value, dict)


def _toml_value(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml_value(item)}" for key, item in value.items()) + " }"
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
