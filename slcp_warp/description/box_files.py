"""Boxes in scene files: shapes of kind "box" stand for what `parts.box` makes, and contacts name them."""

import inspect
from dataclasses import dataclass
from typing import Any

from slcp_warp.kernels.structure import WALLS

from ..inputs.errors import SceneError
from ..storage.tables import place, table
from .parts import Shape, box

BOX = "box"
FIELDS = ("kind", *inspect.signature(box).parameters)
NEEDED = ("kind", "name", "width", "height")


class SceneFileError(SceneError):
    """A file that is no scene; the message names the file, the field, what came and what is needed."""


@dataclass(frozen=True)
class Several:
    """The entries of a list that one entry of a file stands for."""

    parts: tuple[dict[str, Any], ...]


def with_boxes(fields: dict[str, Any]) -> dict[str, Any]:
    """The fields of a scene file with what its boxes, and contacts of boxes, stand for.

    Raises:
        SceneFileError: a box that cannot be, or of a shape's name; a contact of two boxes.
    """
    shapes, contacts = fields.get("shapes"), fields.get("contacts")
    if not isinstance(shapes, list):
        return fields
    made = {i: _box(each, f"shapes[{i}]") for i, each in enumerate(shapes) if _is_box(each)}
    if not made:
        return fields
    named = {shapes[i]["name"]: parts for i, parts in made.items()}
    plain = (each for each in shapes if isinstance(each, dict) and not _is_box(each))
    others = {each["name"]: each for each in plain if isinstance(each.get("name"), str)}
    for i in made:
        name = shapes[i]["name"]
        if name in others or sum(shapes[j]["name"] == name for j in made) > 1:
            raise SceneFileError(f"shapes[{i}]: another shape is named {name!r}, too")
    out = dict(fields)
    out["shapes"] = [
        Several(tuple(_plain(s) for s in made[i])) if i in made else each for i, each in enumerate(shapes)
    ]
    if isinstance(contacts, list):
        out["contacts"] = [_contact(each, named, others, f"contacts[{i}]") for i, each in enumerate(contacts)]
    return out


def _is_box(entry: Any) -> bool:
    return isinstance(entry, dict) and entry.get("kind") == BOX


def _box(entry: dict[str, Any], where: str) -> tuple[Shape, ...]:
    given = dict(table(where, entry, FIELDS, NEEDED, SceneFileError))
    given.pop("kind")
    try:
        return box(given.pop("name"), given.pop("body", None), **given)
    except SceneError as error:
        raise SceneFileError(place(where, str(error))) from error


def _plain(shape: Shape) -> dict[str, Any]:
    """A shape as an entry of a file."""
    values = {name: getattr(shape, name) for name in ("name", "body", "kind", "offset", "angle")}
    values |= {name: getattr(shape, name) for name in ("radius", "contype", "conaffinity")}
    return {name: list(each) if isinstance(each, tuple) else each for name, each in values.items()}


def _contact(entry: Any, boxes: dict[str, tuple[Shape, ...]], others: dict[str, Any], where: str) -> Any:
    """A contact; of a box those of its corners, and of its sides where they are of use."""
    if not isinstance(entry, dict):
        return entry
    of = [name for name in ("shape_a", "shape_b") if _named(entry.get(name), boxes)]
    if not of:
        return entry
    if len(of) > 1:
        raise SceneFileError(
            f"{where}: two boxes, {entry['shape_a']!r} and {entry['shape_b']!r}; boxes with sides touch each "
            'other under contacts = "auto"'
        )
    name = entry.get("shape_b" if of[0] == "shape_a" else "shape_a")
    other = others.get(name, {}) if isinstance(name, str) else {}
    wall = other.get("kind") in WALLS  # touched by corners
    parts = [s for s in boxes[entry[of[0]]] if s.kind == "disc" or not wall]
    return Several(tuple(entry | {of[0]: part.name} for part in parts))


def _named(name: Any, boxes: dict[str, tuple[Shape, ...]]) -> bool:
    return isinstance(name, str) and name in boxes
