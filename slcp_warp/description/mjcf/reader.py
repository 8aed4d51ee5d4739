"""Planar scenes from MJCF, read off the model that the `mujoco` package compiles (extra `mjcf`).

MuJoCo resolves defaults, includes and angles; what it compiled is mapped to a `Scene` where that is exact,
and refused by name where it is not. Solver settings (solref, solimp, margins, integrator) and the ranges of
controls, which are a task's, are not read. docs/reference/scene_files.md has the table.
"""

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...inputs import checks
from ...storage.files import reading
from ..parts import Actuator, Body
from ..scene import Scene
from .bounds import check_bounds
from .contacts import read_contacts
from .motors import JOINT, TENDON, Servo, gain_of, servos
from .plane import MjcfError, Plane, named, plane_of
from .refused import TENDONS, WORDS, is_disabled, refuse_what_is_missing
from .tendons import joints_of, name_of, read_tendons

__all__ = ["MjcfError", "load_mjcf", "mjcf_control_limits"]


def load_mjcf(
    path: str | os.PathLike[str],
    plane: str | None = None,
    left_out: Sequence[str] = (),
    corner_radius: float = 0.0,
) -> Scene:
    """Read a planar mechanism from an MJCF file.

    Args:
        plane: "xz" (x right, z up) or "xy", the plane of motion; None: "xy" where all hinges turn about z,
            else "xz". Angles count counter-clockwise in it, so that a hinge about +y of an "xz" model changes
            its sign. q = 0: the joints' reference positions.
        left_out: of what would be refused, as it has no counterpart ("frictionloss", "tendons", "density",
            .., as errors name it), what the scene is to do without: it is another mechanism then.
        corner_radius: of boxes, within their size: MuJoCo's are sharp, two that touch each other need some
            [m].

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
        refuse_what_is_missing(model, left_out)
        reader = _Reader(model, chosen or Plane(plane_of(model)), corner_radius, TENDONS not in left_out)
        return reader.scene(model.names.split(b"\0")[0].decode() or path.stem)


def mjcf_control_limits(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray]:
    """The ranges of a model's controls (`ctrlrange`), in the order of the scene's that `load_mjcf` reads:
    (lower, upper), each (nu,), infinite where a control has none; for `Task.control_limits`.

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
    return np.where(limited, ends[0], -np.inf), np.where(limited, ends[1], np.inf)


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
    def __init__(self, model: Any, plane: Plane, corner_radius: float, tendons: bool) -> None:
        self.tendons = tendons
        self.m, self.plane, self.corner_radius = model, plane, corner_radius
        self.turns: list[np.ndarray] = []  # our degrees of freedom by MuJoCo's, of each body with joints
        self.dof_of_joint: dict[int, tuple[str, int, float]] = {}  # body, place, sense
        self.depth: dict[int, float] = {0: 0.0}  # of every MuJoCo body, along the normal
        # place of every MuJoCo body: (our body or None, turn, origin) in that body's frame
        self.place: dict[int, tuple[str | None, float, np.ndarray]] = {0: (None, 0.0, np.zeros(2))}
        self.welded: dict[str, list[tuple[float, np.ndarray, float]]] = {}
        self.servos: dict[tuple[str, int], Servo] = {}
        self.tied: set[int] = set()  # joints of tendons

    def scene(self, name: str) -> Scene:
        self.servos = servos(self.m)
        if self.tendons:
            self.tied = {j for i in range(self.m.ntendon) for j in joints_of(self.m, i)}
        elif any(kind == TENDON for kind, _ in self.servos):
            raise MjcfError("an actuator acts on a tendon, and tendons are left out")
        drafts = [self._body(b) for b in range(1, self.m.nbody)]
        bodies = tuple(self._with_mass(draft) for draft in drafts if draft is not None)
        if not bodies:
            raise MjcfError("the model has no joint; a scene needs a body that moves")
        m = self.m
        q = m.key_qpos[0] if m.nkey else m.qpos0
        v = m.key_qvel[0] if m.nkey else np.zeros(m.nv)
        sizes = np.cumsum([0, *map(len, self.turns)])
        parts = [slice(a, b) for a, b in zip(sizes[:-1], sizes[1:])]
        state = np.concatenate([t @ x[at] for x in (q - m.qpos0, v) for t, at in zip(self.turns, parts)])
        return Scene(
            name=name,
            bodies=bodies,
            **read_contacts(self.m, self.plane, self.place, self.depth, bodies, self.corner_radius),
            actuators=tuple(self._actuator(i) for i in range(m.nu)),
            tendons=read_tendons(m, bodies, self.dof_of_joint, self.servos) if self.tendons else (),
            gravity=(0.0, 0.0) if is_disabled(m, "GRAVITY") else self._gravity(),
            step_size=float(m.opt.timestep),
            initial_state=tuple(state.tolist()),
        )

    def _gravity(self) -> tuple[float, float]:
        """In the plane; what points along its normal alone the joints hold."""
        pull = self.m.opt.gravity
        if not np.any(self.plane.point(pull)):
            return 0.0, 0.0
        return self.plane.vector(pull, "gravity")

    def _name(self, b: int) -> str:
        return named(self.m, "body", b)

    def _body(self, b: int) -> dict[str, Any] | None:
        """One MuJoCo body as fields of ours, or None where it is welded to its parent."""
        m, name = self.m, self._name(b)
        label = f"body {name!r}"
        parent, turn, origin = self.place[int(m.body_parentid[b])]
        angle = turn + self.plane.turn(m.body_quat[b], label)
        at = origin + _rotate(turn, self.plane.point(m.body_pos[b]))
        self.depth[b] = self.depth[int(m.body_parentid[b])] + self.plane.depth(m.body_pos[b])
        first, count = int(m.body_jntadr[b]), int(m.body_jntnum[b])
        mass, inertia, com = self._inertia(b)
        if count == 0:
            self.place[b] = (parent, angle, at)
            if parent is not None:
                self.welded.setdefault(parent, []).append((mass, at + _rotate(angle, com), inertia))
            return None
        joints = list(range(first, first + count))
        fields, pivot = self._joint(joints, angle, name)
        self.place[b] = (name, 0.0, -pivot)
        return fields | {
            "name": name,
            "parent": parent,
            "anchor": tuple((at + _rotate(angle, pivot)).tolist()),
            "angle": angle,
            "parts": [(mass, com - pivot, inertia)],
        }

    def _joint(self, joints: list[int], angle: float, name: str) -> tuple[dict[str, Any], np.ndarray]:
        """Joint fields, and the joint's place in the body's frame."""
        m, label = self.m, f"body {name!r}"
        kinds = [("free", "ball", "slide", "hinge")[m.jnt_type[j]] for j in joints]
        pivot, signs, axes = np.zeros(2), [], []
        for j, kind in zip(joints, kinds):
            where = f"joint {m.joint(j).name!r}"
            if kind == "hinge":
                signs.append(self.plane.normal_sign(m.jnt_axis[j], where))
                pivot = self.plane.point(m.jnt_pos[j])
            elif kind == "slide":
                signs.append(1.0)
                axes.append(_rotate(angle, np.array(self.plane.vector(m.jnt_axis[j], where))))
            else:
                raise MjcfError(f"{where}: a {kind} joint is not planar; use slide, slide and hinge joints")
        turn, fields = np.diag(signs), dict[str, Any]()
        if kinds == ["hinge"]:
            fields["joint"] = "revolute"
        elif kinds == ["slide"]:
            fields |= {"joint": "prismatic", "axis": tuple(axes[0].tolist())}
        elif kinds == ["slide", "slide", "hinge"]:
            fields["joint"] = "free"
            turn[:2, :2] = np.transpose(axes)
            joints, signs = self._free(joints, signs, turn[:2, :2], label)
        else:
            raise MjcfError(
                f"{label}: joints {kinds}; one hinge, one slide, or slide, slide, hinge are supported"
            )
        self.turns.append(turn)
        self.dof_of_joint |= {j: (name, i, sign) for i, (j, sign) in enumerate(zip(joints, signs))}
        return fields | self._dof_fields(joints, signs), pivot

    def _free(
        self, joints: list[int], signs: list[float], turn: np.ndarray, label: str
    ) -> tuple[list[int], list[float]]:
        """The joints of a free body in the order of the parent's axes that its slides go along, and their
        senses; slides that are turned against these are one as the other, and nothing is said of one alone.
        """
        m = self.m
        if not np.allclose(turn @ turn.T, np.eye(2), atol=1e-9):
            raise MjcfError(
                f"{label}: its slides point along {np.round(turn.T, 6).tolist()}; a free planar body needs "
                "two at right angles"
            )
        along = np.abs(turn).argmax(axis=1)  # the slide of each of our axes
        if np.allclose(np.abs(turn), np.eye(2)[along], atol=1e-9):
            own = [(joints[s], float(np.sign(turn[axis, s]))) for axis, s in enumerate(along)]
            return [*(j for j, _ in own), joints[2]], [*(sign for _, sign in own), signs[2]]
        dofs = [m.jnt_dofadr[j] for j in joints[:2]]
        same = all(np.ptp(values[dofs]) == 0.0 for values in (m.dof_damping, m.dof_armature))
        alone = any(
            m.jnt_limited[j] or m.jnt_stiffness[j] or (JOINT, j) in self.servos or j in self.tied
            for j in joints[:2]
        )
        if alone or not same:
            raise MjcfError(
                f"{label}: its slides are turned against its parent's axes; damping and armature have to be "
                "the same for both, and limits, springs, tendons and actuators along them are not supported"
            )
        return joints, signs

    def _dof_fields(self, joints: list[int], signs: list[float]) -> dict[str, Any]:
        m = self.m
        damping, armature, lower, upper, springs = [], [], [], [], []
        for j, sign in zip(joints, signs):
            dof, q, servo = m.jnt_dofadr[j], m.jnt_qposadr[j], self.servos.get((JOINT, j), Servo())
            damping.append(float(m.dof_damping[dof]) + servo.damping)
            armature.append((float(m.dof_armature[dof]) + servo.armature) or None)
            springs.append(self._spring(j, sign, servo))
            ends = sorted(sign * (float(x) - float(m.qpos0[q])) for x in m.jnt_range[j])
            lower.append(ends[0] if m.jnt_limited[j] else None)
            upper.append(ends[1] if m.jnt_limited[j] else None)
        stiffness, rest = zip(*springs)
        return {
            "damping": tuple(damping), "stiffness": stiffness, "rest": rest,
            "lower": tuple(lower), "upper": tuple(upper), "armature": tuple(armature),
        }  # fmt: skip

    def _spring(self, j: int, sign: float, servo: Servo) -> tuple[float | None, float]:
        """Stiffness and rest of a joint: those of its own spring, or with what a servo adds."""
        m, q = self.m, self.m.jnt_qposadr[j]
        own, rest = float(m.jnt_stiffness[j]), float(m.qpos_spring[q] - m.qpos0[q])
        stiffness = own + servo.stiffness
        push = servo.push - servo.stiffness * float(m.qpos0[q])
        alone = own * rest + push
        if stiffness == 0.0 and alone != 0.0:
            raise MjcfError(
                f"joint {m.joint(j).name!r}: an actuator pushes it by {alone:g} without a control; that is "
                "supported only where a spring or a position servo acts, too"
            )
        if servo.stiffness != 0.0 or push != 0.0:
            rest = (own * rest + push) / stiffness if stiffness != 0.0 else 0.0
        return stiffness or None, sign * rest

    def _inertia(self, b: int) -> tuple[float, float, np.ndarray]:
        """Mass, inertia about the plane's normal through the centre of mass, and that centre in the body."""
        m = self.m
        axes = self.plane.matrix(m.body_iquat[b])
        along = self.plane.normal @ axes
        inertia = float(along**2 @ m.body_inertia[b])
        return float(m.body_mass[b]), inertia, self.plane.point(m.body_ipos[b])

    def _with_mass(self, draft: dict[str, Any]) -> Body:
        """The body with the masses welded to it."""
        parts = draft.pop("parts") + self.welded.get(draft["name"], [])
        mass = sum(p[0] for p in parts)
        if mass <= 0.0:
            raise MjcfError(f"body {draft['name']!r}: it has no mass; every body that moves needs some")
        com = sum(p[0] * p[1] for p in parts) / mass
        inertia = sum(p[2] + p[0] * float((p[1] - com) @ (p[1] - com)) for p in parts)
        return Body(mass=mass, inertia=inertia, com=tuple(com.tolist()), **draft)

    def _actuator(self, i: int) -> Actuator:
        kind, which, push = gain_of(self.m, i)
        if kind == TENDON:
            return Actuator(gear=push, tendon=name_of(self.m, which))
        body, dof, sign = self.dof_of_joint[which]
        return Actuator(body, dof, sign * push)


def _rotate(angle: float, vector: np.ndarray) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])
