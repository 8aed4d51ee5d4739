"""The parts of a scene: bodies with their joints, shapes on them, contacts, actuators, springs, tendons.

Every part is checked when it is made (`SceneError`); its numbers obey the rules of `inputs/rules.py`, which
hold for `Parameters.replace` and for files, too, and are kept as floats and tuples of floats.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slcp_warp.kernels.structure import CAPSULE, DISC, ELLIPSE, HALFPLANE, RECTANGLE, RING

from ..inputs import rules
from ..inputs.checks import array, flag, number, shown
from ..inputs.errors import SceneError
from .fields import Fields, several

Pair2 = tuple[float, float]
JOINTS = {"revolute": 1, "prismatic": 1, "free": 3}  # and their degrees of freedom
KINDS = (DISC, ELLIPSE, HALFPLANE, CAPSULE, RECTANGLE, RING)


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
        armature: inertia >= 0 of a coordinate by itself, per degree of freedom, added to M's diagonal
            [kg m^2, kg], as of a rotor behind a gear (its own times the square of the ratio); None: none.
        lower, upper: limits per degree of freedom, lower <= upper (None: no limit, no row).
        touches_parent: whether its shapes may touch those of its parent under `contacts="auto"`.
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
    touches_parent: bool = False
    armature: tuple[float | None, ...] | float | None = None

    def __post_init__(self) -> None:
        Fields(self, "body, ").text("name")
        fields = Fields(self, f"body {self.name!r}: ")
        fields.text("parent", optional=True)
        fields.choice("joint", tuple(JOINTS))
        for name in ("mass", "inertia"):
            fields.number(name)
        fields.angle("angle")
        for name in ("anchor", "axis", "com"):
            fields.pair(name)
        rules.check_axis(f"body {self.name!r}: axis", np.array(self.axis), SceneError)
        for name in ("damping", "rest"):
            fields.per_dof(name, JOINTS[self.joint])
        for name in ("stiffness", "lower", "upper", "armature"):
            fields.per_dof(name, JOINTS[self.joint], optional=True)
        fields.flag("touches_parent")


@dataclass(frozen=True)
class Shape:
    """A shape on a body (or the world, body=None).

    Attributes:
        name: unique name.
        body: name of its body, or None for the world.
        kind: "disc" (radius; 0 is a point), "ellipse" (two radii along its axes), "capsule" (radius and half
            length of its segment, which lies along its axis), "rectangle" (half of its width and height),
            "ring" (radius; solid outside, it holds in what is in it) or "halfplane".
        radius: (r,), (rx, ry), a capsule's (r, half length) or a rectangle's (half width, half height) [m].
        offset: centre, or a point of the half-plane, in the body's frame [m].
        angle: of the first axis, or of a half-plane's outward normal, against the body's x [rad].
        friction: under `contacts="auto"` a pair has the larger coefficient of its two shapes, >= 0; None:
            the scene's `friction`. Contacts that are listed have their own.
        contype, conaffinity: under `contacts="auto"` two shapes may touch where the bits of one's contype
            and of the other's conaffinity have one in common, as in MuJoCo.
        corner_radius: of a rectangle's corners, within its size; 0: sharp [m].
        restitution: as friction, in [0, 1]; see `Contact`. A pair of two shapes of 0 has none.
        driven_by: a body with one coordinate, with whose rate the surface of this shape runs, as that of a
            conveyor, a track or a treadmill; in generic kernels. The shape is one of the world, or of a body
            of the same tree that it does not move with. None: the surface stands still on its body.
        surface_ratio: how far the surface runs by a unit of that coordinate, to the left as one looks along
            the outward normal (M61) [m/m, m/rad]; -1 carries what lies on level ground to the right.
    """

    name: str
    body: str | None
    kind: str
    radius: tuple[float, ...] | float = 0.0
    offset: Pair2 = (0.0, 0.0)
    angle: float = 0.0
    friction: float | None = None
    contype: int = 1
    conaffinity: int = 1
    corner_radius: float = 0.0
    restitution: float | None = None
    driven_by: str | None = None
    surface_ratio: float = 1.0

    def __post_init__(self) -> None:
        Fields(self, "shape, ").text("name")
        label = f"shape {self.name!r}: "
        fields = Fields(self, label)
        fields.text("body", optional=True)
        fields.choice("kind", KINDS)
        given: Any = self.radius
        if self.kind == "capsule" and not (several(given) and len(given) == 2):
            raise SceneError(f"{label}radius is {shown(given)}; a capsule needs (radius, half length)")
        if self.kind == "rectangle" and not (several(given) and len(given) == 2):
            raise SceneError(f"{label}radius is {shown(given)}; a rectangle needs (half width, half height)")
        if several(given):
            fields.entries("radius", 1 if len(given) == 1 else 2)
        else:
            fields.number("radius")
        rules.check_radius(f"{label}radius", self.kind, np.array(radii(self)), SceneError)
        fields.pair("offset", "shape_offset")
        fields.angle("angle", "shape_angle")
        fields.number("friction", optional=True)
        fields.whole("contype")
        fields.whole("conaffinity")
        fields.number("corner_radius")
        fields.number("restitution", optional=True)
        fields.text("driven_by", optional=True)
        fields.number("surface_ratio")
        if self.corner_radius and self.kind != "rectangle":
            raise SceneError(f"{label}corner_radius is {self.corner_radius}; a {self.kind} has no corners")
        both = np.array(radii(self)), np.array(self.corner_radius)
        rules.check_corners(f"{label}corner_radius", self.kind, *both, SceneError)


@dataclass(frozen=True)
class Contact:
    """Two shapes that may touch, by name, and their friction coefficient (None: no friction).

    A capsule touches half-planes with the discs at its ends (two pairs), discs with its nearest point (one
    pair), and another capsule with the ends of either on the other (four pairs); so does a rectangle, with
    the discs at its four corners. Ellipses touch neither. A ring touches discs in it, and the ends and
    corners of capsules and rectangles.

    Attributes:
        shape_a, shape_b: names of shapes; the normal points from the first to the second.
        friction: coefficient mu of (M7) or (M8), as `Options.friction` says, >= 0; or None.
        restitution: share e of the normal speed with which a pair parts that closes in a step (M54), in
            [0, 1]; None: none, and no parameter of it.
    """

    shape_a: str
    shape_b: str
    friction: float | None = None
    restitution: float | None = None

    def __post_init__(self) -> None:
        for name in ("shape_a", "shape_b"):
            Fields(self, "contact, ").text(name)
        label = f"contact {self.shape_a!r} - {self.shape_b!r}: "
        for name in ("friction", "restitution"):
            Fields(self, label).number(name, optional=True)


@dataclass(frozen=True)
class Actuator:
    """A control that pushes one degree of freedom, or pulls at a tendon, with the force gear * u.

    Attributes:
        body: whose joint is driven; None: a tendon is.
        dof: which degree of freedom of that joint, from 0.
        gear: force or torque per unit of control.
        tendon: name of the tendon that is pulled to the side on which its length grows: coordinate j feels
            c_j gear * u.
    """

    body: str | None = None
    dof: int = 0
    gear: float = 1.0
    tendon: str | None = None

    def __post_init__(self) -> None:
        for name in ("body", "tendon"):
            Fields(self, "actuator, ").text(name, optional=True, none="")
        if (self.body is None) == (self.tendon is None):
            raise SceneError(
                f"actuator, body is {shown(self.body)} and tendon is {shown(self.tendon)}; one of them is "
                "needed"
            )
        fields = Fields(self, f"actuator on {self.body or self.tendon!r}: ")
        fields.whole("dof")
        fields.number("gear")
        if self.tendon is not None and self.dof:
            raise SceneError(f"actuator on {self.tendon!r}: dof is {self.dof}; a tendon has none")


@dataclass(frozen=True)
class Spring:
    """A spring and damper between two points of bodies (or of the world, None).

    The force along the line of the points is stiffness (l - length) + damping dl/dt, l^2 = s^2 + eps^2 of
    their distance s and eps = length/1000 + 1e-5, so that coincident points give finite derivatives (M26).

    Attributes:
        body_a, body_b: names of bodies, or None for the world.
        point_a, point_b: in the frame of their body [m].
        stiffness: [N/m]; a negative one pushes apart.
        damping: [N s/m], >= 0.
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
        for name in ("body_a", "body_b"):
            Fields(self, "spring, ").text(name, optional=True)
        fields = Fields(self, f"spring {self.body_a!r} - {self.body_b!r}: ")
        for name in ("point_a", "point_b"):
            fields.pair(name, "spring_point")
        for name in ("stiffness", "damping", "length"):
            fields.number(name, f"spring_{name}")


@dataclass(frozen=True)
class Tendon:
    """A spring and damper of a weighted sum of coordinates, l = sum_j c_j q_j: fingers that close together, a
    belt, a gear that yields, a tendon over pulleys.

    The force along l is stiffness (l - length) + damping dl/dt, and coordinate j feels -c_j times it (M57).

    Attributes:
        name: unique among tendons, no body's and no coordinate's, without "#", which counts controls.
        coordinates: by their names, `left.shift`, at least one, each once.
        coefficients: c_j of each [m/rad, 1, ...].
        stiffness: per unit of l [N/m, N m/rad]; a negative one pushes apart. A stiff one ties coordinates: it
            is met half a step late (`Scene.implicit_stiffness`), so that any is stable.
        damping: >= 0, per unit of dl/dt.
        length: l where nothing is pulled.
        force_limit: >= 0, what the force along l, of spring, damper and actuators together, is at most to
            either side (M64) [N, N m]: a motor that stalls, a clutch that slips, a grip that yields; in
            generic kernels. None: there is none.
        force_sigma: >= 0, of a force with a limit, under smoothed contact laws: scale of the logistic noise
            of what is asked for, of whose clamp the force is the mean (M65) [N, N m]. Plans see a slope
            beyond the limit by it, as contact from afar by `sigma`. 0, and under hard laws: the clamp.
    """

    name: str
    coordinates: tuple[str, ...]
    coefficients: tuple[float, ...]
    stiffness: float = 0.0
    damping: float = 0.0
    length: float = 0.0
    force_limit: float | None = None
    force_sigma: float = 0.0

    def __post_init__(self) -> None:
        Fields(self, "tendon, ").text("name")
        label = f"tendon {self.name!r}: "
        fields = Fields(self, label)
        given = self.coordinates
        if not isinstance(given, list | tuple) or not given or not all(isinstance(n, str) for n in given):
            raise SceneError(f"{label}coordinates is {shown(given)}; names of coordinates are needed")
        if len(set(given)) < len(given):
            raise SceneError(f"{label}coordinates is {shown(given)}; each of them once is needed")
        object.__setattr__(self, "coordinates", tuple(given))
        if self.coefficients is None:
            raise SceneError(f"{label}coefficients is None; {len(given)} numbers are needed")
        fields.entries("coefficients", len(given), "tendon_coefficient")
        for name in ("stiffness", "damping", "length"):
            fields.number(name, f"tendon_{name}")
        fields.number("force_limit", "tendon_force_limit", optional=True)
        fields.number("force_sigma", "tendon_force_sigma")
        if self.force_limit is None and self.force_sigma != 0.0:
            raise SceneError(f"{label}force_sigma is {shown(self.force_sigma)}, of a force without a limit; "
                             "force_limit is needed beside it")  # fmt: skip


def spread(value: Any, i: int, default: Any) -> Any:
    """Entry i of a number per degree of freedom, or of one number for all."""
    if value is None:
        return default
    entry = value[i] if isinstance(value, Sequence) else value
    return default if entry is None else entry


def radii(shape: Shape) -> tuple[float, float]:
    """Both numbers of a shape's size."""
    radius = tuple(shape.radius) if isinstance(shape.radius, Sequence) else (shape.radius,)
    return (radius[0], radius[-1])


def box(
    name: str,
    body: str | None,
    width: float,
    height: float,
    corner_radius: float = 0.0,
    offset: Pair2 = (0.0, 0.0),
    angle: float = 0.0,
    sides: bool = False,
) -> tuple[Shape, ...]:
    """The corners of a box (points, or discs within it), counter-clockwise from the lower left.

    They touch half-planes of any body, and round shapes; `touching` makes the contacts. With `sides` come
    four capsules, each from a corner to the next one, `name01` to `name30`: then boxes keep each other and
    discs out under `contacts="auto"`. Corners of one touch sides of the other, no corner a corner and no side
    a side; a half-plane with `contype=0` is touched by the corners only, which is enough of them.

    Args:
        name: the corners are called this with a number from 0 to 3 behind it.
        body: that it is on; None: the world.
        width, height: [m], > 0.
        corner_radius: of the discs that round the corners off, 0: points [m].
        offset: of its centre, in the body's frame [m].
        angle: of its width against the body's x [rad].
        sides: whether there are sides, too; they need a corner radius > 0.
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
    flag("sides", sides)
    # touch what is touched, and never each other
    only: dict[str, Any] = {"contype": 1, "conaffinity": 0} if sides else {}
    round_off = [Shape(f"{name}{i}", body, "disc", corner_radius, at, **only) for i, at in enumerate(places)]
    if not sides:
        return tuple(round_off)
    if not corner_radius > 0.0:
        raise SceneError(f"corner_radius is {shown(corner_radius)}; sides need a positive one: a thin side "
                         "would let through what is fast")  # fmt: skip
    between = [
        Shape(f"{name}{i}{(i + 1) % 4}", body, "capsule", (corner_radius, (x, y)[i % 2]),
              ((p[0] + q[0]) / 2.0, (p[1] + q[1]) / 2.0), angle + i * math.pi / 2, contype=0, conaffinity=1)
        for i, (p, q) in enumerate(zip(places, places[1:] + places[:1], strict=True))
    ]  # fmt: skip
    return (*round_off, *between)


def touching(
    shapes: tuple[Shape, ...],
    others: tuple[Shape, ...],
    friction: float | None = None,
    restitution: float | None = None,
) -> tuple[Contact, ...]:
    """A contact of every one of `shapes` with every one of `others`, all with `friction` and `restitution`.

    Its shape_a is the one of `others`: normals lead from there, and the pair's name begins with it.
    """
    for name, group in (("shapes", shapes), ("others", others)):
        if not isinstance(group, list | tuple) or not all(isinstance(shape, Shape) for shape in group):
            raise SceneError(f"{name} is {shown(group)}; a tuple of Shape is needed")
    return tuple(
        Contact(other.name, shape.name, friction, restitution) for other in others for shape in shapes
    )
