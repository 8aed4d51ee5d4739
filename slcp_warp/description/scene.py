"""Description of a planar mechanism: bodies in a tree, shapes on them, pairs of shapes that may touch.

Every part is checked when it is made (`SceneError`); its numbers obey the rules of `rules.py`, which hold for
`Parameters.replace` and for files, too, and are kept as floats and tuples of floats.

World x points right, y up, angles are counter-clockwise from +x; lengths in m, masses in kg, angles in rad
(or any self-consistent units). A scene only describes; `Simulator` makes specialised kernels from it.
"""

import copy
import math
from dataclasses import dataclass, field, replace

import numpy as np

from slcp_warp.kernels.structure import Structure

from ..inputs.checks import array, number, shown
from ..inputs.errors import SceneError
from . import fields as scene_fields
from .topology import JOINTS, KINDS, contact_ends, radii, spread, structure_of

Pair2 = tuple[float, float]

__all__ = ["Actuator", "Body", "Contact", "Scene", "SceneError", "Shape", "Spring", "box", "touching"]


@dataclass(frozen=True)
class Body:
    """A rigid body and the joint that ties it to its parent.

    Attributes:
        name: unique name.
        mass: [kg], > 0.
        inertia: about the centre of mass [kg m^2], > 0.
        parent: name of an earlier body, or None for the world.
        joint: "revolute" (angle), "prismatic" (shift along `axis`) or "free" (x, y, angle).
        anchor: joint position in the parent's frame [m].
        angle: turn of this body's frame at q = 0 [rad].
        axis: unit direction of a prismatic joint in the parent's frame (of length 1 to 0.005).
        com: centre of mass in the body's frame, whose origin is the joint [m].
        damping: joint damping >= 0, one number per degree of freedom [N m s/rad, N s/m]; met at the end of
            a step unless the scene says otherwise (`Scene.implicit_damping`).
        stiffness, rest: joint spring per degree of freedom, force -stiffness (q - rest) [N m/rad, N/m; rad,
            m]; stiffness None: no spring.
        lower, upper: limits per degree of freedom, lower <= upper (None: no limit, no row).
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

    def __post_init__(self) -> None:
        scene_fields.settle_body(self, JOINTS)


@dataclass(frozen=True)
class Shape:
    """A shape on a body (or the world, body=None).

    Attributes:
        kind: "disc" (radius; 0 is a point), "ellipse" (two radii along its axes), "capsule" (radius and half
            length of its segment, which lies along its axis) or "halfplane".
        radius: (r,), (rx, ry) or a capsule's (r, half length) [m].
        offset: centre, or a point of the half-plane, in the body's frame [m].
        angle: of the first axis, or of a half-plane's outward normal, against the body's x [rad].
    """

    name: str
    body: str | None
    kind: str
    radius: tuple[float, ...] | float = 0.0
    offset: Pair2 = (0.0, 0.0)
    angle: float = 0.0

    def __post_init__(self) -> None:
        scene_fields.settle_shape(self, KINDS)


@dataclass(frozen=True)
class Contact:
    """Two shapes that may touch, by name, and their friction coefficient (None: a frictionless contact).

    A capsule touches half-planes with the discs at its ends (two pairs), discs with its nearest point (one
    pair), and another capsule with the ends of either on the other (four pairs). Ellipses do not touch it.
    """

    shape_a: str
    shape_b: str
    friction: float | None = None

    def __post_init__(self) -> None:
        scene_fields.settle_contact(self)


@dataclass(frozen=True)
class Actuator:
    """A control that pushes one degree of freedom with the force gear * u.

    Attributes:
        body: whose joint is driven.
        dof: which degree of freedom of that joint, from 0.
        gear: force or torque per unit of control.
    """

    body: str
    dof: int = 0
    gear: float = 1.0

    def __post_init__(self) -> None:
        scene_fields.settle_actuator(self)


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

    def __post_init__(self) -> None:
        scene_fields.settle_spring(self)


PARTS = {"bodies": Body, "shapes": Shape, "contacts": Contact, "actuators": Actuator, "springs": Spring}


@dataclass(frozen=True)
class Scene:
    """A planar mechanism with its default numbers.

    Attributes:
        bodies: parents before children.
        shapes, contacts, actuators, springs: see the classes.
        gravity: [m/s^2].
        step_size: default h > 0 [s].
        sigma: default noise level of the smoothing, > 0 [m/s, rad/s].
        initial_state: x0 = (q, v), (2 nv,).
        period: per degree of freedom > 0, or None: q_j and q_j + period look alike.
        implicit_damping: whether dampers, of joints and of springs, act with the velocity at the end of a
            step: stable for every c h/m. False: with that at its start, the paper's r(q, v), which diverges
            for c h/m > 2.
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
    implicit_damping: bool = True
    structure: Structure = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        scene_fields.Fields(self, "scene, ").text("name")
        fields = scene_fields.Fields(self, f"scene {self.name!r}: ")
        for name, kind in PARTS.items():
            fields.objects(name, kind)
        fields.pair("gravity")
        fields.number("step_size")
        fields.number("sigma")
        fields.flag("implicit_damping")
        object.__setattr__(self, "structure", structure_of(self))
        fields.entries("initial_state", 2 * self.structure.nv)
        fields.entries("period", self.structure.nv, optional=True)

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
        per_dof = [(spread(b.damping, i, 0.0), spread(b.lower, i, None), spread(b.upper, i, None))
                   for b in self.bodies for i in range(JOINTS[b.joint])]  # fmt: skip
        friction = [c.friction or 0.0 for c in self.contacts for _ in contact_ends(self, c)]
        extents = [radii(shape) for shape in self.shapes]
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
            "friction": np.array(friction, float),
            "radius": np.array(extents, float).reshape(-1, 2),
            "shape_offset": np.array([sh.offset for sh in self.shapes], float).reshape(-1, 2),
            "shape_angle": np.array([sh.angle for sh in self.shapes], float),
        }
        if s.sprung:
            for name in ("stiffness", "rest"):
                per = [spread(getattr(b, name), i, 0.0) for b in self.bodies for i in range(JOINTS[b.joint])]
                values[name] = np.array([0.0 if x is None else x for x in per], float)
        if s.springs:
            for name in ("stiffness", "damping", "length"):
                values[f"spring_{name}"] = np.array([getattr(sp, name) for sp in self.springs], float)
            values["spring_point"] = np.array([(sp.point_a, sp.point_b) for sp in self.springs], float)
        if s.uncertain:
            values["position_covariance"] = np.zeros((s.nv, s.nv))
            values["velocity_covariance"] = self.sigma**2 * np.eye(s.nv)
        return values

    def with_covariances(self) -> "Scene":
        """The same scene with `position_covariance` and `velocity_covariance` among its numbers."""
        out = copy.copy(self)
        object.__setattr__(out, "structure", replace(self.structure, uncertain=True))
        return out


def box(
    name: str,
    body: str | None,
    width: float,
    height: float,
    corner_radius: float = 0.0,
    offset: Pair2 = (0.0, 0.0),
    angle: float = 0.0,
) -> tuple[Shape, ...]:
    """The corners of a box (points, or discs within it), counter-clockwise from the lower left.

    Their names are `name` and a number from 0 to 3. They touch half-planes of any body, and round shapes;
    `touching` makes the contacts.
    """
    if not isinstance(name, str) or not name:
        raise SceneError(f"name is {shown(name)}; a name is needed")
    offset_x, offset_y = array("offset", offset, (2,), error=SceneError)
    half = min(number("width", width, 0.0, above=True, error=SceneError),
               number("height", height, 0.0, above=True, error=SceneError)) / 2.0  # fmt: skip
    number("corner_radius", corner_radius, 0.0, half, error=SceneError)
    angle = number("angle", angle, error=SceneError)
    x, y = width / 2.0 - corner_radius, height / 2.0 - corner_radius
    c, s = math.cos(angle), math.sin(angle)
    corners = [(sx * x, sy * y) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    places = [(offset_x + c * u - s * w, offset_y + s * u + c * w) for u, w in corners]
    return tuple(Shape(f"{name}{i}", body, "disc", corner_radius, place) for i, place in enumerate(places))


def touching(
    shapes: tuple[Shape, ...], others: tuple[Shape, ...], friction: float | None = None
) -> tuple[Contact, ...]:
    """A contact of every one of `shapes` with every one of `others`."""
    for name, group in (("shapes", shapes), ("others", others)):
        if not isinstance(group, list | tuple) or not all(isinstance(shape, Shape) for shape in group):
            raise SceneError(f"{name} is {shown(group)}; a tuple of Shape is needed")
    return tuple(Contact(other.name, shape.name, friction) for other in others for shape in shapes)
