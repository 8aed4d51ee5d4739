"""Columns of the table of parameters by the names of their parts: "block.mass", "hand.com_x"."""

import difflib
from collections.abc import Iterable

import numpy as np

from slcp_warp.kernels.structure import layout

from ..inputs.errors import ArgumentError
from .acting import OF_PAIRS, parts_of
from .names import END, between, some, turned
from .scene import Scene

COMPONENTS = {
    f"{name}_{axis}": (name, i) for name in ("com", "anchor", "shape_offset") for i, axis in enumerate("xy")
} | {f"radius_{i}": ("radius", i) for i in range(2)}


def parameter_of(key: str) -> tuple[str, str, int | None]:
    """Part ("": all), parameter and component (None: all) of a name such as "hand.shape_offset_x"."""
    part, _, name = key.rpartition(".")
    return part, *COMPONENTS.get(name, (name, None))


def places_of(scene: Scene, key: str, label: str) -> list[int]:
    """Columns of a parameter: of all parts, "mass", of one, "block.mass", of a component, "hand.com_x"; of
    friction and restitution also those of all pairs between two bodies or shapes, "ground/box.friction", or
    of one, "box.friction".

    Raises:
        ArgumentError: there are none; `label` is who names it.
    """
    part, name, component = parameter_of(key)
    found = [(start, shape) for column, start, shape in layout(scene.structure).columns if column == name]
    if not found or not np.prod(found[0][1], dtype=int):
        raise ArgumentError(f"{label} names {key!r}; scene {scene.name!r} has no {name}")
    start, shape = found[0]
    size = int(np.prod(shape, dtype=int))
    width, exact, parts = size // (shape[0] if shape else 1), parts_of(scene, name), owners(scene, name)
    if not part:
        return list(range(start + (component or 0), start + size, 1 if component is None else width))
    own = part if any(owner == part or owner.startswith(f"{part} ") for owner in parts) else turned(part)
    wanted = {part, own, *_positions(scene, part)}
    limits = tuple(f"{each} " for each in wanted)  # "cart.shift lower"
    rows = [i for i, owner in enumerate(parts) if owner == part]
    rows = rows or [i for i, owner in enumerate(parts) if owner in wanted or owner.startswith(limits)]
    rows = rows or [i for i, each in enumerate(exact) if each in wanted]  # of one end
    if not rows and name in OF_PAIRS:
        rows = between(scene.shapes, scene.structure.pairs, part)
    if not rows:
        known = list(dict.fromkeys(f"{owner}.{name}" for owner in parts))
        raise ArgumentError(f"{label} names {key!r}; {some(key, known)}")
    numbers = range(width) if component is None else (component,)
    return [start + width * row + i for row in rows for i in numbers]


def places_of_all(scene: Scene, keys: Iterable[str], label: str) -> dict[str, list[int]]:
    """`places_of` of several names.

    Raises:
        ArgumentError: there are none, or two names are of the same numbers, as a pair's in either order.
    """
    found: dict[str, list[int]] = {}
    first: dict[tuple[int, ...], str] = {}
    for key in keys:
        places = found[key] = places_of(scene, key, label)
        if (same := first.setdefault(tuple(places), key)) != key and "." in same and "." in key:
            raise ArgumentError(f"{label} names {same!r} and {key!r}, which are the same; leave one out")
    return found


def like(key: str, known: Iterable[str]) -> str:
    """A hint at a name that one may have meant, or ""."""
    near = difflib.get_close_matches(parameter_of(key)[1], list(known), 1)
    return f"; {key.rpartition('.')[0] + '.' if '.' in key else ''}{near[0]} is like it" if near else ""


def _positions(scene: Scene, body: str) -> set[str]:
    """Names of the degrees of freedom of a body, and of their controls."""
    of = [name for name in scene.state_names[: scene.nv] if name.rpartition(".")[0] == body]
    return {*of, *(name for name in scene.control_names if name.partition("#")[0] in of)}


def owners(scene: Scene, name: str) -> list[str]:
    """Names of the parts that a parameter's rows belong to, all ends of a shape alike."""
    return [END.sub("", each) for each in parts_of(scene, name)]


def column_of(scene: Scene, column: int) -> tuple[str, int, tuple[int, ...]]:
    """Name, first column and shape of the parameter that a column of the table belongs to."""
    columns = layout(scene.structure).columns
    return next(each for each in reversed(columns) if each[1] <= column and np.prod(each[2], dtype=int))
