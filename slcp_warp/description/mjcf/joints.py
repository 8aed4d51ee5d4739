"""Joints of a MuJoCo model, for `reader.py`: those of a body as one joint here, or as a chain of them.

A body here has one joint. Where MuJoCo's has several, the outer ones are joints of bodies of their own, whose
masses are nothing beside its own.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .motors import JOINT, Servo
from .names import named
from .plane import MjcfError, Plane, side_of

KINDS = ("free", "ball", "slide", "hinge")
HERE = {"slide": "prismatic", "hinge": "revolute"}
EXACT = 1e-9  # of directions that count as at right angles


@dataclass
class Link:
    """One joint here: MuJoCo's joints in the order of its degrees of freedom, their senses, its degrees of
    freedom by MuJoCo's, (n, n), and its place in the MuJoCo body.
    """

    kind: str
    joints: list[int]
    signs: list[float]
    turn: np.ndarray
    pivot: np.ndarray


class Joints:
    """The joints of a model.

    Args:
        servos: what actuators do by themselves.
        tied: joints that tendons and equality constraints act on.
    """

    def __init__(
        self, m: Any, plane: Plane, servos: Mapping[tuple[str, int], Servo], tied: Collection[int]
    ) -> None:
        self.m, self.plane, self.servos, self.tied = m, plane, servos, tied

    def links(self, b: int, axes: np.ndarray) -> list[Link]:
        """The joints of a body, the outer ones first.

        Args:
            axes: of the body in the frame of our body that holds it, at q = 0.

        Raises:
            MjcfError: a joint that leaves the plane.
        """
        m, first = self.m, int(self.m.body_jntadr[b])
        joints = list(range(first, first + int(m.body_jntnum[b])))
        kinds = [KINDS[m.jnt_type[j]] for j in joints]
        for j, kind in zip(joints, kinds):
            if kind not in HERE:
                raise MjcfError(f"joint {named(m, 'joint', j)!r}: a {kind} joint is not planar; "
                                "use slide, slide and hinge joints")  # fmt: skip
        free = self._free(joints, axes) if kinds == ["slide", "slide", "hinge"] else None
        return [free] if free else [self._single(j, kind, axes) for j, kind in zip(joints, kinds)]

    def axis(self, link: Link, axes: np.ndarray) -> tuple[float, float]:
        """The direction of a slide; `axes` are those of its MuJoCo body in our frame."""
        x, y = axes @ self._direction(link.joints[0])
        return float(x), float(y)

    def _direction(self, j: int) -> np.ndarray:
        return np.array(self.plane.vector(self.m.jnt_axis[j], f"joint {named(self.m, 'joint', j)!r}"))

    def _single(self, j: int, kind: str, axes: np.ndarray) -> Link:
        """A hinge or a slide by itself."""
        sign, pivot = 1.0, np.zeros(2)
        if kind == "hinge":
            label = f"joint {named(self.m, 'joint', j)!r}"
            sign = side_of(axes) * self.plane.normal_sign(self.m.jnt_axis[j], label)
            pivot = self.plane.point(self.m.jnt_pos[j])
        else:
            self._direction(j)
        return Link(HERE[kind], [j], [sign], np.diag([sign]), pivot)

    def _free(self, joints: list[int], axes: np.ndarray) -> Link | None:
        """The joints of a free body in the order of the parent's axes that its slides go along, and their
        senses; slides that are turned against these are one as the other, and nothing is said of one alone.
        None: the slides are others.
        """
        m, hinge = self.m, self._single(joints[2], "hinge", axes)
        turn = np.diag([1.0, 1.0, *hinge.signs])
        slides = turn[:2, :2] = np.transpose([axes @ self._direction(j) for j in joints[:2]])
        if not np.allclose(slides @ slides.T, np.eye(2), atol=EXACT):
            return None
        along = np.abs(slides).argmax(axis=1)  # the slide of each of our axes
        if np.allclose(np.abs(slides), np.eye(2)[along], atol=EXACT):
            signs = [float(np.sign(slides[axis, s])) for axis, s in enumerate(along)]
            own = [*(joints[s] for s in along), joints[2]]
            return Link("free", own, signs + hinge.signs, turn, hinge.pivot)
        dofs = [m.jnt_dofadr[j] for j in joints[:2]]
        same = all(np.ptp(values[dofs]) == 0.0 for values in (m.dof_damping, m.dof_armature))
        alone = any(
            m.jnt_limited[j] or m.jnt_stiffness[j] or (JOINT, j) in self.servos or j in self.tied
            for j in joints[:2]
        )
        if alone or not same:
            return None
        return Link("free", joints, [1.0, 1.0, *hinge.signs], turn, hinge.pivot)

    def fields(self, link: Link) -> dict[str, Any]:
        """What a body here says of each degree of freedom."""
        m = self.m
        damping, armature, lower, upper, springs = [], [], [], [], []
        for j, sign in zip(link.joints, link.signs):
            dof, q, servo = m.jnt_dofadr[j], m.jnt_qposadr[j], self.servos.get((JOINT, j), Servo())
            damping.append(float(m.dof_damping[dof]) + servo.damping)
            armature.append((float(m.dof_armature[dof]) + servo.armature) or None)
            springs.append(self._spring(j, sign, servo))
            ends = sorted(sign * (float(x) - float(m.qpos0[q])) for x in m.jnt_range[j])
            lower.append(ends[0] if m.jnt_limited[j] else None)
            upper.append(ends[1] if m.jnt_limited[j] else None)
        stiffness, rest = zip(*springs)
        return {
            "joint": link.kind, "damping": tuple(damping), "stiffness": stiffness, "rest": rest,
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
                f"joint {named(m, 'joint', j)!r}: an actuator pushes it by {alone:g} without a control; that "
                "is supported only where a spring or a position servo acts, too"
            )
        if servo.stiffness != 0.0 or push != 0.0:
            rest = (own * rest + push) / stiffness if stiffness != 0.0 else 0.0
        return stiffness or None, sign * rest
