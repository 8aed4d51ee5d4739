"""The oracle's mechanics: poses, mass matrix, damping and forces of many worlds of one scene, in NumPy.

Bodies are visited from the root: every one has its frame's angle and origin, the origin's Jacobian V (..., 2,
nv), which degrees of freedom turn it W (nv,), and the acceleration of its origin at q'' = 0. Arrays are (...,
) over worlds; q and v may be complex, so that derivatives come from complex steps. Nothing of the kernels is
used but the scene's structure, which names what there is.
"""

import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from slcp_warp import Scene
from slcp_warp.description.kinematics import Array, across, joint_pose, slides, turn

from .extended import solve

COMPLEX_STEP = 1e-30


@dataclass(frozen=True)
class Frame:
    """A body in motion: angle (...), origin (..., 2), Jacobians V (..., 2, nv) and W (nv,), spin (...), the
    origin's acceleration at q'' = 0 (..., 2), a bound of its terms (...), and of the lengths that the origin
    is the sum of (...).
    """

    angle: Array
    at: Array
    V: Array
    W: Array
    spin: Array
    bias: Array
    bias_size: Array
    reach: Array

    def jacobian(self, arm: Array) -> Array:
        """Jacobian (..., 2, nv) of the point at `arm` (..., 2) from the origin, in world axes."""
        return self.V + across(arm)[..., None] * self.W


@dataclass(frozen=True)
class Motion:
    """What drives a step: mass matrix M, damping matrix C and K (..., nv, nv), the stiffness of springs that
    is not negative; forces without C v (..., nv), the sum of the magnitudes of the generalised forces that
    they are the sum of (`terms`) and a bound of that of the products these are made of (`size`, of which
    rounding errors are a share), potential energy (...); of springs between points bounds of the products
    that their forces (..., nv), C and K (..., nv, nv) are made of: along a coordinate at right angles to a
    spring these cancel.
    """

    mass: Array
    damping: Array
    stiffness: Array
    force: Array
    terms: Array
    size: Array
    potential: Array
    pulled: Array
    damped: Array
    stiffened: Array


class Mechanics:
    """Kinematics and dynamics of a scene; `numbers` by parameter name, shared or with worlds first."""

    def __init__(self, scene: Scene, numbers: dict[str, Array]) -> None:
        self.scene, self.s = scene, scene.structure
        self.p: dict[str, Array] = {}
        for name, value in scene.default_parameters().items():
            given = np.asarray(numbers.get(name, value), float)
            self.p[name] = given if given.ndim > value.ndim else given[None]

    @property
    def implicit(self) -> bool:
        """Whether dampers act with the velocity at the end of the step."""
        return bool(getattr(self.scene, "implicit_damping", False))

    @property
    def stiff(self) -> bool:
        """Whether Euler's step meets springs at q + h/2 (v' - v)."""
        return bool(getattr(self.scene, "implicit_stiffness", False))

    @property
    def h(self) -> Array:
        """Step size (B or 1,)."""
        return self.p["step_size"]

    def frames(self, q: Array, v: Array | None = None) -> list[Frame]:
        """Every body's frame at positions q (B, nv)."""
        v = np.zeros(q.shape) if v is None else v
        worlds, nv = q.shape
        none, flat = np.zeros(worlds), np.zeros((worlds, 2))
        ground = Frame(none, flat, np.zeros((worlds, 2, nv)), np.zeros(nv), none, flat, none, none)
        out: list[Frame] = []
        for i, body in enumerate(self.s.bodies):
            up = out[body.parent] if body.parent >= 0 else ground
            local, angle = joint_pose(body, i, self.p, q, up.angle)
            reach = up.reach + np.abs(self.p["anchor"][:, i] + 0.0 * q[:, :1]).sum(-1)
            slide, w = np.zeros((worlds, 2, nv), q.dtype), up.W.copy()
            for j, axis in slides(body, i, self.p).items():
                slide[:, :, j] = turn(up.angle, axis + 0.0 * local)
                reach = reach + np.abs(q[:, j])
            if body.joint != "prismatic":
                w[body.dofs[-1]] += 1.0
            lever = turn(up.angle, local)
            drift = np.einsum("bij,bj->bi", slide, v)
            length = np.abs(lever).sum(-1)
            out.append(Frame(
                angle, up.at + lever, up.V + across(lever)[..., None] * up.W + slide, w, v @ w,
                up.bias - up.spin[:, None] ** 2 * lever + 2.0 * up.spin[:, None] * across(drift),
                up.bias_size + np.abs(up.spin) ** 2 * length
                + 2.0 * np.abs(up.spin) * np.abs(drift).sum(-1), reach,
            ))  # fmt: skip
        return out

    def motion(self, q: Array, v: Array, u: Array | None = None, push: Array | None = None) -> Motion:
        """M, C and the forces at a state; `push` (B, nv): generalised forces from elsewhere."""
        p, (worlds, nv) = self.p, q.shape
        mass = np.zeros((worlds, nv, nv), q.dtype)
        force = np.zeros((worlds, nv), np.result_type(q, v))
        terms, size = np.zeros((worlds, nv)), np.zeros((worlds, nv))
        potential = np.zeros(worlds, q.dtype)
        frames = self.frames(q, v)
        gravity = np.abs(p["gravity"]).sum(-1)
        for i, frame in enumerate(frames):
            m = p["mass"][:, i]
            com = turn(frame.angle, p["com"][:, i] + 0.0 * frame.at)
            jac = frame.jacobian(com)
            mass += m[:, None, None] * np.einsum("bki,bkj->bij", jac, jac)
            mass += p["inertia"][:, i, None, None] * np.outer(frame.W, frame.W)
            pull = p["gravity"] - frame.bias + frame.spin[:, None] ** 2 * com
            part = np.einsum("bki,bk->bi", jac, m[:, None] * pull)
            force, terms = force + part, terms + np.abs(part)
            pulls = gravity + frame.bias_size + np.abs(frame.spin) ** 2 * np.abs(com).sum(-1)
            size += np.abs(jac).sum(1) * (m * pulls)[:, None]
            potential = potential - m * np.sum(p["gravity"] * (frame.at + com), -1)
        if self.s.armature:
            mass[:, range(nv), range(nv)] += p["armature"]
        damping = np.zeros((worlds, nv, nv), q.dtype)
        damping[:, range(nv), range(nv)] = p["damping"]
        stiffness = np.zeros((worlds, nv, nv), q.dtype)
        if self.s.sprung:
            stiffness[:, range(nv), range(nv)] = np.maximum(p["stiffness"], 0.0)
            part = p["stiffness"] * (q - p["rest"])
            force, terms = force - part, terms + np.abs(part)
            size += p["stiffness"] * (np.abs(q) + np.abs(p["rest"]))
            potential = potential + 0.5 * np.sum(p["stiffness"] * (q - p["rest"]) ** 2, -1)
        pulled, damped, stiffened = np.zeros((worlds, nv)), np.zeros(mass.shape), np.zeros(mass.shape)
        for i in range(len(self.s.springs)):
            pull, grad, loose, energy, stiff, steep = self.spring(frames, q, i)
            pulled += np.abs(pull)[:, None] * steep
            square = steep[:, :, None] * steep[:, None, :]
            damped += p["spring_damping"][:, i, None, None] * square
            stiffened += np.maximum(p["spring_stiffness"][:, i], 0.0)[:, None, None] * square
            stiffness += stiff
            force, terms = force - pull[:, None] * grad, terms + np.abs(pull[:, None] * grad)
            size += loose[:, None] * np.abs(grad)
            damping += p["spring_damping"][:, i, None, None] * grad[:, :, None] * grad[:, None, :]
            potential = potential + energy
        ways = self.ways(worlds)
        for i, way in enumerate(ways):
            pull, loose, part = self.tendon(way, q, i)
            force, terms = force - pull[:, None] * way, terms + np.abs(pull[:, None] * way)
            size += loose[:, None] * np.abs(way)
            square = way[:, :, None] * way[:, None, :]
            stiffness += np.maximum(p["tendon_stiffness"][:, i], 0.0)[:, None, None] * square
            damping += p["tendon_damping"][:, i, None, None] * square
            potential = potential + part
        for driven in () if u is None else self.driven(u, ways):
            force, terms, size = force + driven, terms + np.abs(driven), size + np.abs(driven)
        if push is not None:
            force, terms, size = force + push, terms + np.abs(push), size + np.abs(push)
        return Motion(
            mass, damping, stiffness, force, terms, size, potential, pulled, damped, stiffened
        )  # fmt: skip

    def driven(self, u: Array, ways: list[Array]) -> list[Array]:
        """What every actuator pushes (B, nv), `ways` being those of the tendons."""
        out = []
        for i, dof in enumerate(self.s.actuators):
            way = np.eye(self.s.nv)[dof] if dof >= 0 else ways[-1 - dof]
            out.append((self.p["gear"][:, i] * u[:, i])[:, None] * way)
        return out

    def ways(self, worlds: int) -> list[Array]:
        """dl/dq (B, nv) of every tendon."""
        out, at = [], 0
        for dofs in self.s.tendons:
            way = np.zeros((worlds, self.s.nv))
            way[:, list(dofs)] = self.p["tendon_coefficient"][:, at : at + len(dofs)]
            at += len(dofs)
            out.append(way)
        return out

    def tendon(self, way: Array, q: Array, i: int) -> tuple[Array, Array, Array]:
        """Of tendon i: tension k (l - L), its terms and its energy (B,)."""
        k, length = self.p["tendon_stiffness"][:, i], self.p["tendon_length"][:, i]
        stretch = np.sum(way * q, -1) - length
        reach = np.sum(np.abs(way * q), -1) + np.abs(length)
        return k * stretch, np.abs(k) * reach, 0.5 * k * stretch**2

    def spring(self, frames: list[Frame], q: Array, i: int) -> tuple[Array, ...]:
        """Of spring i: tension k (l - L) (B,), dl/dq (B, nv), the tension's terms and its energy (B,); K (B,
        nv, nv): k along its line, k (1 - L/l) across it where it pulls; a bound of the products that dl/dq is
        the sum of (B, nv), the lengths that its ends' distance is the difference of in place of that.
        """
        p, ends, reach = self.p, [], np.zeros(len(q))
        for end, body in enumerate(self.s.springs[i]):
            local = p["spring_point"][:, i, end] + 0.0 * q[:, :1]
            if body < 0:
                ends.append((local, np.zeros((len(q), 2, q.shape[1]))))
            else:
                arm = turn(frames[body].angle, local)
                ends.append((frames[body].at + arm, frames[body].jacobian(arm)))
                reach = reach + frames[body].reach
            reach = reach + np.abs(local).sum(-1)
        delta, jac = ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]
        rest, k = p["spring_length"][:, i], p["spring_stiffness"][:, i]
        length = np.sqrt(np.sum(delta * delta, -1) + (1e-3 * rest + 1e-5) ** 2)
        grad = np.einsum("bk,bkj->bj", delta, jac) / length[:, None]
        steep = (np.abs(ends[0][1]) + np.abs(ends[1][1])).sum(1) * (reach / np.abs(length))[:, None]
        across = np.where(length.real > rest, 1.0 - rest / length, 0.0)
        stiff = across[:, None, None] * np.einsum("bki,bkj->bij", jac, jac)
        stiff = stiff + (1.0 - across)[:, None, None] * grad[:, :, None] * grad[:, None, :]
        energy = 0.5 * k * (length - rest) ** 2
        return (
            k * (length - rest),
            grad,
            np.abs(k) * (reach + rest),
            energy,
            np.maximum(k, 0.0)[:, None, None] * stiff,
            steep,
        )

    def effective(self, motion: Motion, trapezoidal: bool) -> Array:
        """N (B, nv, nv), which stands for M where v' is solved. Implicit damping: M + h C (Euler), K + B K^-1
        B with B = h C / 2, K = M + B (trapezoidal); else M. Implicit stiffness adds h^2/2 K (Euler).
        """
        if not trapezoidal:
            out = self.inertia(motion)
            return out + self.h[:, None, None] * motion.damping if self.implicit else out
        if not self.implicit:
            return motion.mass
        drag = self.h[:, None, None] * motion.damping
        k = motion.mass + 0.5 * drag
        whole: Array = k + 0.25 * drag @ solve(k, drag)
        return whole

    def inertia(self, motion: Motion) -> Array:
        """What Euler's step has of `effective` without dampers (B, nv, nv)."""
        if not self.stiff:
            return motion.mass
        out: Array = motion.mass + 0.5 * self.h[:, None, None] ** 2 * motion.stiffness
        return out

    def extended(self) -> "Mechanics":
        """The same in extended precision, where the machine has one."""
        out = copy.copy(self)
        out.p = {name: value.astype(np.longdouble) for name, value in self.p.items()}
        return out

    def trapezoid(self, q: Array, v: Array, u: Array | None, push: Array) -> Array:
        """Where the linearly implicit trapezoidal method takes v: E (reached - v) = h f - h^2/2 K_q v,
        E = N + h/2 K_v + h^2/4 K_q, K_q = d(M a - f)/dq at constant a = N^-1 f, K_v = -df/dv, f = r + u +
        push. With implicit damping K_v has no dampers and K_q has them at v + h a. In extended precision: the
        accelerations of a stiff spring times dM/dq cancel.
        """
        wide = self.extended()
        q, v, push = (part.astype(np.longdouble) for part in (q, v, push))
        n, kv, kq, force = wide._slopes(q, v, u, push)
        h = wide.h[:, None, None]
        e = n + 0.5 * h * (kv + 0.5 * h * kq)
        rhs = h[..., 0] * (force - 0.5 * h[..., 0] * np.einsum("bij,bj->bi", kq, v))
        return np.asarray(v + solve(e, rhs[..., None])[..., 0], float)

    def amplified(self, q: Array, v: Array, u: Array | None, push: Array, reached: Array) -> Array:
        """|E^-1| |E| |reached - v| (B, nv): what relative errors of E's terms make of `trapezoid` (Skeel)."""
        n, kv, kq, _ = self._slopes(q, v, u, push)
        h = self.h[:, None, None]
        e = n + 0.5 * h * (kv + 0.5 * h * kq)
        size = np.abs(n) + 0.5 * h * (np.abs(kv) + 0.5 * h * np.abs(kq))
        moved = np.einsum("bij,bj->bi", size, np.abs(reached - v))
        out: Array = np.einsum("bij,bj->bi", np.abs(np.linalg.inv(e)), moved)
        return out

    def _slopes(self, q: Array, v: Array, u: Array | None, push: Array) -> tuple[Array, Array, Array, Array]:
        """N, K_v, K_q and f of `trapezoid`."""
        h, nv = self.h[:, None, None], q.shape[1]
        here = self.motion(q, v, u, push)
        ahead = h[..., 0] if self.implicit else 0.0 * h[..., 0]
        n = self.effective(here, True)
        force = here.force - np.einsum("bij,bj->bi", here.damping, v)
        a = solve(n, force[..., None])[..., 0]
        kq, kv = np.zeros(n.shape, n.dtype), np.zeros(n.shape, n.dtype)
        for j in range(nv):
            step = 1j * COMPLEX_STEP * np.eye(nv)[j]
            by_q, by_v = self.motion(q + step, v + 0j, u), self.motion(q + 0j, v + step, u)
            drag = np.einsum("bij,bj->bi", by_q.damping, v + ahead * a)
            total = np.einsum("bij,bj->bi", by_q.mass, a) + drag - by_q.force
            kq[..., j] = total.imag / COMPLEX_STEP
            drag = np.zeros(v.shape) if self.implicit else np.einsum("bij,bj->bi", by_v.damping, v + step)
            kv[..., j] = (drag - by_v.force).imag / COMPLEX_STEP
        return n, kv, kq, force

    def wrenches(self, q: Array, force: Array) -> Array:
        """Forces and torques at the centres of mass (B, nb, 3) whose generalised force is `force` (B, nv)."""
        rows = []
        for i, frame in enumerate(self.frames(q)):
            jac = frame.jacobian(turn(frame.angle, self.p["com"][:, i] + 0.0 * frame.at))
            rows.append(np.concatenate([jac, np.broadcast_to(frame.W, (len(q), 1, q.shape[1]))], 1))
        stack = np.concatenate(rows, 1)  # (B, 3 nb, nv), of full rank
        out = np.linalg.pinv(np.swapaxes(stack, 1, 2)) @ force[..., None]
        return out[..., 0].reshape(len(q), -1, 3)

    def kinetic(self, mass: Array, v: Array) -> Array:
        """v' M v / 2 (B,)."""
        return 0.5 * np.einsum("bi,bij,bj->b", v, mass, v)


def worlds_of(numbers: dict[str, Any], keep: Array) -> dict[str, Any]:
    """The numbers of the worlds `keep` (indices), where every array has the worlds first."""
    return {name: value[keep] for name, value in numbers.items()}
