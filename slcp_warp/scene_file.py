"""Scenes in files: TOML or JSON, versioned (`format = "slcp-scene"`, `version = 1`); docs/scene_files.md."""

import dataclasses
import difflib
import json
import os
import tomllib
import types
import typing
from pathlib import Path
from typing import Any

from .errors import SceneError
from .scene import Scene
from .scene_schema import FORMAT, NO_VALUE, VERSION, file_fields, json_schema

__all__ = ["json_schema", "load_scene", "save_scene"]


class SceneFileError(SceneError):
    """A file that is no scene; the message names the file, the field, what came and what is needed."""


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene from a .toml or .json file, or from MJCF (.xml, see `load_mjcf`).

    Raises:
        SceneFileError: not a scene file, another version, a field that is unknown, missing or of a wrong
            type; SceneError: fields that do not describe a mechanism. FileNotFoundError.
    """
    path = Path(path)
    if path.suffix == ".xml":
        from .mjcf import load_mjcf  # needs mujoco: only where it is asked for

        return load_mjcf(path)
    content = _parse(path)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = repr(content.get("format")) if isinstance(content, dict) else f"a {type(content).__name__}"
        raise SceneFileError(f"{path}: format is {found}; a scene file has format = {FORMAT!r}")
    if content.get("version") != VERSION:
        raise SceneFileError(f"{path}: version is {content.get('version')!r}; this program reads {VERSION}")
    fields = {k: v for k, v in content.items() if k not in ("format", "version", "$schema")}
    scene: Scene = _build(Scene, fields, f"{path}")
    return scene


def save_scene(scene: Scene, path: str | os.PathLike[str]) -> None:
    """Write a scene to a .json file, exactly: reading it gives an equal scene. The file appears whole or not
    at all.
    """
    path = Path(path)
    if path.suffix != ".json":
        raise SceneFileError(
            f"{path}: scenes are written as .json, not as {path.suffix or 'a file without ending'}"
        )
    content = {"format": FORMAT, "version": VERSION, **_plain(scene)}
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    part.replace(path)


def _parse(path: Path) -> Any:
    if path.suffix not in (".toml", ".json"):
        raise SceneFileError(f"{path}: a scene is a .toml, .json or .xml (MJCF) file")
    try:
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".json":
            return json.loads(text)
        return tomllib.loads(text)
    except ValueError as error:  # what both parsers and a wrong encoding raise
        raise SceneFileError(f"{path}: not readable as {path.suffix[1:].upper()}: {error}") from error
    except IsADirectoryError as error:
        raise SceneFileError(f"{path}: a directory; a scene is a file") from error


def _plain(item: Any) -> dict[str, Any]:
    """Fields that differ from their defaults, as plain values."""
    out = {}
    for field in dataclasses.fields(item):
        value = getattr(item, field.name)
        if not field.init or (value == field.default and type(value) is type(field.default)):
            continue
        if isinstance(value, tuple):
            value = [_plain(v) if dataclasses.is_dataclass(v) else v for v in value]
        out[field.name] = value
    return out


def _build(kind: Any, values: Any, where: str) -> Any:
    """An instance of a scene class from a table of the file."""
    if not isinstance(values, dict):
        raise SceneFileError(f"{where}: {values!r:.60}; a table of fields is needed")
    fields = file_fields(kind)
    for name in values:
        if name not in fields:
            near = difflib.get_close_matches(name, fields, 1)
            hint = f"; did you mean {near[0]!r}?" if near else f"; there are {', '.join(fields)}"
            raise SceneFileError(f"{where}: no field {name!r}{hint}")
    arguments = {}
    for field in dataclasses.fields(kind):
        if field.name not in fields:
            continue
        name, (hint, required) = field.name, fields[field.name]
        if name in values:
            arguments[name] = _convert(hint, values[name], f"{where}, {name}")
        elif required:
            raise SceneFileError(f"{where}: {name} is missing")
        elif field.default is dataclasses.MISSING:
            arguments[name] = None
    try:
        return kind(**arguments)
    except SceneError as error:
        raise SceneFileError(f"{where}: {error}") from error


def _convert(hint: Any, value: Any, where: str) -> Any:
    """A value of the file as the type that a field has; the error says what is needed."""
    if isinstance(hint, types.UnionType):
        return _convert_union(hint, value, where)
    if dataclasses.is_dataclass(hint):
        return _build(hint, value, where)
    if hint in (float, int, str, bool):  # the scene's classes look at them
        return value
    items = typing.get_args(hint)
    if not isinstance(value, list):
        raise SceneFileError(f"{where}: {value!r:.60}; a list is needed")
    return tuple(_convert(items[0], v, f"{where}[{i}]") for i, v in enumerate(value))


def _convert_union(hint: Any, value: Any, where: str) -> Any:
    options = [h for h in typing.get_args(hint) if h is not type(None)]
    if len(options) < len(typing.get_args(hint)) and (
        value is None or value == NO_VALUE and str not in options
    ):
        return None
    lists = [h for h in options if typing.get_args(h)]
    if isinstance(value, list) and lists:
        return _convert(lists[0], value, where)
    return _convert(next(h for h in options if h not in lists), value, where)
