"""From a scene's description to the structure that selects its kernels; one clear error for what is wrong."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from slcp_warp.kernels.structure import (
    CAPSULE,
    DISC,
    ELLIPSE,
    HALFPLANE,
    WORLD,
    BodyStructure,
    PairStructure,
    ShapeStructure,
    Structure,
)

from ..inputs.checks import shown
from ..inputs.errors import SceneError

if TYPE_CHECKING:
    from .scene import Body, Contact, Scene, Shape, Spring

JOINTS = {"revolute": 1, "prismatic": 1, "free": 3}
KINDS = (DISC, ELLIPSE, HALFPLANE, CAPSULE)


def contact_ends(scene: "Scene", contact: "Contact") -> tuple[tuple[int, int], ...]:
    """The pairs that a contact makes: which ends of capsules (+-1; 0: the whole shape) on either side."""
    kind = {shape.name: shape.kind for shape in scene.shapes}
    a, b = kind[contact.shape_a], kind[contact.shape_b]
    if a == b == CAPSULE:
        return ((-1, 0), (1, 0), (0, -1), (0, 1))
    if (a, b) == (CAPSULE, HALFPLANE):
        return ((-1, 0), (1, 0))
    if (a, b) == (HALFPLANE, CAPSULE):
        return ((0, -1), (0, 1))
    return ((0, 0),)


def spread(value: Any, i: int, default: Any) -> Any:
    """Entry i of a number per degree of freedom, or of one number for all."""
    if value is None:
        return default
    entry = value[i] if isinstance(value, Sequence) else value
    return default if entry is None else entry


def radii(shape: "Shape") -> tuple[float, float]:
    """Both numbers of a shape's size."""
    radius = tuple(shape.radius) if isinstance(shape.radius, Sequence) else (shape.radius,)
    return (radius[0], radius[-1])


def _index(places: Mapping[str, int], name: str | None, what: str, field_name: str) -> int:
    if name is None:
        return WORLD
    if name not in places:
        raise SceneError(f"{field_name}: no {what} named {name!r}; there are {shown(list(places))}")
    return places[name]


def _places(items: Sequence, what: str) -> dict[str, int]:
    """Where each name is; they must be unique."""
    places: dict[str, int] = {}
    for i, item in enumerate(items):
        if item.name in places:
            raise SceneError(f"{what}: {what}[{places[item.name]}] and {what}[{i}] are both named "
                             f"{item.name!r}; names must be unique")  # fmt: skip
        places[item.name] = i
    return places


def structure_of(scene: "Scene") -> Structure:
    """The structure of a scene. Raises SceneError."""
    if not scene.bodies:
        raise SceneError(f"bodies: scene {scene.name!r} has none; it needs at least one")
    names, shape_names = _places(scene.bodies, "bodies"), _places(scene.shapes, "shapes")
    bodies: list[BodyStructure] = []
    lower: list[bool] = []
    upper: list[bool] = []
    sprung: list[int] = []
    for b, body in enumerate(scene.bodies):
        _check_limits(body)
        parent = _index(names, body.parent, "body", f"body {body.name!r}, parent")
        if parent >= b:
            raise SceneError(f"body {body.name!r}: parent is {body.parent!r}, which does not come before it; "
                             "parents come before their children")  # fmt: skip
        n = JOINTS[body.joint]
        start = len(lower)
        bodies.append(BodyStructure(parent, body.joint, tuple(range(start, start + n))))
        lower += [spread(body.lower, i, None) is not None for i in range(n)]
        upper += [spread(body.upper, i, None) is not None for i in range(n)]
        sprung += [start + i for i in range(n) if spread(body.stiffness, i, None) is not None]
    shapes = []
    for shape in scene.shapes:
        holder = _index(names, shape.body, "body", f"shape {shape.name!r}, body")
        shapes.append(ShapeStructure(holder, shape.kind, shape.angle != 0.0))
    pairs = []
    for c in scene.contacts:
        a = _index(shape_names, c.shape_a, "shape", "contacts, shape_a")
        b = _index(shape_names, c.shape_b, "shape", "contacts, shape_b")
        _check_pair(c, shapes[a], shapes[b])
        pairs += [PairStructure(a, b, c.friction is not None, *ends) for ends in contact_ends(scene, c)]
    actuators = []
    for i, act in enumerate(scene.actuators):
        driven = _index(names, act.body, "body", f"actuators[{i}], body")
        if not 0 <= act.dof < JOINTS[scene.bodies[driven].joint]:
            raise SceneError(f"actuators[{i}]: dof {act.dof} is outside the joint of body {act.body!r}")
        actuators.append(bodies[driven].dofs[act.dof])
    springs = []
    for i, spring in enumerate(scene.springs):
        a = _index(names, spring.body_a, "body", f"springs[{i}], body_a")
        b = _index(names, spring.body_b, "body", f"springs[{i}], body_b")
        _check_spring(f"springs[{i}]", spring, a, b)
        springs.append((a, b))
    return Structure(
        tuple(bodies), tuple(shapes), tuple(pairs), tuple(lower), tuple(upper), tuple(actuators),
        tuple(sprung), tuple(springs), implicit_damping=scene.implicit_damping,
    )  # fmt: skip


def _check_limits(body: "Body") -> None:
    for i in range(JOINTS[body.joint]):
        lower, upper = spread(body.lower, i, -math.inf), spread(body.upper, i, math.inf)
        if lower > upper:
            raise SceneError(f"body {body.name!r}: lower is {lower}, above upper, {upper}; "
                             "at most as much is needed")  # fmt: skip


def _check_spring(label: str, spring: "Spring", a: int, b: int) -> None:
    if a == b:
        raise SceneError(f"{label}: both ends are on {spring.body_a!r}; a spring needs two bodies, "
                         "or a body and the world (None)")  # fmt: skip


def _check_pair(contact: "Contact", a: ShapeStructure, b: ShapeStructure) -> None:
    label = f"contact {contact.shape_a!r} - {contact.shape_b!r}"
    if a.kind == HALFPLANE and b.kind == HALFPLANE:
        raise SceneError(f"{label}: both are half-planes; at least one shape must be round")
    if {a.kind, b.kind} == {CAPSULE, ELLIPSE}:
        raise SceneError(f"{label}: a capsule and an ellipse cannot touch; "
                         "a capsule touches half-planes, discs, capsules")  # fmt: skip
    if a.body == b.body:
        raise SceneError(
            f"{label}: both shapes are on the same body; a pair needs two bodies, or a body and the world"
        )
