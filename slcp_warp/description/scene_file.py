"""Scenes in files: TOML or JSON, `format = "slcp-scene"`, `version = 3`; docs/reference/scene_files.md."""

import dataclasses
import json
import os
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..inputs import checks
from ..inputs.errors import SceneError
from ..storage.files import MOST_TEXT, MOST_TOML, parse_json, parse_toml, read_text, reading, write_text
from ..storage.tables import below, entries, place, table
from .box_files import SceneFileError, Several, with_boxes
from .mjcf import load_mjcf
from .scene import Scene
from .scene_schema import FORMAT, NO_VALUE, VERSION, VERSIONS, file_fields, is_union, json_schema

__all__ = ["SceneFileError", "json_schema", "load_scene", "save_scene"]


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene from a .toml or .json file, or from MJCF (.xml, see `load_mjcf`).

    Raises:
        SceneFileError: not a scene file, too large, another version, a field that is unknown, missing, twice
            or of a wrong type, or fields that do not describe a mechanism.
        FileNotFoundError: no such file.
    """
    path = checks.path("path", path)
    if path.suffix == ".xml":
        return load_mjcf(path)
    with reading(path, "a scene", SceneFileError):
        return scene_of(_parse(path))


def scene_of(content: Any) -> Scene:
    """The scene of a scene file's content, as `scene_content` gives it.

    Raises:
        SceneFileError: as `load_scene`, without a file's name.
    """
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = (
            f"{content.get('format')!r:.60}" if isinstance(content, dict) else f"a {type(content).__name__}"
        )
        raise SceneFileError(f"format is {found}; a scene file has format = {FORMAT!r}")
    version = content.get("version")
    if isinstance(version, bool) or version not in VERSIONS:
        raise SceneFileError(
            f"version is {version!r:.60}; this program reads {', '.join(map(str, VERSIONS))}"
        )
    fields = {k: v for k, v in content.items() if k not in ("format", "version", "$schema")}
    if version == 1:  # when it was written damping was explicit
        fields.setdefault("implicit_damping", False)
    scene: Scene = _build(Scene, with_boxes(fields), "")
    if version < 3 and "implicit_stiffness" not in fields and scene.structure.implicit_stiffness:
        return dataclasses.replace(scene, implicit_stiffness=False)
    return scene


def scene_content(scene: Scene) -> dict[str, Any]:
    """What a scene's file holds, as JSON values."""
    return {"format": FORMAT, "version": VERSION, **_plain(scene)}


def save_scene(scene: Scene, path: str | os.PathLike[str]) -> None:
    """Write a scene to a .json file, exactly: reading it gives an equal scene.

    The file appears whole or not at all.
    """
    checks.instance("scene", scene, Scene, "a slcp_warp.Scene")
    path = checks.path("path", path)
    if path.suffix != ".json":
        raise SceneFileError(
            f"{path}: scenes are written as .json, not as {path.suffix or 'a file without ending'}"
        )
    write_text(path, json.dumps(scene_content(scene), indent=2, allow_nan=False) + "\n")


def _parse(path: Path) -> Any:
    if path.suffix not in (".toml", ".json"):
        raise SceneFileError("a scene is a .toml, .json or .xml (MJCF) file")
    text = read_text(path, MOST_TEXT if path.suffix == ".json" else MOST_TOML)
    try:
        return parse_json(text) if path.suffix == ".json" else parse_toml(text)
    except ValueError as error:  # what both parsers raise
        raise SceneFileError(f"not readable as {path.suffix[1:].upper()}: {error}") from error


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
    fields = file_fields(kind)
    needed = [name for name, (_, required) in fields.items() if required]
    values = table(where, values, fields, needed, SceneFileError)
    arguments = {}
    for field in dataclasses.fields(kind):
        if field.name not in fields:
            continue
        name, (hint, _) = field.name, fields[field.name]
        if name in values:
            arguments[name] = _convert(hint, values[name], below(where, name))
        elif field.default is dataclasses.MISSING:
            arguments[name] = None
    try:
        return kind(**arguments)
    except SceneError as error:
        raise SceneFileError(place(where, str(error))) from error


def _convert(hint: Any, value: Any, where: str) -> Any:
    """A value of the file as the type that a field has; the error says what is needed."""
    if is_union(hint):
        return _convert_union(hint, value, where)
    if dataclasses.is_dataclass(hint):
        return _build(hint, value, where)
    if typing.get_origin(hint) is typing.Literal or hint in (float, int, str, bool):
        return value  # the scene's classes look at it
    if typing.get_origin(hint) is Mapping:
        if not isinstance(value, dict):
            raise SceneFileError(f"{where}: {value!r:.60}; a list is needed, or a table of numbers by name")
        return dict(value)
    items = typing.get_args(hint)
    found = []
    for i, each in enumerate(entries(where, value, SceneFileError)):
        parts = each.parts if isinstance(each, Several) else (each,)
        found += [_convert(items[0], part, f"{where}[{i}]") for part in parts]
    return tuple(found)


def _convert_union(hint: Any, value: Any, where: str) -> Any:
    options = [h for h in typing.get_args(hint) if h is not type(None)]
    if len(options) < len(typing.get_args(hint)) and (
        value is None or value == NO_VALUE and str not in options
    ):
        return None
    lists = [h for h in options if typing.get_origin(h) is tuple]
    if isinstance(value, list) and lists:
        return _convert(lists[0], value, where)
    return _convert(next(h for h in options if h not in lists), value, where)
