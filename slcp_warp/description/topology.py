"""From a scene's description to the structure that selects its kernels; one clear error for what is wrong."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from slcp_warp.kernels.structure import (
    CAPSULE,
    CORNERS,
    ELLIPSE,
    HALFPLANE,
    RECTANGLE,
    RING,
    SIDED,
    WALLS,
    WORLD,
    BodyStructure,
    PairStructure,
    ShapeStructure,
    Structure,
)

from ..inputs.checks import shown
from ..inputs.errors import SceneError
from .names import pair_names, state_names, turned
from .parts import JOINTS, Actuator, Body, Contact, Shape, Spring, Tendon, radii, spread


def structure_of(
    bodies: Sequence[Body],
    shapes: Sequence[Shape],
    contacts: Sequence[Contact],
    actuators: Sequence[Actuator],
    springs: Sequence[Spring],
    tendons: Sequence[Tendon],
    implicit_damping: bool,
    implicit_stiffness: bool,
) -> Structure:
    """The structure of a scene of these parts.

    Raises:
        SceneError: a name that comes twice or is not there, or parts that do not fit together.
    """
    body_places, shape_places = _places(bodies, "bodies"), _places(shapes, "shapes")
    tree = _tree(bodies, body_places)
    shape_structures = tuple(_shape(s, bodies, body_places, tree) for s in shapes)
    return Structure(
        tuple(tree.bodies),
        shape_structures,
        _pairs(contacts, shapes, shape_places, shape_structures),
        tuple(tree.lower),
        tuple(tree.upper),
        _driven(actuators, bodies, body_places, tree, _places(tendons, "tendons")),
        tuple(tree.sprung),
        _spring_ends(springs, body_places),
        implicit_damping=implicit_damping,
        implicit_stiffness=implicit_stiffness and bool(tree.sprung or springs or tendons),
        armature=tuple(tree.armature),
        tendons=_joined(tendons, bodies),
        limited=tuple(i for i, tendon in enumerate(tendons) if tendon.force_limit is not None),
    )


def _shape(s: Shape, bodies: Sequence[Body], places: Mapping[str, int], tree: "_Tree") -> ShapeStructure:
    body = _index(places, s.body, "body", f"shape {s.name!r}, body")
    own = body, s.kind, s.angle != 0.0
    if s.driven_by is None:
        return ShapeStructure(*own)
    driver = _index(places, s.driven_by, "body", f"shape {s.name!r}, driven_by")
    joint = bodies[driver].joint
    if len(tree.bodies[driver].dofs) != 1:
        raise SceneError(
            f"shape {s.name!r}: driven_by is {s.driven_by!r}, whose joint is {joint}; a body with one "
            "coordinate, revolute or prismatic, is needed"
        )
    above = tree.chain(body)
    if driver in above:
        raise SceneError(f"shape {s.name!r}: driven_by is {s.driven_by!r}, with which it moves as a whole")
    if above and above[-1] != tree.chain(driver)[-1]:
        raise SceneError(
            f"shape {s.name!r}: driven_by is {s.driven_by!r}, which does not hang on "
            f"{bodies[above[-1]].name!r} as its body does; of another tree it drives shapes of the world"
        )
    return ShapeStructure(*own, tree.bodies[driver].dofs[0])


def contact_ends(shapes: Sequence[Shape], contact: Contact) -> tuple[tuple[int, int], ...]:
    """The pairs that a contact makes: which ends of capsules (+-1) and corners of rectangles (`CORNERS`) on
    either side; 0: the whole shape.
    """
    kind = {shape.name: shape.kind for shape in shapes}
    a, b = kind[contact.shape_a], kind[contact.shape_b]
    ends: dict[str, tuple[int, ...]] = {CAPSULE: (-1, 1), RECTANGLE: tuple(CORNERS)}
    of_a = [(end, 0) for end in ends.get(a, ()) if b in ends or b in WALLS]
    of_b = [(0, end) for end in ends.get(b, ()) if a in ends or a in WALLS]
    return (*of_a, *of_b) or ((0, 0),)


@dataclass
class _Tree:
    """Bodies, whether each degree of freedom has either limit, and which have a spring or an armature."""

    bodies: list[BodyStructure] = field(default_factory=list)
    lower: list[bool] = field(default_factory=list)
    upper: list[bool] = field(default_factory=list)
    sprung: list[int] = field(default_factory=list)
    armature: list[int] = field(default_factory=list)

    def chain(self, body: int) -> list[int]:
        """A body and those that it hangs on, up to the world."""
        out = []
        while body != WORLD:
            out.append(body)
            body = self.bodies[body].parent
        return out


def _tree(bodies: Sequence[Body], places: Mapping[str, int]) -> _Tree:
    tree = _Tree()
    for b, body in enumerate(bodies):
        _check_limits(body)
        parent = _index(places, body.parent, "body", f"body {body.name!r}, parent")
        if parent >= b:
            raise SceneError(f"body {body.name!r}: parent is {body.parent!r}, which does not come before it; "
                             "parents come before their children")  # fmt: skip
        n, start = JOINTS[body.joint], len(tree.lower)
        tree.bodies.append(BodyStructure(parent, body.joint, tuple(range(start, start + n))))
        tree.lower += [spread(body.lower, i, None) is not None for i in range(n)]
        tree.upper += [spread(body.upper, i, None) is not None for i in range(n)]
        tree.sprung += [start + i for i in range(n) if spread(body.stiffness, i, None) is not None]
        tree.armature += [start + i for i in range(n) if spread(body.armature, i, None) is not None]
    return tree


def _pairs(
    contacts: Sequence[Contact],
    shapes: Sequence[Shape],
    places: Mapping[str, int],
    structures: Sequence[ShapeStructure],
) -> tuple[PairStructure, ...]:
    pairs, seen = [], set()
    for c in contacts:
        a = _index(places, c.shape_a, "shape", "contacts, shape_a")
        b = _index(places, c.shape_b, "shape", "contacts, shape_b")
        if {a, b} in seen:
            raise SceneError(f"contacts has {c.shape_a!r} - {c.shape_b!r} twice; a pair stands in it once")
        seen.add(frozenset((a, b)))
        _check_pair(c, structures[a], structures[b])
        _check_sharp(c, shapes[a], shapes[b])
        _check_fits(c, shapes[a], shapes[b])
        has = c.friction is not None, c.restitution is not None
        pairs += [PairStructure(a, b, has[0], *ends, has[1]) for ends in contact_ends(shapes, c)]
    _check_pair_names(shapes, pairs)
    return tuple(pairs)


def _check_pair_names(shapes: Sequence[Shape], pairs: Sequence[PairStructure]) -> None:
    known: set[str] = set()
    for name in pair_names(shapes, pairs):
        if name in known:
            raise SceneError(
                f"contacts has two pairs of the name {name!r}; shapes need names that tell them apart, "
                "without '/' or the '(+)' of a capsule's end"
            )
        known |= {name, turned(name)}


def _driven(
    actuators: Sequence[Actuator],
    bodies: Sequence[Body],
    places: Mapping[str, int],
    tree: _Tree,
    tendons: Mapping[str, int],
) -> tuple[int, ...]:
    """The degree of freedom that every actuator drives, or -1 less its tendon."""
    out = []
    for i, actuator in enumerate(actuators):
        if actuator.tendon is not None:
            out.append(-1 - _index(tendons, actuator.tendon, "tendon", f"actuators[{i}], tendon"))
            continue
        body = _index(places, actuator.body, "body", f"actuators[{i}], body")
        if not 0 <= actuator.dof < JOINTS[bodies[body].joint]:
            raise SceneError(
                f"actuators[{i}]: dof {actuator.dof} is outside the joint of body {actuator.body!r}"
            )
        out.append(tree.bodies[body].dofs[actuator.dof])
    return tuple(out)


def _spring_ends(springs: Sequence[Spring], places: Mapping[str, int]) -> tuple[tuple[int, int], ...]:
    """The bodies at the two ends of every spring."""
    out = []
    for i, spring in enumerate(springs):
        a = _index(places, spring.body_a, "body", f"springs[{i}], body_a")
        b = _index(places, spring.body_b, "body", f"springs[{i}], body_b")
        if a == b:
            raise SceneError(f"springs[{i}]: both ends are on {spring.body_a!r}; a spring needs two bodies, "
                             "or a body and the world (None)")  # fmt: skip
        out.append((a, b))
    return tuple(out)


def _joined(tendons: Sequence[Tendon], bodies: Sequence[Body]) -> tuple[tuple[int, ...], ...]:
    """The degrees of freedom of every tendon, ascending."""
    places = {name: i for i, name in enumerate(state_names(bodies)[: len(state_names(bodies)) // 2])}
    for i, tendon in enumerate(tendons):
        for names, what in ((places, "coordinate"), ([body.name for body in bodies], "body")):
            if tendon.name in names:
                raise SceneError(f"tendons[{i}]: {tendon.name!r} is the name of a {what}; another is needed")
        if "#" in tendon.name:
            raise SceneError(
                f"tendons[{i}]: name is {tendon.name!r}; # counts controls, a name without is needed"
            )
    label = "tendon {!r}, coordinates"
    return tuple(
        tuple(sorted(_index(places, name, "coordinate", label.format(t.name)) for name in t.coordinates))
        for t in tendons
    )


def _index(places: Mapping[str, int], name: str | None, what: str, field_name: str) -> int:
    if name is None:
        return WORLD
    if name not in places:
        raise SceneError(f"{field_name}: no {what} named {name!r}; there are {shown(list(places))}")
    return places[name]


def _places(items: Sequence[Any], what: str) -> dict[str, int]:
    """Where each name is; they must be unique."""
    places: dict[str, int] = {}
    for i, item in enumerate(items):
        if item.name in places:
            raise SceneError(f"{what}: {what}[{places[item.name]}] and {what}[{i}] are both named "
                             f"{item.name!r}; names must be unique (parts of `box` are named by its own "
                             "name and one or two digits)")  # fmt: skip
        places[item.name] = i
    return places


def _check_limits(body: Body) -> None:
    for i in range(JOINTS[body.joint]):
        lower, upper = spread(body.lower, i, -math.inf), spread(body.upper, i, math.inf)
        if lower > upper:
            raise SceneError(f"body {body.name!r}: lower is {lower}, above upper, {upper}; "
                             "at most as much is needed")  # fmt: skip


def _check_sharp(contact: Contact, a: Shape, b: Shape) -> None:
    """Raise SceneError for a rectangle and another shape whose corners are both points."""

    def rounds(shape: Shape) -> float:
        return shape.corner_radius if shape.kind == RECTANGLE else radii(shape)[0]

    kinds = (a.kind, b.kind)
    if RECTANGLE in kinds and not set(WALLS) & set(kinds) and rounds(a) == rounds(b) == 0.0:
        raise SceneError(
            f"contact {contact.shape_a!r} - {contact.shape_b!r}: both have sharp corners, and two points "
            "that touch have no normal; one of them needs a radius (of rectangles: corner_radius) > 0"
        )


def _check_fits(contact: Contact, a: Shape, b: Shape) -> None:
    """Raise SceneError for a ring and what is no smaller."""
    ring, other = (a, b) if a.kind == RING else (b, a)
    if ring.kind != RING:
        return
    size = other.corner_radius if other.kind == RECTANGLE else radii(other)[0]
    if size >= (hole := radii(ring)[0]):
        raise SceneError(
            f"contact {contact.shape_a!r} - {contact.shape_b!r}: {other.name!r} has a radius of {size}, and "
            f"ring {ring.name!r} of {hole}; what is in a ring is smaller"
        )


def _check_pair(contact: Contact, a: ShapeStructure, b: ShapeStructure) -> None:
    label = f"contact {contact.shape_a!r} - {contact.shape_b!r}"
    if a.kind in WALLS and b.kind in WALLS:
        what = "half-planes" if a.kind == b.kind == HALFPLANE else f"a {a.kind} and a {b.kind}"
        raise SceneError(f"{label}: both are {what}; at least one shape must be round")
    if {a.kind, b.kind} == {RING, ELLIPSE}:
        raise SceneError(f"{label}: a ring and an ellipse cannot touch; "
                         "a ring touches discs, capsules, rectangles")  # fmt: skip
    if ELLIPSE in (a.kind, b.kind) and {a.kind, b.kind} & set(SIDED):
        side = a.kind if a.kind in SIDED else b.kind
        raise SceneError(f"{label}: a {side} and an ellipse cannot touch; "
                         f"a {side} touches half-planes, discs, capsules, rectangles")  # fmt: skip
    if a.body == b.body:
        raise SceneError(
            f"{label}: both shapes are on the same body; a pair needs two bodies, or a body and the world"
        )
