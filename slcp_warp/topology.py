"""From a scene's description to the structure that selects its kernels; one clear error for what is wrong."""

import math
from collections.abc import Sequence
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

if TYPE_CHECKING:
    from .scene import Body, Contact, Scene, Shape, Spring

JOINTS = {"revolute": 1, "prismatic": 1, "free": 3}
KINDS = (DISC, ELLIPSE, HALFPLANE, CAPSULE)


class SceneError(ValueError):
    """A scene that does not describe a mechanism; the message names the field, what came and what is
    needed.
    """


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
    return value[i] if isinstance(value, Sequence) else value


def radii(shape: "Shape") -> tuple[float, float]:
    """Both numbers of a shape's size."""
    radius = tuple(shape.radius) if isinstance(shape.radius, Sequence) else (shape.radius,)
    return (radius[0], radius[-1])


def _index(names: Sequence[str], name: str | None, what: str, field_name: str) -> int:
    if name is None:
        return WORLD
    if name not in names:
        raise SceneError(f"{field_name}: no {what} named {name!r}; there are {list(names)}")
    return list(names).index(name)


def _unique(items: Sequence, what: str) -> list[str]:
    names = [item.name for item in items]
    for name in names:
        if names.count(name) > 1:
            raise SceneError(
                f"{what}: the name {name!r} is used {names.count(name)} times; names must be unique"
            )
    return names


def structure_of(scene: "Scene") -> Structure:
    """The structure of a scene. Raises SceneError."""
    if not scene.bodies:
        raise SceneError(f"bodies: scene {scene.name!r} has none; it needs at least one")
    names = _unique(scene.bodies, "bodies")
    shape_names = _unique(scene.shapes, "shapes")
    bodies: list[BodyStructure] = []
    lower: list[bool] = []
    upper: list[bool] = []
    sprung: list[int] = []
    for b, body in enumerate(scene.bodies):
        _check_body(body)
        parent = _index(names[:b], body.parent, "earlier body", f"body {body.name!r}, parent")
        n = JOINTS[body.joint]
        start = len(lower)
        bodies.append(BodyStructure(parent, body.joint, tuple(range(start, start + n))))
        lower += [spread(body.lower, i, None) is not None for i in range(n)]
        upper += [spread(body.upper, i, None) is not None for i in range(n)]
        sprung += [start + i for i in range(n) if spread(body.stiffness, i, None) is not None]
    shapes = []
    for shape in scene.shapes:
        _check_shape(shape)
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
        tuple(sprung), tuple(springs),
    )  # fmt: skip


def _check_body(body: "Body") -> None:
    if body.joint not in JOINTS:
        raise SceneError(
            f"body {body.name!r}: joint {body.joint!r} is unknown; choose one of {sorted(JOINTS)}"
        )
    for name in ("mass", "inertia"):
        value = getattr(body, name)
        if not (math.isfinite(value) and value > 0.0):
            raise SceneError(f"body {body.name!r}: {name} is {value}; it must be positive and finite")
    for name in ("damping", "stiffness", "rest", "lower", "upper"):
        value = getattr(body, name)
        if isinstance(value, Sequence) and len(value) != JOINTS[body.joint]:
            raise SceneError(f"body {body.name!r}: {name} has {len(value)} entries; "
                             f"a {body.joint} joint needs {JOINTS[body.joint]}")  # fmt: skip


def _check_shape(shape: "Shape") -> None:
    if shape.kind not in KINDS:
        raise SceneError(f"shape {shape.name!r}: kind {shape.kind!r} is unknown; choose one of {list(KINDS)}")
    if shape.kind == CAPSULE and not (isinstance(shape.radius, Sequence) and len(shape.radius) == 2):
        raise SceneError(f"shape {shape.name!r}: radius is {shape.radius}; "
                         "a capsule needs (radius, half length)")  # fmt: skip
    size = radii(shape)
    if min(size) < 0.0 or (shape.kind == ELLIPSE and min(size) <= 0.0) or not all(map(math.isfinite, size)):
        raise SceneError(
            f"shape {shape.name!r}: radius {shape.radius} must be positive (a disc's or capsule's >= 0)"
        )


def _check_spring(label: str, spring: "Spring", a: int, b: int) -> None:
    if a == b:
        raise SceneError(f"{label}: both ends are on {spring.body_a!r}; a spring needs two bodies, "
                         "or a body and the world (None)")  # fmt: skip
    for name in ("damping", "length"):
        value = getattr(spring, name)
        if not (math.isfinite(value) and value >= 0.0):
            raise SceneError(f"{label}: {name} is {value}; it must be >= 0")


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
    if contact.friction is not None and not (math.isfinite(contact.friction) and contact.friction >= 0.0):
        raise SceneError(f"{label}: friction is {contact.friction}; it must be >= 0 (None: frictionless)")
