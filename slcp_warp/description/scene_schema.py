"""What a scene file may contain, read off the scene's classes: one description for the reader, its errors and
the JSON schema that editors use.
"""

import collections.abc
import dataclasses
import json
import types
import typing
from typing import Any

from .box_files import BOX, FIELDS, NEEDED
from .parts import JOINTS, KINDS, Actuator, Body, Contact, Shape, Spring, Tendon
from .scene import Scene

FORMAT, VERSION = "slcp-scene", 3
VERSIONS = (1, 2, 3)  # that are read; in 1 damping was explicit, in 1 and 2 stiffness
CHOICES: dict[tuple[str, str], tuple[Any, ...]] = {
    ("Body", "joint"): tuple(JOINTS),
    ("Shape", "kind"): KINDS,
}
NO_VALUE = "none"  # stands for "no value" in a list, where TOML has no null


def file_fields(kind: type) -> dict[str, tuple[Any, bool]]:
    """Fields of a scene class as a file has them: name -> (type, required)."""
    hints = typing.get_type_hints(kind)
    out = {}
    for field in dataclasses.fields(kind):
        if field.init:
            hint = hints[field.name]
            optional = type(None) in typing.get_args(hint)
            given = (field.default, field.default_factory) != (dataclasses.MISSING, dataclasses.MISSING)
            out[field.name] = (hint, not given and not optional)
    return out


def is_union(hint: Any) -> bool:
    """Whether a type is one of several, however that is written."""
    return typing.get_origin(hint) in (types.UnionType, typing.Union)


def json_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of a scene file."""
    scene = object_schema(Scene)
    scene["properties"] = {
        "$schema": {"type": "string"},
        "format": {"const": FORMAT},
        "version": {"enum": list(VERSIONS)},
        **scene["properties"],
    }
    scene["required"] = ["format", "version", *scene["required"]]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"{FORMAT} {VERSION}",
        **scene,
        "$defs": part_schemas(),
    }


def part_schemas() -> dict[str, Any]:
    """The schemas of a scene's parts, by the names of their classes; a box is none, but shapes of a file."""
    parts = {kind.__name__: object_schema(kind) for kind in (Body, Shape, Contact, Actuator, Spring, Tendon)}
    return parts | {"Box": _box_schema()}


def _box_schema() -> dict[str, Any]:
    number: dict[str, Any] = {"type": "number"}
    fields: dict[str, Any] = dict.fromkeys(FIELDS, number)
    fields |= {"kind": {"const": BOX}, "name": {"type": "string"}, "sides": {"type": "boolean"}}
    fields |= {"body": {"anyOf": [{"type": "string"}, {"type": "null"}]}}
    fields |= {"offset": {"type": "array", "items": number, "minItems": 2, "maxItems": 2}}
    return {
        "type": "object",
        "description": "The corners of a box, and its sides.",
        "properties": fields,
        "required": list(NEEDED),
        "additionalProperties": False,
    }


def object_schema(kind: type, choices: dict[str, tuple[Any, ...]] | None = None) -> dict[str, Any]:
    """The schema of a class's fields; `choices`: the values that fields may have."""
    fields = file_fields(kind)
    properties = {name: _type(kind.__name__, name, hint) for name, (hint, _) in fields.items()}
    properties |= {name: {"enum": list(values)} for name, values in (choices or {}).items()}
    return {
        "type": "object",
        "description": " ".join((kind.__doc__ or "").split("\n\n")[0].split()),
        "properties": properties,
        "required": [name for name, (_, required) in fields.items() if required],
        "additionalProperties": False,
    }


def _type(owner: str, name: str, hint: Any, in_list: bool = False) -> dict[str, Any]:
    if hint is Shape:
        return {"anyOf": [{"$ref": "#/$defs/Shape"}, {"$ref": "#/$defs/Box"}]}
    if (owner, name) in CHOICES:
        return {"enum": list(CHOICES[owner, name])}
    if dataclasses.is_dataclass(hint):
        return {"$ref": f"#/$defs/{hint.__name__}"}  # type: ignore[union-attr]
    if hint is type(None):
        return {"enum": [None, NO_VALUE]} if in_list else {"type": "null"}
    simple = {str: "string", int: "integer", float: "number", bool: "boolean"}
    if hint in simple:
        return {"type": simple[hint]}
    arguments = typing.get_args(hint)
    if typing.get_origin(hint) is collections.abc.Mapping:
        return {"type": "object", "additionalProperties": _type(owner, name, arguments[1])}
    if typing.get_origin(hint) is typing.Literal:
        return {"enum": list(arguments)}
    if is_union(hint):
        return {"anyOf": [_type(owner, name, argument, in_list) for argument in arguments]}
    if arguments[-1] is Ellipsis:
        return {"type": "array", "items": _type(owner, name, arguments[0], True)}
    items = [_type(owner, name, argument, True) for argument in arguments]
    return {"type": "array", "items": items[0], "minItems": len(items), "maxItems": len(items)}


# python -m slcp_warp.description.scene_schema > slcp_warp/description/scene_schema.json
if __name__ == "__main__":
    print(json.dumps(json_schema(), indent=2))
