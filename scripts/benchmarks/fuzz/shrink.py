"""Making a failing case small: parts are dropped and numbers made plain while it goes on failing alike. Every
function of SIMPLER lists makers of cases that lack one thing more.
"""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from slcp_warp import Body, Contact, Shape

from .case import Case
from .structures import JOINTS
from .verdicts import SILENT, WRONG

ROUNDS = 6
Makers = list[Callable[[], Case]]
PLAIN: dict[str, Any] = {
    "com": (0.0, 0.0), "damping": 0.0, "anchor": (0.0, 0.0), "angle": 0.0, "mass": 1.0, "inertia": 0.1,
}  # fmt: skip
NUMBERS = ("mass", "inertia", "com", "anchor", "angle", "damping", "lower", "upper", "stiffness", "rest",
           "armature")  # fmt: skip


def changed(case: Case, x: np.ndarray | None = None, u: np.ndarray | None = None, **changes: Any) -> Case:
    """The case with other parts of its scene; as many noise levels as there are rows then."""
    scene = dataclasses.replace(case.scene, **changes)
    old = case.numbers["sigma"]
    sigma = np.resize(old if old.size else np.ones(1), scene.structure.nr)
    return dataclasses.replace(case, scene=scene, numbers=case.numbers | {"sigma": sigma},
                               x=case.x if x is None else x, u=case.u if u is None else u)  # fmt: skip


def _body(case: Case, i: int, **changes: Any) -> Case:
    bodies = list(case.scene.bodies)
    bodies[i] = dataclasses.replace(bodies[i], **changes)
    return changed(case, bodies=tuple(bodies))


def _used(shapes: tuple[Shape, ...], contacts: tuple[Contact, ...]) -> tuple[Shape, ...]:
    names = {name for c in contacts for name in (c.shape_a, c.shape_b)}
    return tuple(shape for shape in shapes if shape.name in names)


def _without_contact(case: Case, i: int) -> Case:
    kept = case.scene.all_contacts[:i] + case.scene.all_contacts[i + 1 :]
    return changed(case, contacts=kept, shapes=_used(case.scene.shapes, kept))


def _without_body(case: Case, i: int) -> Case:
    """A body less, with all that hangs on it."""
    scene = case.scene
    gone: set[str | None] = {scene.bodies[i].name}
    for body in scene.bodies:
        if body.parent in gone:
            gone.add(body.name)
    shapes = tuple(s for s in scene.shapes if s.body not in gone)
    names = {s.name for s in shapes}
    contacts = tuple(c for c in scene.all_contacts if {c.shape_a, c.shape_b} <= names)
    left = {name for b in scene.bodies if b.name not in gone for name in scene.state_names[: scene.nv]
            if name.rpartition(".")[0] == b.name}  # fmt: skip
    tendons = tuple(t for t in scene.tendons if set(t.coordinates) <= left)
    pulled = {t.name for t in tendons}
    kept = [k for k, a in enumerate(scene.actuators)
            if (a.body is not None and a.body not in gone) or a.tendon in pulled]  # fmt: skip
    dofs = [j for j, b in enumerate(scene.structure.dof_body) if scene.bodies[b].name not in gone]
    limits = {name: case.numbers[name][dofs] for name in ("lower", "upper")}
    x = np.concatenate([case.x[: scene.nv][dofs], case.x[scene.nv :][dofs]])
    return changed(
        dataclasses.replace(case, numbers=case.numbers | limits), x, case.u[..., kept],
        bodies=tuple(b for b in scene.bodies if b.name not in gone), contacts=contacts,
        shapes=_used(shapes, contacts), actuators=tuple(scene.actuators[k] for k in kept),
        springs=tuple(s for s in scene.springs if not {s.body_a, s.body_b} & gone), tendons=tendons,
    )  # fmt: skip


def _later(case: Case, steps: int) -> Case:
    """The case from the state after so many of its steps on, without what these remember."""
    return dataclasses.replace(case, x=case.states()[steps], u=case.u[steps:])


def steps(case: Case) -> Makers:
    """Fewer of the steps before the one that fails: none, half, one less."""
    before = len(case.u) - 1 if case.u.ndim == 2 else 0
    return [partial(_later, case, n) for n in dict.fromkeys((before, before // 2, min(1, before))) if n]


def contacts(case: Case) -> Makers:
    """One contact less, with the shapes that only it used."""
    return [partial(_without_contact, case, i) for i in range(len(case.scene.all_contacts))]


def bodies(case: Case) -> Makers:
    """One body less."""
    count = len(case.scene.bodies)
    return [partial(_without_body, case, i) for i in range(count)] if count > 1 else []


def parts(case: Case) -> Makers:
    """A spring, a tendon that nothing pulls at, an actuator, a limit, a joint spring or a friction less."""
    scene = case.scene
    out: Makers = []
    for i in range(len(scene.springs)):
        out.append(partial(changed, case, springs=scene.springs[:i] + scene.springs[i + 1 :]))
    for i, tendon in enumerate(scene.tendons):
        if all(a.tendon != tendon.name for a in scene.actuators):
            out.append(partial(changed, case, tendons=scene.tendons[:i] + scene.tendons[i + 1 :]))
    for i in range(len(scene.actuators)):
        kept = scene.actuators[:i] + scene.actuators[i + 1 :]
        out.append(partial(changed, case, u=np.delete(case.u, i, -1), actuators=kept))
    for i, body in enumerate(scene.bodies):
        for name in ("lower", "upper", "stiffness"):
            value = getattr(body, name)
            spread = value if isinstance(value, tuple) else (value,) * JOINTS[body.joint]
            for j in (j for j, one in enumerate(spread) if one is not None):
                out.append(partial(_body, case, i, **{name: (*spread[:j], None, *spread[j + 1 :])}))
    for i, contact in enumerate(scene.all_contacts):
        if contact.friction is not None:
            plain = dataclasses.replace(contact, friction=None)
            out.append(partial(changed, case, contacts=_with(scene.all_contacts, i, plain)))
    return out


def _with(items: tuple[Any, ...], i: int, item: Any) -> tuple[Any, ...]:
    return (*items[:i], item, *items[i + 1 :])


def _state(case: Case, i: int, value: float) -> Case:
    x = case.x.copy()
    x[i] = value
    return dataclasses.replace(case, x=x)


def zeros(case: Case) -> Makers:
    """A number of the state or the scene that is zero or one."""
    scene = case.scene
    out: Makers = []
    for i, value in enumerate(case.x):
        if value != 0.0:
            out.append(partial(_state, case, i, 0.0))
    for i, body in enumerate(scene.bodies):
        for name, plain in PLAIN.items():
            if np.any(np.asarray(getattr(body, name)) != np.asarray(plain)):
                out.append(partial(_body, case, i, **{name: plain}))
    if any(scene.gravity):
        out.append(partial(changed, case, gravity=(0.0, 0.0)))
    for i, shape in enumerate(scene.shapes):
        if any(shape.offset):
            moved = dataclasses.replace(shape, offset=(0.0, 0.0))
            out.append(partial(changed, case, shapes=_with(scene.shapes, i, moved)))
    return out


def short(value: Any) -> Any:
    """A number, or all of a tuple, with two digits, exact in float32."""
    if isinstance(value, tuple):
        return tuple(short(v) for v in value)
    return float(np.float32(f"{value:.2g}")) if isinstance(value, float) else value


def digits(case: Case) -> Makers:
    """A number of the state, or a body's or shape's numbers, with two digits."""
    scene = case.scene
    out: Makers = []
    for i, value in enumerate(case.x):
        if short(float(value)) != value:
            out.append(partial(_state, case, i, short(float(value))))
    for i, body in enumerate(scene.bodies):
        new = _shorter(body, NUMBERS)
        if new:
            out.append(partial(_body, case, i, **new))
    for i, shape in enumerate(scene.shapes):
        new = _shorter(shape, ("offset", "angle", *(() if shape.kind == "rectangle" else ("radius",))))
        if new:
            plain = dataclasses.replace(shape, **new)
            out.append(partial(changed, case, shapes=_with(scene.shapes, i, plain)))
    return out


def _shorter(part: Body | Shape, names: tuple[str, ...]) -> dict[str, Any]:
    """Fields that change when they get two digits."""
    new = {name: short(getattr(part, name)) for name in names}
    return {name: value for name, value in new.items() if value != getattr(part, name)}


SIMPLER = (steps, contacts, bodies, parts, zeros, digits)


def kind_of(case: Case) -> tuple[str, str]:
    """Verdict and the words of its reason, without numbers."""
    verdict, reason = case.verdict
    return verdict, reason.split(" by ")[0]


def shrink(case: Case, failing: Callable[[Case], bool] | None = None, tries: int = 200) -> Case:
    """The smallest case found that fails (None: in the way that this one does); `tries` at most are run."""
    if failing is None:
        kind = kind_of(case)
        if kind[0] not in (SILENT, WRONG):
            return case  # alone it does not fail

        def failing(smaller: Case) -> bool:
            return kind_of(smaller) == kind

    for _ in range(ROUNDS):
        before = case
        for simpler in SIMPLER:
            place = 0
            while place < len(options := simpler(case)) and tries > 0:
                tries -= 1
                smaller = _attempt(options[place], failing)
                if smaller is None:
                    place += 1
                else:
                    case = smaller
        if case is before:
            break
    return case


def _attempt(make: Callable[[], Case], failing: Callable[[Case], bool]) -> Case | None:
    """The case that is made if it is legal and fails."""
    try:
        case = make()
        return case if failing(case) else None
    except (ValueError, RuntimeError, ArithmeticError):
        return None
