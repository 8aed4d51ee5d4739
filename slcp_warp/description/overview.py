"""A scene in a line, and in tables of its parts."""

from typing import Any

from ..storage.printed import Table, counted
from .auto_contacts import AUTO
from .parts import JOINTS, spread


def scene_line(scene: Any) -> str:
    """Its name and how much there is of everything."""
    s = scene.structure
    parts = [
        counted(len(scene.bodies), "body", "bodies"),
        counted(len(scene.shapes), "shape"),
        counted(len(scene.all_contacts), "contact") + (" (auto)" if scene.contacts == AUTO else ""),
        f"{s.nv} degrees of freedom",
        counted(s.nu, "control"),
        counted(s.nr, "row"),
    ]
    springs = (s.sprung or s.springs or s.tendons) and not scene.implicit_stiffness
    rule = "; explicit springs" if springs else ""
    return f"{scene.name!r}: {', '.join(parts)}; h = {scene.step_size:g} s{rule}"


def scene_tables(scene: Any) -> list[Table]:
    """Bodies, shapes, contacts, actuators, springs and tendons."""

    def world(name: str | None) -> str:
        return "(world)" if name is None else name

    bodies = [
        (b.name, world(b.parent), b.joint, b.mass, b.inertia, b.damping, _limits(b)) for b in scene.bodies
    ]
    shapes = [(sh.name, world(sh.body), sh.kind, sh.radius, sh.offset) for sh in scene.shapes]
    contacts = [
        (c.shape_a, c.shape_b, "none" if c.friction is None else c.friction) for c in scene.all_contacts
    ]
    controls = [(name, a.gear) for name, a in zip(scene.control_names, scene.actuators)]
    springs = [(world(s.body_a), world(s.body_b), s.stiffness, s.damping) for s in scene.springs]
    tendons = [
        (t.name, _sum(t), t.stiffness, t.damping, "none" if t.force_limit is None else t.force_limit)
        for t in scene.tendons
    ]
    return [
        Table("bodies", ("body", "parent", "joint", "mass", "inertia", "damping", "limits"), bodies, left=3),
        Table("shapes", ("shape", "body", "kind", "radius", "offset"), shapes, left=3),
        Table("contacts", ("shape", "and shape", "friction"), contacts, left=2),
        Table("controls", ("control", "gear"), controls),
        Table("springs", ("body", "and body", "stiffness", "damping"), springs, left=2),
        Table("tendons", ("tendon", "length", "stiffness", "damping", "force limit"), tendons, left=2),
    ]


def _limits(body: Any) -> str:
    """The limits of each degree of freedom of a joint that has some."""
    ends = [
        tuple(spread(side, i, None) for side in (body.lower, body.upper)) for i in range(JOINTS[body.joint])
    ]
    shown = ["none" if low is high is None else f"{_end(low)} to {_end(high)}" for low, high in ends]
    return "none" if set(shown) == {"none"} else ", ".join(shown)


def _end(bound: float | None) -> str:
    return "none" if bound is None else f"{bound:g}"


def _sum(tendon: Any) -> str:
    """The length of a tendon, written out."""
    return " + ".join(f"{c:g} {name}" for c, name in zip(tendon.coefficients, tendon.coordinates))
