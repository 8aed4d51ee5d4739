"""Description of a planar mechanism: bodies in a tree, shapes on them, and the pairs of shapes that may
touch.

World x points right, y up, angles are counter-clockwise from +x; lengths in m, masses in kg, angles in rad
(or any self-consistent units). A scene only describes; `Simulator` makes specialised kernels from it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slcp_warp.kernels.structure import (
    DISC,
    ELLIPSE,
    HALFPLANE,
    WORLD,
    BodyStructure,
    PairStructure,
    ShapeStructure,
    Structure,
)

JOINTS = {"revolute": 1, "prismatic": 1, "free": 3}
Pair2 = tuple[float, float]


class SceneError(ValueError):
    """A scene that does not describe a mechanism; the message names the field, what came and what is
    needed.
    """


@dataclass(frozen=True)
class Body:
    """A rigid body and the joint that ties it to its parent.

    Attributes:
        name: unique name.
        mass: [kg], > 0. inertia: about the centre of mass [kg m^2], > 0.
        parent: name of an earlier body, or None for the world.
        joint: "revolute" (angle), "prismatic" (shift along `axis`) or "free" (x, y, angle).
        anchor: joint position in the parent's frame [m]. angle: turn of this body's frame at q = 0 [rad].
        axis: unit direction of a prismatic joint in the parent's frame.
        com: centre of mass in the body's frame, whose origin is the joint [m].
        damping: joint damping, one number per degree of freedom [N m s/rad, N s/m].
        stiffness, rest: joint spring per degree of freedom, force -stiffness (q - rest) [N m/rad, N/m; rad,
            m]; stiffness None: no spring.
        lower, upper: limits per degree of freedom (None: no limit, no row).
    """

    name: str
    mass: float
    inertia: float
    parent: str | None = None
    joint: str = "revolute"
    anchor: Pair2 = (0.0, 0.0)
    angle: float = 0.0
    axis: Pair2 = (1.0, 0.0)
    com: Pair2 = (0.0, 0.0)
    damping: tuple[float, ...] | float = 0.0
    stiffness: tuple[float | None, ...] | float | None = None
    rest: tuple[float, ...] | float = 0.0
    lower: tuple[float | None, ...] | float | None = None
    upper: tuple[float | None, ...] | float | None = None


@dataclass(frozen=True)
class Shape:
    """A shape on a body (or the world, body=None).

    Attributes:
        kind: "disc" (radius; 0 is a point), "ellipse" (two radii along its axes) or "halfplane".
        radius: (r,) or (rx, ry) [m]. offset: centre, or a point of the half-plane, in the body's frame [m].
        angle: of the first axis, or of a half-plane's outward normal, against the body's x [rad].
    """

    name: str
    body: str | None
    kind: str
    radius: tuple[float, ...] | float = 0.0
    offset: Pair2 = (0.0, 0.0)
    angle: float = 0.0


@dataclass(frozen=True)
class Contact:
    """Two shapes that may touch, by name; friction coefficient, or None for a frictionless contact (one
    row).
    """

    shape_a: str
    shape_b: str
    friction: float | None = None


@dataclass(frozen=True)
class Actuator:
    """A control that pushes one degree of freedom (`dof` counts within the body's joint): force = gear *
    u.
    """

    body: str
    dof: int = 0
    gear: float = 1.0


@dataclass(frozen=True)
class Spring:
    """A spring and damper between two points of bodies (or of the world, None).

    The force along the line of the points is stiffness (l - length) + damping dl/dt with l their distance,
    rounded off below length/1000 + 1e-5 so that coincident points give finite derivatives.

    Attributes:
        point_a, point_b: in the frame of their body [m]. stiffness [N/m], damping [N s/m] >= 0.
        length: rest length [m], >= 0.
    """

    body_a: str | None
    body_b: str | None
    point_a: Pair2 = (0.0, 0.0)
    point_b: Pair2 = (0.0, 0.0)
    stiffness: float = 0.0
    damping: float = 0.0
    length: float = 0.0


@dataclass(frozen=True)
class Scene:
    """A planar mechanism with its default numbers.

    Attributes:
        bodies: parents before children. shapes, contacts, actuators, springs: see the classes.
        gravity: [m/s^2]. step_size: default h [s]. sigma: default noise level of the smoothing [m/s, rad/s].
        initial_state: x0 = (q, v), (2 nv,). period: per degree of freedom, or None: q_j and q_j + period
        look alike.
    """

    name: str
    bodies: tuple[Body, ...]
    shapes: tuple[Shape, ...] = ()
    contacts: tuple[Contact, ...] = ()
    actuators: tuple[Actuator, ...] = ()
    gravity: Pair2 = (0.0, -9.81)
    step_size: float = 0.01
    sigma: float = 0.1
    initial_state: tuple[float, ...] | None = None
    period: tuple[float | None, ...] | None = None
    springs: tuple[Spring, ...] = ()
    structure: Structure = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "structure", _structure(self))
        nv = self.structure.nv
        if self.initial_state is not None and len(self.initial_state) != 2 * nv:
            raise SceneError(
                f"initial_state has {len(self.initial_state)} numbers; scene {self.name!r} needs {2 * nv}"
            )
        if self.period is not None and len(self.period) != nv:
            raise SceneError(
                f"period has {len(self.period)} entries; scene {self.name!r} needs {nv}, one per dof"
            )

    @property
    def nv(self) -> int:
        """Degrees of freedom."""
        return self.structure.nv

    @property
    def nu(self) -> int:
        """Controls."""
        return self.structure.nu

    @property
    def x0(self) -> np.ndarray:
        """Default initial state (2 nv,); zero where none was given."""
        return np.zeros(2 * self.nv) if self.initial_state is None else np.array(self.initial_state, float)

    @property
    def state_period(self) -> np.ndarray:
        """Period of every state component, 0 where there is none, (2 nv,)."""
        period = [p or 0.0 for p in (self.period or (None,) * self.nv)]
        return np.array(period + [0.0] * self.nv)

    def default_parameters(self) -> dict[str, np.ndarray]:
        """The scene's numbers by parameter name, shapes as in `kernels.structure.layout`."""
        s = self.structure
        per_dof = [(_spread(b.damping, i, 0.0), _spread(b.lower, i, None), _spread(b.upper, i, None))
                   for b in self.bodies for i in range(JOINTS[b.joint])]  # fmt: skip
        radii = [_radii(shape) for shape in self.shapes]
        values = {
            "step_size": np.array(self.step_size),
            "gravity": np.array(self.gravity, float),
            "sigma": np.full(s.nr, self.sigma),
            "mass": np.array([b.mass for b in self.bodies], float),
            "inertia": np.array([b.inertia for b in self.bodies], float),
            "com": np.array([b.com for b in self.bodies], float).reshape(-1, 2),
            "anchor": np.array([b.anchor for b in self.bodies], float).reshape(-1, 2),
            "angle": np.array([b.angle for b in self.bodies], float),
            "axis": np.array([b.axis for b in self.bodies], float).reshape(-1, 2),
            "damping": np.array([d for d, _, _ in per_dof], float),
            "lower": np.array([0.0 if lo is None else lo for _, lo, _ in per_dof], float),
            "upper": np.array([0.0 if up is None else up for _, _, up in per_dof], float),
            "gear": np.array([a.gear for a in self.actuators], float),
            "friction": np.array([c.friction or 0.0 for c in self.contacts], float),
            "radius": np.array(radii, float).reshape(-1, 2),
            "shape_offset": np.array([sh.offset for sh in self.shapes], float).reshape(-1, 2),
            "shape_angle": np.array([sh.angle for sh in self.shapes], float),
        }
        if s.sprung:
            for name in ("stiffness", "rest"):
                per = [_spread(getattr(b, name), i, 0.0) for b in self.bodies for i in range(JOINTS[b.joint])]
                values[name] = np.array([0.0 if x is None else x for x in per], float)
        if s.springs:
            for name in ("stiffness", "damping", "length"):
                values[f"spring_{name}"] = np.array([getattr(sp, name) for sp in self.springs], float)
            values["spring_point"] = np.array([(sp.point_a, sp.point_b) for sp in self.springs], float)
        return values


def _spread(value: Any, i: int, default: Any) -> Any:
    if value is None:
        return default
    return value[i] if isinstance(value, Sequence) else value


def _radii(shape: Shape) -> tuple[float, float]:
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


def _structure(scene: Scene) -> Structure:
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
        lower += [_spread(body.lower, i, None) is not None for i in range(n)]
        upper += [_spread(body.upper, i, None) is not None for i in range(n)]
        sprung += [start + i for i in range(n) if _spread(body.stiffness, i, None) is not None]
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
        pairs.append(PairStructure(a, b, c.friction is not None))
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


def _check_body(body: Body) -> None:
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


def _check_shape(shape: Shape) -> None:
    if shape.kind not in (DISC, ELLIPSE, HALFPLANE):
        raise SceneError(
            f"shape {shape.name!r}: kind {shape.kind!r} is unknown; choose {DISC}, {ELLIPSE} or {HALFPLANE}"
        )
    radii = _radii(shape)
    if (
        min(radii) < 0.0
        or (shape.kind == ELLIPSE and min(radii) <= 0.0)
        or not all(map(math.isfinite, radii))
    ):
        raise SceneError(
            f"shape {shape.name!r}: radius {shape.radius} must be positive (a disc's may be zero)"
        )


def _check_spring(label: str, spring: Spring, a: int, b: int) -> None:
    if a == b:
        raise SceneError(f"{label}: both ends are on {spring.body_a!r}; a spring needs two bodies, "
                         "or a body and the world (None)")  # fmt: skip
    for name in ("damping", "length"):
        value = getattr(spring, name)
        if not (math.isfinite(value) and value >= 0.0):
            raise SceneError(f"{label}: {name} is {value}; it must be >= 0")


def _check_pair(contact: Contact, a: ShapeStructure, b: ShapeStructure) -> None:
    label = f"contact {contact.shape_a!r} - {contact.shape_b!r}"
    if a.kind == HALFPLANE and b.kind == HALFPLANE:
        raise SceneError(f"{label}: both are half-planes; at least one shape must be round")
    if a.body == b.body:
        raise SceneError(
            f"{label}: both shapes are on the same body; a pair needs two bodies, or a body and the world"
        )
    if contact.friction is not None and not (math.isfinite(contact.friction) and contact.friction >= 0.0):
        raise SceneError(f"{label}: friction is {contact.friction}; it must be >= 0 (None: frictionless)")
