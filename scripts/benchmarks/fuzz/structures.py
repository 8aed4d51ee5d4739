"""Random scenes: planar trees with every joint, shape, limit, spring and actuator; the generator seeds them.

A scene here is a topology with legal numbers; `draws.py` gives every world numbers of its own.
"""

import dataclasses
import inspect
from typing import Any

import numpy as np

from slcp_warp import Actuator, Body, Contact, Scene, Shape, Spring, Tendon, box
from slcp_warp.description.names import state_names
from slcp_warp.description.topology import contact_ends

Rng = np.random.Generator
JOINTS = {"revolute": 1, "prismatic": 1, "free": 3}
ROUND = ("disc", "point", "ellipse", "capsule", "box")


@dataclasses.dataclass(frozen=True)
class Size:
    """How large a scene may be: bodies, contacts asked for, rows."""

    bodies: int = 8
    contacts: int = 5
    rows: int = 60


SMALL = Size(bodies=3, contacts=3, rows=12)


def random_scene(rng: Rng, name: str, size: Size = Size()) -> Scene:
    """A scene of at most this size; drawn again where a draw is too large."""
    while True:
        bodies = tuple(_bodies(rng, int(rng.integers(1, size.bodies + 1))))
        shapes = _shapes(rng, bodies)
        contacts = _contacts(
            rng, shapes, int(rng.integers(0 if rng.random() < 0.1 else 1, size.contacts + 1))
        )
        used = {n for c in contacts for n in (c.shape_a, c.shape_b)}
        scene = _assembled(rng, name, bodies, tuple(s for s in shapes if s.name in used), contacts=contacts)
        if scene.structure.nr <= size.rows:
            return scene


def random_auto(rng: Rng, name: str, size: Size = Size()) -> Scene:
    """A scene in which everything may touch everything, of at most twice as many rows."""
    while True:
        bodies = tuple(_bodies(rng, int(rng.integers(3, size.bodies + 1))))
        no = str(rng.choice(["capsule", "ellipse"]))  # these do not touch each other
        shapes = tuple(s for s in _shapes(rng, bodies) if s.kind != no)
        friction = None if rng.random() < 0.2 else 0.5
        scene = _assembled(rng, name, bodies, shapes, contacts="auto", friction=friction)
        if 0 < scene.structure.nr <= 2 * size.rows:
            return scene


def random_blocks(rng: Rng, name: str, size: Size = Size()) -> Scene:
    """A scene with rectangles in place of its ellipses and of half of its other round shapes."""
    while True:
        scene = random_scene(rng, name, size)
        shapes = tuple(
            dataclasses.replace(s, kind="rectangle", radius=(0.2, 0.1), corner_radius=0.03)
            if s.kind == "ellipse" or (s.kind != "halfplane" and rng.random() < 0.5) else s
            for s in scene.shapes
        )  # fmt: skip
        out = dataclasses.replace(scene, shapes=shapes)
        if out.structure.nr <= 2 * size.rows and any(s.kind == "rectangle" for s in shapes):
            return out


def random_rings(rng: Rng, name: str, size: Size = Size()) -> Scene:
    """A scene with rings in place of its half-planes and of some of its discs, around what is no ellipse;
    with rectangles or with restitution in a quarter of the draws each.
    """
    while True:
        kind = rng.random()
        draw = random_blocks if kind < 0.25 else random_bouncers if kind < 0.5 else random_scene
        scene = draw(rng, name, size)
        rings = {
            s.name for s in scene.shapes if s.kind == "halfplane" or (s.kind == "disc" and rng.random() < 0.2)
        }
        shapes = tuple(
            dataclasses.replace(s, kind="ring", radius=1.0) if s.name in rings
            else dataclasses.replace(s, kind="disc", radius=0.2) if s.kind == "ellipse" else s
            for s in scene.shapes
        )  # fmt: skip
        contacts = tuple(c for c in scene.all_contacts if len({c.shape_a, c.shape_b} & rings) < 2)
        if any({c.shape_a, c.shape_b} & rings for c in contacts):
            return dataclasses.replace(scene, shapes=shapes, contacts=contacts)


def random_bouncers(rng: Rng, name: str, size: Size = Size()) -> Scene:
    """A scene, half of whose contacts have a coefficient of restitution, one of them at least; with
    rectangles in half of the draws.
    """
    while True:
        scene = (random_blocks if rng.random() < 0.5 else random_scene)(rng, name, size)
        contacts = tuple(
            dataclasses.replace(c, restitution=0.5) if rng.random() < 0.5 else c
            for c in scene.all_contacts
        )  # fmt: skip
        if any(c.restitution for c in contacts):
            return dataclasses.replace(scene, contacts=contacts)


def random_runners(rng: Rng, name: str, size: Size = Size()) -> Scene:
    """A scene, half of whose shapes have a surface that runs with a coordinate, where one may, at least one
    of them; with rectangles or restitution in half of the draws.
    """
    while True:
        kind = rng.random()
        draw = random_blocks if kind < 0.25 else random_bouncers if kind < 0.5 else random_scene
        scene = draw(rng, name, size)
        hangs = {body.name: body.parent for body in scene.bodies}
        simple = [body.name for body in scene.bodies if JOINTS[body.joint] == 1]

        def chain(body: str | None, hangs: dict[str, Any] = hangs) -> list[str]:
            return [] if body is None else [body, *chain(hangs[body])]

        shapes = []
        for shape in scene.shapes:
            own = chain(shape.body)
            may = [d for d in simple if d not in own and (not own or chain(d)[-1] == own[-1])]
            if may and rng.random() < 0.5:
                driver, ratio = str(rng.choice(may)), float(rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 2.0))
                shape = dataclasses.replace(shape, driven_by=driver, surface_ratio=ratio)
            shapes.append(shape)
        if any(shape.driven_by for shape in shapes):
            return dataclasses.replace(scene, shapes=tuple(shapes))


def random_tendons(rng: Rng, name: str, size: Size = Size()) -> Scene:
    """A scene with one to three tendons, each of one to three coordinates, and actuators that pull at half of
    them; with rectangles or with restitution in a quarter of the draws each.
    """
    kind = rng.random()
    draw = random_blocks if kind < 0.25 else random_bouncers if kind < 0.5 else random_scene
    scene = draw(rng, name, size)
    there, tendons = state_names(scene.bodies)[: scene.nv], list[Tendon]()
    while not tendons or (len(tendons) < 3 and rng.random() < 0.4):
        count = min(len(there), int(rng.integers(1, 4)))
        chosen = tuple(there[j] for j in sorted(rng.permutation(len(there))[:count]))
        tendons.append(Tendon(f"tendon{len(tendons)}", chosen, (1.0,) * count, 1.0, 1.0))
    pulled = (Actuator(tendon=t.name) for t in tendons if rng.random() < 0.5)
    return dataclasses.replace(scene, tendons=tuple(tendons), actuators=(*scene.actuators, *pulled))


def random_limited(rng: Rng, name: str, size: Size = Size()) -> Scene:
    """The same, where the force of most tendons has a limit."""
    scene = random_tendons(rng, name, size)
    has = [i == 0 or rng.random() < 0.7 for i in range(len(scene.tendons))]
    limited = (dataclasses.replace(t, force_limit=1.0) if on else t for t, on in zip(scene.tendons, has))
    return dataclasses.replace(scene, tendons=tuple(limited))


def _assembled(
    rng: Rng, name: str, bodies: tuple[Body, ...], shapes: tuple[Shape, ...], **touching: Any
) -> Scene:
    """The scene of bodies and shapes, with actuators, springs and rules of damping and stiffness."""
    names = [b.name for b in bodies]
    arguments: dict[str, Any] = {}
    known = inspect.signature(Scene).parameters
    if "implicit_damping" in known:
        arguments["implicit_damping"] = bool(rng.random() < 0.75)
    if "implicit_stiffness" in known:  # drawn aside: what else a scene is drawn as stays what it is
        arguments["implicit_stiffness"] = bool(rng.spawn(1)[0].random() < 0.75)
    return Scene(
        name, bodies, shapes,
        actuators=tuple(Actuator(n, int(rng.integers(JOINTS[b.joint])), 1.0)
                        for n, b in zip(names, bodies) if rng.random() < 0.5),
        springs=tuple(_springs(rng, names)), **arguments, **touching,
    )  # fmt: skip


def _bodies(rng: Rng, count: int) -> list[Body]:
    out: list[Body] = []
    for i in range(count):
        joint = str(rng.choice(list(JOINTS), p=(0.35, 0.3, 0.35)))
        n = JOINTS[joint]
        parent = None if not out or rng.random() < 0.4 else str(rng.choice([b.name for b in out]))

        def some(chance: float, value: float, n: int = n) -> tuple[float | None, ...]:
            return tuple(value if rng.random() < chance else None for _ in range(n))

        out.append(Body(f"body{i}", 1.0, 0.1, parent, joint, angle=0.1, lower=some(0.25, -1.0),
                        upper=some(0.25, 1.0), stiffness=some(0.12, 1.0)))  # fmt: skip
    return out


def _shapes(rng: Rng, bodies: tuple[Body, ...]) -> tuple[Shape, ...]:
    holders: list[str | None] = [b.name for b in bodies for _ in range(int(rng.integers(1, 3)))]
    holders += [None] * int(rng.integers(1, 3))
    out: list[Shape] = []
    for i, holder in enumerate(holders):
        plane = rng.random() < (0.75 if holder is None else 0.15)
        kind = "halfplane" if plane else str(rng.choice(ROUND))
        angle = 0.0 if rng.random() < 0.2 else 0.5
        if kind == "box":
            out += box(f"box{i}.", holder, 0.4, 0.2, 0.0)[: int(rng.integers(2, 5))]
        elif kind == "point":
            out.append(Shape(f"shape{i}", holder, "disc", 0.0, angle=angle))
        else:
            radius = {"disc": 0.2, "ellipse": (0.3, 0.2), "capsule": (0.1, 0.2), "halfplane": 0.0}[kind]
            out.append(Shape(f"shape{i}", holder, kind, radius, angle=angle))  # type: ignore[arg-type]
    return tuple(out)


def _contacts(rng: Rng, shapes: tuple[Shape, ...], count: int) -> tuple[Contact, ...]:
    """Pairs of shapes that may touch; the corners of a box come together."""
    pairs = []
    for i, a in enumerate(shapes):
        for b in shapes[i + 1 :]:
            kinds = {a.kind, b.kind}
            if a.body != b.body and kinds != {"halfplane"} and kinds != {"capsule", "ellipse"}:
                pairs.append((a, b) if rng.random() < 0.5 else (b, a))
    groups: dict[tuple[str, str], list[tuple[Shape, Shape]]] = {}
    for a, b in pairs:
        groups.setdefault((a.name.split(".")[0], b.name.split(".")[0]), []).append((a, b))
    out: list[Contact] = []
    keys = list(groups)
    for k in rng.permutation(len(keys))[:count]:
        friction = None if rng.random() < 0.25 else 0.5
        out += [Contact(a.name, b.name, friction) for a, b in groups[keys[k]]]
    return tuple(out)


def _springs(rng: Rng, names: list[str]) -> list[Spring]:
    out = []
    while rng.random() < 0.25:
        ends: list[str | None] = [*names, None]
        a, b = rng.permutation(len(ends))[:2]
        out.append(Spring(ends[a], ends[b], stiffness=1.0, damping=1.0, length=0.3))
    return out


def baked(scene: Scene, numbers: dict[str, Any], sigma: float | None = None) -> Scene:
    """The scene with one world's numbers (each of its parameter's shape) as its own; limits that exclude each
    other, which a scene refuses, become one limit.
    """

    def flat(value: Any) -> Any:
        return tuple(float(x) for x in np.ravel(value))

    bodies, shapes, contacts, springs, at, pair = [], [], [], [], 0, 0
    for i, b in enumerate(scene.bodies):
        dofs = range(at, at + JOINTS[b.joint])
        at += len(dofs)

        def kept(old: Any, name: str, at_least: str = "", dofs: range = dofs) -> Any:
            if old is None or name not in numbers:
                return old
            olds = old if isinstance(old, tuple) else (old,) * len(dofs)
            values = np.maximum(numbers[name], numbers[at_least or name])
            return tuple(None if o is None else float(values[j]) for o, j in zip(olds, dofs))

        bodies.append(dataclasses.replace(
            b, mass=float(numbers["mass"][i]), inertia=float(numbers["inertia"][i]),
            anchor=flat(numbers["anchor"][i]), angle=float(numbers["angle"][i]),
            axis=flat(numbers["axis"][i]), com=flat(numbers["com"][i]),
            damping=flat([numbers["damping"][j] for j in dofs]),
            stiffness=kept(b.stiffness, "stiffness"),
            armature=kept(b.armature, "armature"), lower=kept(b.lower, "lower"),
            upper=kept(b.upper, "upper", "lower"),
            rest=flat([numbers["rest"][j] for j in dofs]) if "rest" in numbers else b.rest,
        ))  # fmt: skip
    for i, shape in enumerate(scene.shapes):
        radius, two = flat(numbers["radius"][i]), shape.kind in ("ellipse", "capsule", "rectangle")
        corner = float(numbers["corner_radius"][i]) if shape.kind == "rectangle" else 0.0
        ratio = float(numbers["surface_ratio"][i]) if shape.driven_by else shape.surface_ratio
        shapes.append(dataclasses.replace(
            shape, radius=radius if two else radius[0], corner_radius=corner, surface_ratio=ratio,
            offset=flat(numbers["shape_offset"][i]), angle=float(numbers["shape_angle"][i]),
        ))  # fmt: skip
    for contact in scene.all_contacts:
        own: dict[str, Any] = {
            name: float(numbers[name][pair])
            for name in ("friction", "restitution")
            if getattr(contact, name) is not None and name in numbers
        }
        contacts.append(dataclasses.replace(contact, **own))
        pair += len(contact_ends(scene.shapes, contact))
    for i, spring in enumerate(scene.springs):
        ends = numbers["spring_point"][i]
        springs.append(dataclasses.replace(
            spring, point_a=flat(ends[0]), point_b=flat(ends[1]),
            stiffness=float(numbers["spring_stiffness"][i]), damping=float(numbers["spring_damping"][i]),
            length=float(numbers["spring_length"][i]),
        ))  # fmt: skip
    tendons, at = [], 0
    for i, tendon in enumerate(scene.tendons):
        end = at + len(tendon.coordinates)
        given: dict[str, Any] = {
            name: float(numbers[f"tendon_{name}"][i]) for name in ("stiffness", "damping", "length")
        }
        if tendon.force_limit is not None:
            given |= {n: float(numbers[f"tendon_{n}"][i]) for n in ("force_limit", "force_sigma")}
        tendons.append(dataclasses.replace(
            tendon, coordinates=tuple(sorted(tendon.coordinates, key=scene.state_index)),
            coefficients=flat(numbers["tendon_coefficient"][at:end]), **given,
        ))  # fmt: skip
        at = end
    actuators = tuple(
        dataclasses.replace(a, gear=float(numbers["gear"][i])) for i, a in enumerate(scene.actuators)
    )
    level = float(np.ravel(numbers["sigma"])[0]) if np.size(numbers["sigma"]) else scene.sigma
    return dataclasses.replace(
        scene, bodies=tuple(bodies), shapes=tuple(shapes), contacts=tuple(contacts), actuators=actuators,
        springs=tuple(springs), tendons=tuple(tendons), gravity=flat(numbers["gravity"]),
        step_size=float(numbers["step_size"]), sigma=level if sigma is None else sigma,
    )  # fmt: skip
