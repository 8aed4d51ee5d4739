"""Planar scenes from MJCF, read off the model that the `mujoco` package compiles (extra `mjcf`).

MuJoCo resolves defaults, includes and angles; what it compiled is mapped to a `Scene` where that is exact,
and refused by name where it is not; what equality constraints hold, springs hold that yield next to nothing.
Solver settings (solref, solimp, margins, integrator) and the ranges of controls, which are a task's, are not
read. docs/reference/scene_files.md has the table.
"""

import os
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...inputs import checks
from ...storage.files import reading
from ..names import DOFS
from ..parts import Actuator, Body, Spring, Tendon
from ..scene import Scene
from .additions import with_brakes, with_contacts
from .at_rest import AtRest, start_of
from .bounds import check_bounds
from .contacts import read_contacts
from .equalities import Equalities, joints_held, warn_of_start
from .joints import Joints, Link
from .limits import is_alike, limited, limited_tendon
from .motors import TENDON, Coordinate, force_limits, gain_of, servos
from .names import Names, named
from .plane import MjcfError, Place, Plane, angle_of, plane_of
from .refused import EQUALITIES, FRICTIONLOSS, TENDONS, WORDS, is_disabled, refuse_what_is_missing
from .strings import Strings, is_straight, read_strings
from .tendons import joints_of, read_tendons

# Mass and inertia of a body that a joint has for itself, of those of the body that it carries: less than
# double precision sees beside them. Any from 1e-6 to 1e-30 is solved alike.
SHARE = 1e-15
ALIKE = 1e-9  # `AtRest.independence` of joints that move a body in the same way

__all__ = ["MjcfError", "load_mjcf", "mjcf_control_limits"]


def load_mjcf(
    path: str | os.PathLike[str],
    plane: str | None = None,
    left_out: Sequence[str] = (),
    corner_radius: float = 0.0,
    brakes: bool = False,
) -> Scene:
    """Read a planar mechanism from an MJCF file.

    A RuntimeWarning says which equality constraints do not hold at the start, which has a jerk then.

    Args:
        plane: "xz" (x right, z up) or "xy", the plane of motion; None: "xy" where all hinges turn about z,
            else "xz". Angles count counter-clockwise in it, so that a hinge about +y of an "xz" model changes
            its sign. q = 0: the joints' reference positions.
        left_out: of what would be refused, as it has no counterpart ("frictionloss", "tendons", "density",
            "equality constraints", .., as errors name it), what the scene is to do without: it is another
            mechanism then.
        corner_radius: of boxes, within their size: MuJoCo's are sharp, two that touch each other need some
            [m].
        brakes: make the dry friction of joints, "frictionloss", that of a `brake` each: one more body and
            coordinate, behind the others.

    Raises:
        MjcfError: a file that MuJoCo does not compile, an element that is not planar or not supported, or a
            model that grows too large (`bounds`).
        FileNotFoundError: no such file.
        ImportError: the package mujoco is not installed.
    """
    path, chosen = checks.path("path", path), None if plane is None else Plane(plane)
    left_out = (left_out,) if isinstance(left_out, str) else left_out
    for word in checks.instance("left_out", left_out, list | tuple, "a tuple of words"):
        checks.choice("left_out", word, WORDS)
    checks.number("corner_radius", corner_radius, 0.0)
    mujoco = _package()
    with reading(path, "MJCF", MjcfError):
        model = _model(mujoco, path)
        refuse_what_is_missing(model, left_out, lambda field, i: _is_made(model, field, i, brakes))
        reader = _Reader(model, chosen or Plane(plane_of(model)), corner_radius, left_out)
        scene = reader.scene(model.names.split(b"\0")[0].decode() or path.stem)
    warn_of_start(reader.missed, path.name)
    return scene


def mjcf_control_limits(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray]:
    """The ranges of a model's controls (`ctrlrange`, and of motors `forcerange` over their gain), in the
    order of the scene's that `load_mjcf` reads: (lower, upper), each (nu,), infinite where a control has
    none; for `Task.control_limits`.

    Raises:
        MjcfError: a file that MuJoCo does not compile.
        FileNotFoundError: no such file.
        ImportError: the package mujoco is not installed.
    """
    path = checks.path("path", path)
    mujoco = _package()
    with reading(path, "MJCF", MjcfError):
        model = _model(mujoco, path)
    limited = np.asarray(model.actuator_ctrllimited, bool)
    ends = np.asarray(model.actuator_ctrlrange, float).reshape(-1, 2).T
    lower, upper = np.where(limited, ends[0], -np.inf), np.where(limited, ends[1], np.inf)
    forces = force_limits(model)
    return np.maximum(lower, forces[0]), np.minimum(upper, forces[1])


def _is_made(m: Any, field: str, i: int, brakes: bool) -> bool:
    """Whether something here stands for what a field of a MuJoCo model has at a place."""
    if field == "actuator_forcelimited":
        return is_alike(m, i)
    return (field == "dof_frictionloss" and brakes) or (field == "tendon_limited" and is_straight(m, i))


def _package() -> Any:
    try:
        import mujoco
    except ImportError as error:
        raise ImportError("reading MJCF needs the package mujoco: pip install 'slcp-warp[mjcf]'") from error
    return mujoco


def _model(mujoco: Any, path: Path) -> Any:
    """The model that MuJoCo compiles from a file, bounded before."""
    check_bounds(path)
    return mujoco.MjModel.from_xml_path(str(path))


class _Reader:
    def __init__(self, model: Any, plane: Plane, corner_radius: float, left_out: Collection[str]) -> None:
        self.left_out, self.names, self.at_rest = left_out, Names(model), AtRest(model)
        self.m, self.plane, self.corner_radius = model, plane, corner_radius
        self.turns: list[np.ndarray] = []  # our degrees of freedom by MuJoCo's, of each body with joints
        self.coordinates: dict[int, Coordinate] = {}  # of every joint
        self.depth: dict[int, float] = {0: 0.0}  # of every MuJoCo body, along the normal
        self.place: dict[int, Place] = {0: Place(None, np.eye(2), np.zeros(2))}  # of every MuJoCo body
        self.apart: list[tuple[str, str]] = []  # bodies here that several joints tie to each other
        self.welded: dict[str, list[tuple[float, np.ndarray, float]]] = {}
        self.limited = dict.fromkeys(limited(model, left_out), "")  # actuators, and their tendons' names
        self.servos = servos(model, self.limited)
        self.joints = Joints(model, plane, self.servos, self._tied())
        self.tendon_names: dict[int, str] = {}  # of fixed ones
        self.springs: tuple[Spring, ...] = ()  # of equality constraints
        self.missed: dict[str, float] = {}  # by how much equality constraints are at the start

    def _tied(self) -> set[int]:
        """The joints that tendons and equality constraints act on."""
        out: set[int] = set()
        if TENDONS not in self.left_out:
            fixed = (i for i in range(self.m.ntendon) if not is_straight(self.m, i))
            out |= {j for i in fixed for j in joints_of(self.m, i)}
        elif any(kind == TENDON for kind, _ in self.servos):
            raise MjcfError("an actuator acts on a tendon, and tendons are left out")
        return out if EQUALITIES in self.left_out else out | joints_held(self.m)

    def scene(self, name: str) -> Scene:
        """The scene of the model."""
        drafts = [draft for b in range(1, self.m.nbody) for draft in self._body(b)]
        bodies = self._with_masses(drafts)
        if not bodies:
            raise MjcfError("the model has no joint; a scene needs a body that moves")
        m = self.m
        q, v = start_of(m)
        sizes = np.cumsum([0, *map(len, self.turns)])
        parts = [slice(a, b) for a, b in zip(sizes[:-1], sizes[1:])]
        state = np.concatenate([t @ x[at] for x in (q - m.qpos0, v) for t, at in zip(self.turns, parts)])
        tendons = self._tendons()
        strings = self._strings()
        scene = Scene(
            name=name,
            bodies=bodies,
            **read_contacts(m, self.plane, self.place, self.depth, bodies, self.apart, self.corner_radius),
            actuators=tuple(self._actuator(i) for i in range(m.nu)),
            tendons=tendons,
            springs=(*self.springs, *strings.springs),
            gravity=(0.0, 0.0) if is_disabled(m, "GRAVITY") else self._gravity(),
            step_size=float(m.opt.timestep),
            initial_state=tuple(state.tolist()),
        )
        scene = with_contacts(scene, strings.shapes, strings.contacts)
        return scene if FRICTIONLOSS in self.left_out else with_brakes(scene, m, self.coordinates)

    def _strings(self) -> Strings:
        """What tendons from one site to another are."""
        if TENDONS in self.left_out:
            return Strings()
        return read_strings(self.m, self.plane, self.place, self.names)

    def _tendons(self) -> tuple[Tendon, ...]:
        """The tendons of the model, and those that stand for its equality constraints."""
        m, own = self.m, TENDONS not in self.left_out
        if own:
            fixed = (i for i in range(m.ntendon) if not is_straight(m, i))
            self.tendon_names = {i: self.names.tendon("tendon", i) for i in fixed}
        out = read_tendons(m, self.tendon_names, self.coordinates, self.servos)
        self.limited = {i: self.names.tendon("actuator", i) for i in self.limited}
        out += tuple(limited_tendon(m, i, name, self.coordinates) for i, name in self.limited.items())
        if EQUALITIES in self.left_out:
            return out
        equalities = Equalities(m, self.plane, self.at_rest, self.place, self.coordinates, self.names, own)
        self.missed, self.springs = equalities.missed, tuple(equalities.springs)
        return (*out, *equalities.tendons)

    def _gravity(self) -> tuple[float, float]:
        """In the plane; what points along its normal alone the joints hold."""
        pull = self.m.opt.gravity
        if not np.any(self.plane.point(pull)):
            return 0.0, 0.0
        return self.plane.vector(pull, "gravity")

    def _body(self, b: int) -> list[dict[str, Any]]:
        """One MuJoCo body as fields of ours, one a joint; none where it is welded to its parent."""
        m, name, above = self.m, named(self.m, "body", b), self.place[int(self.m.body_parentid[b])]
        label = f"body {name!r}"
        axes = above.axes @ self.plane.frame(m.body_quat[b], label)
        at = Place(above.holder, axes, above.point(self.plane.point(m.body_pos[b])))
        self.depth[b] = self.depth[int(m.body_parentid[b])] + above.side * self.plane.depth(m.body_pos[b])
        mass, inertia, com = self._inertia(b)
        if m.body_jntnum[b] == 0:
            self.place[b] = at
            if at.holder is not None:
                self.welded.setdefault(at.holder, []).append((mass, at.point(com), inertia))
            return []
        drafts, links = [], self.joints.links(b, axes)
        if len(links) > 1 and self.at_rest.independence(b) < ALIKE:
            raise MjcfError(f"{label}: its {len(links)} joints move it alike; none may move it as others do")
        for link in links:
            own = name if link is links[-1] else self.names.body_of(link.joints[0])
            draft, at = self._link(link, at, own)
            drafts.append(draft | {"carried": name})
        self.place[b] = at
        if len(links) > 1 and above.holder is not None:
            self.apart.append((above.holder, name))
        drafts[-1]["parts"] = [(mass, at.point(com), inertia)]
        return drafts

    def _link(self, link: Link, at: Place, name: str) -> tuple[dict[str, Any], Place]:
        """A body here of a joint, and where its MuJoCo body is then.

        Args:
            at: where that is without this joint.
        """
        words = DOFS[link.kind]
        self.turns.append(link.turn)
        self.coordinates |= {
            j: Coordinate(name, i, sign, f"{name}.{words[i]}")
            for i, (j, sign) in enumerate(zip(link.joints, link.signs))
        }
        draft = self.joints.fields(link) | {
            "name": name,
            "parent": at.holder,
            "anchor": tuple(at.point(link.pivot).tolist()),
            "angle": angle_of(at.axes),
        }
        if link.kind == "prismatic":
            draft["axis"] = self.joints.axis(link, at.axes)
        mirror = np.diag([1.0, at.side])
        return draft, Place(name, mirror, -mirror @ link.pivot)

    def _inertia(self, b: int) -> tuple[float, float, np.ndarray]:
        """Mass, inertia about the plane's normal through the centre of mass, and that centre in the body."""
        m = self.m
        axes = self.plane.matrix(m.body_iquat[b])
        along = self.plane.normal @ axes
        inertia = float(along**2 @ m.body_inertia[b])
        return float(m.body_mass[b]), inertia, self.plane.point(m.body_ipos[b])

    def _with_masses(self, drafts: list[dict[str, Any]]) -> tuple[Body, ...]:
        """The bodies with the masses welded to them; those that joints have for themselves weigh nothing."""
        out: dict[str, Body] = {}
        for draft in reversed(drafts):
            carried, parts = draft.pop("carried"), draft.pop("parts", [])
            if parts:
                masses = self._sum_of(draft["name"], parts + self.welded.get(draft["name"], []))
            else:
                masses = {"mass": SHARE * out[carried].mass, "inertia": SHARE * out[carried].inertia}
            out[draft["name"]] = Body(**masses, **draft)
        return tuple(reversed(out.values()))

    def _sum_of(self, name: str, parts: list[tuple[float, np.ndarray, float]]) -> dict[str, Any]:
        """Mass, inertia and centre of mass of what is welded together."""
        mass = sum(p[0] for p in parts)
        if mass <= 0.0:
            raise MjcfError(f"body {name!r}: it has no mass; every body that moves needs some")
        com = sum((p[0] * p[1] for p in parts), np.zeros(2)) / mass
        inertia = sum(p[2] + p[0] * float((p[1] - com) @ (p[1] - com)) for p in parts)
        return {"mass": mass, "inertia": inertia, "com": tuple(com.tolist())}

    def _actuator(self, i: int) -> Actuator:
        kind, which, push = gain_of(self.m, i)
        if i in self.limited:
            return Actuator(gear=float(self.m.actuator_gainprm[i, 0]), tendon=self.limited[i])
        if kind == TENDON:
            if which not in self.tendon_names:
                name, its = named(self.m, "actuator", i), named(self.m, "tendon", which)
                raise MjcfError(
                    f"actuator {name!r}: tendon {its!r} is not fixed; actuators pull at those of joints alone"
                )
            return Actuator(gear=push, tendon=self.tendon_names[which])
        at = self.coordinates[which]
        return Actuator(at.body, at.dof, at.sense * push)
