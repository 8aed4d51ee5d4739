"""An independent float64 account of recorded steps, in NumPy alone: the judge of the stability battery.

It shares no code with the kernels: kinematics, M and the forces are closed forms of a planar tree's
recursion, distances come from trying directions all round. What a recorded step is held against is in
equations.py. Arrays are (B, N, ...): worlds, steps. Where a distance has several equal maximisers
each of them may be the normal.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from slcp_warp import Scene
from slcp_warp.kernels.method import Method

from .equations import Problem

Array = np.ndarray
DIRECTIONS, CANDIDATES = 360, 4
EQUAL = 1e-9  # two maxima of a distance that differ by less are both taken for the maximum [m]


@dataclass(frozen=True)
class Verdict:
    """What the check says about every step (B, N): errors are relative to the size of the terms.

    motion: the equation of motion and the update of positions. contact: the complementarity problem. gap:
    smallest distance after the step [m, rad]. energy: before every step and after the last (B, N + 1) [J].
    """

    motion: Array
    contact: Array
    gap: Array
    energy: Array


def turn(angle: Array, vector: Array) -> Array:
    """`vector` (..., 2) turned by `angle` (...)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * vector[..., 0] - s * vector[..., 1], s * vector[..., 0] + c * vector[..., 1]], -1)


def across(vector: Array) -> Array:
    """`vector` (..., 2) turned by a right angle."""
    return np.stack([-vector[..., 1], vector[..., 0]], -1)


class Checker:
    """The truth about one scene; `numbers` as `Parameters` holds them, shared or one row per world."""

    def __init__(self, scene: Scene, numbers: dict[str, Array]) -> None:
        self.scene, self.s = scene, scene.structure
        default = scene.default_parameters()
        self.p: dict[str, Array] = {}
        for name, value in default.items():
            given = np.asarray(numbers.get(name, value), float)
            batched = given.ndim > value.ndim
            self.p[name] = given[:, None] if batched else given[None, None]

    # ------------------------------------------------------------------------------------ mechanics

    def bodies(self, q: Array, v: Array) -> list[dict[str, Array]]:
        """Of every body: angle, origin (..., 2), their Jacobians W and V, spin, the origin's bias."""
        out: list[dict[str, Array]] = []
        base = {
            "angle": np.zeros(q.shape[:-1]), "at": np.zeros((*q.shape[:-1], 2)),
            "spin": np.zeros(q.shape[:-1]), "W": np.zeros(q.shape),
            "V": np.zeros((*q.shape[:-1], 2, q.shape[-1])), "bias": np.zeros((*q.shape[:-1], 2)),
        }  # fmt: skip
        for i, body in enumerate(self.s.bodies):
            up = out[body.parent] if body.parent >= 0 else base
            local = np.broadcast_to(self.p["anchor"][..., i, :], (*q.shape[:-1], 2)).copy()
            slide = np.zeros((*q.shape[:-1], 2, q.shape[-1]))
            w, angle = up["W"].copy(), up["angle"] + self.p["angle"][..., i]
            for n, j in enumerate(body.dofs):
                if body.joint == "revolute" or n == 2:
                    w[..., j] += 1.0
                    angle = angle + q[..., j]
                    continue
                axis = self.p["axis"][..., i, :] if body.joint == "prismatic" else np.eye(2)[n]
                local = local + axis * q[..., j, None]
                slide[..., j] += turn(up["angle"], axis + 0.0 * local)
            lever = turn(up["angle"], local)
            drift = np.einsum("...ij,...j->...i", slide, v)
            out.append({
                "angle": angle, "at": up["at"] + lever, "W": w, "spin": np.einsum("...j,...j->...", w, v),
                "V": up["V"] + across(lever)[..., None] * up["W"][..., None, :] + slide,
                "bias": up["bias"] - up["spin"][..., None] ** 2 * lever
                + 2.0 * up["spin"][..., None] * across(drift),
            })  # fmt: skip
        return out

    def dynamics(self, q: Array, v: Array, u: Array | None) -> tuple[Array, Array, Array, Array]:
        """M (..., nv, nv), r + u (..., nv), the sum of the magnitudes of its terms, and the energy (...)."""
        p, nv = self.p, self.s.nv
        mass = np.zeros((*q.shape[:-1], nv, nv))
        force = -p["damping"] * v
        size = np.abs(force)
        energy = np.zeros(q.shape[:-1])
        for i, body in enumerate(self.bodies(q, v)):
            m, inertia = p["mass"][..., i], p["inertia"][..., i]
            com = turn(body["angle"], p["com"][..., i, :])
            jac = body["V"] + across(com)[..., None] * body["W"][..., None, :]
            mass += m[..., None, None] * np.einsum("...ki,...kj->...ij", jac, jac)
            mass += inertia[..., None, None] * body["W"][..., :, None] * body["W"][..., None, :]
            pull = p["gravity"] - body["bias"] + body["spin"][..., None] ** 2 * com
            term = np.einsum("...ki,...k->...i", jac, m[..., None] * pull)
            force, size = force + term, size + np.abs(term)
            speed = np.einsum("...kj,...j->...k", jac, v)
            energy += 0.5 * m * np.sum(speed**2, -1) + 0.5 * inertia * body["spin"] ** 2
            energy -= m * np.sum(p["gravity"] * (body["at"] + com), -1)
        if u is not None:
            for i, dof in enumerate(self.s.actuators):
                force[..., dof] += p["gear"][..., i] * u[..., i]
                size[..., dof] += np.abs(p["gear"][..., i] * u[..., i])
        return mass, force, size, energy

    # ------------------------------------------------------------------------------------ contact

    def _pose(self, bodies: list[dict[str, Array]], shape: int) -> tuple[Array, Array]:
        """Centre (..., 2) and angle (...) of a shape."""
        offset, angle = self.p["shape_offset"][..., shape, :], self.p["shape_angle"][..., shape]
        body = self.s.shapes[shape].body
        if body < 0:
            like = bodies[0]["angle"]
            return offset + 0.0 * bodies[0]["at"], angle + 0.0 * like
        frame = bodies[body]
        return frame["at"] + turn(frame["angle"], offset), frame["angle"] + angle

    def _reach(self, shape: int, angle: Array) -> tuple[Array, Array]:
        """Support function of a round shape and its derivative, at an angle in the shape's frame."""
        a, b = self.p["radius"][..., shape, 0], self.p["radius"][..., shape, 1]
        if self.s.shapes[shape].kind == "disc":
            return a + 0.0 * angle, 0.0 * angle
        if angle.ndim > np.ndim(a) and np.ndim(a):
            a, b = a[..., None], b[..., None]
        c, s = np.cos(angle), np.sin(angle)
        h = np.sqrt((a * c) ** 2 + (b * s) ** 2)
        return h, (b * b - a * a) * c * s / h

    def _touch(self, shape: int, pose: tuple[Array, Array], angle: Array) -> Array:
        """The boundary point (..., 2) of a round shape that lies farthest along the direction `angle`."""
        h, slope = self._reach(shape, angle - pose[1])
        n = np.stack([np.cos(angle), np.sin(angle)], -1)
        return pose[0] + h[..., None] * n + slope[..., None] * across(n)

    def _normals(self, k: int, poses: tuple[Any, Any]) -> Array:
        """Angles (CANDIDATES, ...) of the best local maxima of a pair of round shapes, best first."""
        pair = self.s.pairs[k]
        (ca, ta), (cb, tb) = poses
        gap = cb - ca
        if {self.s.shapes[i].kind for i in (pair.shape_a, pair.shape_b)} == {"disc"}:
            return np.arctan2(gap[..., 1], gap[..., 0])[None]

        def value(angle: Array) -> tuple[Array, Array]:
            wide = (lambda x: x[..., None]) if angle.ndim > ta.ndim else (lambda x: x)
            ha, da = self._reach(pair.shape_a, angle - wide(ta))
            hb, db = self._reach(pair.shape_b, angle + np.pi - wide(tb))
            c, s = np.cos(angle), np.sin(angle)
            x, y = wide(gap[..., 0]), wide(gap[..., 1])
            return c * x + s * y - ha - hb, c * y - s * x - da - db

        grid = np.broadcast_to(2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS, (*ta.shape, DIRECTIONS))
        tried = value(grid)[0]
        peak = (tried >= np.roll(tried, 1, -1)) & (tried >= np.roll(tried, -1, -1))
        order = np.argsort(np.where(peak, tried, -np.inf), -1)[..., ::-1][..., :CANDIDATES]
        best = np.take_along_axis(grid, order, -1)
        lo, hi = best - 2 * np.pi / DIRECTIONS, best + 2 * np.pi / DIRECTIONS
        for _ in range(52):
            mid = 0.5 * (lo + hi)
            rising = value(mid)[1] > 0.0
            lo, hi = np.where(rising, mid, lo), np.where(rising, hi, mid)
        angle = 0.5 * (lo + hi)
        tops = value(angle)[0]
        order = np.argsort(-tops, -1)
        angle, tops = np.take_along_axis(angle, order, -1), np.take_along_axis(tops, order, -1)
        angle = np.where(tops >= tops[..., :1] - EQUAL, angle, angle[..., :1])
        return np.moveaxis(angle, -1, 0)

    def contacts(self, q: Array, v: Array, choice: int = 0) -> tuple[Array, Array, Array, Array, int]:
        """Distances of all limits and pairs, their normal and tangential rows, and how much they weigh.

        Returns d (..., n), J_n (..., n, nv), J_t (..., n, nv), sum of the lengths that d is made of (..., n),
        and the number of choices of normals. n counts limits first, then pairs.
        """
        bodies = self.bodies(q, v)
        nv = self.s.nv
        gaps, normal, tangent, sizes, choices = [], [], [], [], 1
        for row in self.s.rows:
            if row.kind == "limit":
                bound = self.p["lower" if row.sign > 0 else "upper"][..., row.index]
                gaps.append(row.sign * (q[..., row.index] - bound))
                unit = np.zeros(q.shape)
                unit[..., row.index] = row.sign
                normal.append(unit)
                tangent.append(0.0 * unit)
                sizes.append(np.abs(q[..., row.index]) + np.abs(bound))
        for k, pair in enumerate(self.s.pairs):
            a, b = pair.shape_a, pair.shape_b
            poses = self._pose(bodies, a), self._pose(bodies, b)
            if self.s.shapes[a].kind == "halfplane":
                angle = poses[0][1]
            elif self.s.shapes[b].kind == "halfplane":
                angle = poses[1][1] + np.pi
            else:
                found = self._normals(k, poses)
                choices = max(choices, len(found))
                angle = found[min(choice, len(found) - 1)]
            n = np.stack([np.cos(angle), np.sin(angle)], -1)
            if self.s.shapes[a].kind == "halfplane":
                pb = self._touch(b, poses[1], angle + np.pi)
                gap = np.sum(n * (pb - poses[0][0]), -1)
                pa = pb - gap[..., None] * n
            elif self.s.shapes[b].kind == "halfplane":
                pa = self._touch(a, poses[0], angle)
                gap = np.sum(n * (poses[1][0] - pa), -1)
                pb = pa + gap[..., None] * n
            else:
                pa, pb = self._touch(a, poses[0], angle), self._touch(b, poses[1], angle + np.pi)
                gap = np.sum(n * (pb - pa), -1)
            jac = np.zeros((*q.shape[:-1], 2, nv))
            for sign, shape, point in ((-1.0, a, pa), (1.0, b, pb)):
                if self.s.shapes[shape].body >= 0:
                    frame = bodies[self.s.shapes[shape].body]
                    lever = across(point - frame["at"])
                    jac += sign * (frame["V"] + lever[..., None] * frame["W"][..., None, :])
            gaps.append(gap)
            normal.append(np.einsum("...i,...ij->...j", n, jac))
            tangent.append(np.einsum("...i,...ij->...j", across(n), jac))
            sizes.append(sum(np.abs(pose[0]).sum(-1) for pose in poses)
                         + sum(np.max(self.p["radius"][..., i, :], -1) for i in (a, b)))  # fmt: skip

        def pack(parts: list[Array], axis: int) -> Array:
            return np.stack(np.broadcast_arrays(*parts), axis)

        return pack(gaps, -1), pack(normal, -2), pack(tangent, -2), pack(sizes, -1), choices

    # ------------------------------------------------------------------------------------ steps

    def judge(self, x: Array, after: Array, impulse: Array, u: Array | None, method: Method) -> Verdict:
        """Judge steps from x (B, N, nx) to `after` (B, N, nx) with row impulses (B, N, nr)."""
        nv = self.s.nv
        q, v, q1, v1 = x[..., :nv], x[..., nv:], after[..., :nv], after[..., nv:]
        h = self.p["step_size"]
        mass, force, size, energy = self.dynamics(q, v, u)
        mass = self.effective(mass, h, method)
        last = self.dynamics(q1, v1, None)[3]
        gap_after = self.contacts(q1, v1)[0].min(-1)
        moved = h[..., None] * v1
        update = np.abs(q1 - q - moved) / (np.abs(q1) + np.abs(q) + np.abs(moved) + 1e-30)
        motion = contact = np.full(q.shape[:-1], np.inf)
        for choice in range(self.contacts(q[:, :1], v[:, :1])[4]):
            d, jn, jt, lengths, _ = self.contacts(q, v, choice)
            problem = Problem(
                self.s, method, mass, h, v, v1, force, size, d, jn, jt, lengths, self.p["friction"],
                self.p["sigma"],
            )  # fmt: skip
            m_error = problem.motion(impulse)
            c_error = problem.contact(impulse, self.p["sigma"])
            if method.trapezoidal and method.erm:  # promises no open rows, and records no second impulse
                pass
            elif method.trapezoidal:  # positions move with a velocity of their own, which opens the rows, too
                c_error = np.maximum(c_error, problem.entered((q1 - q) / h[..., None], self.p["sigma"]))
            else:
                m_error = np.maximum(m_error, update.max(-1))
            better = ~(m_error + c_error >= motion + contact)
            motion, contact = np.where(better, m_error, motion), np.where(better, c_error, contact)
        if method.trapezoidal and not self.constant_forces():
            motion = motion * np.nan
        elif method.trapezoidal and np.any(self.p["damping"]):  # a predictor's impulses are felt by dampers
            motion = np.where(np.any(impulse != 0.0, -1), np.nan, motion)
        return Verdict(motion, contact, gap_after, np.concatenate([energy, last[:, -1:]], 1))

    def effective(self, mass: Array, h: Array, method: Method) -> Array:
        """What stands in the place of M where dampers of joints act with the velocity at the end of a step:
        N (v' - v) = h (r + u) + J' lambda, N = M + h C, or K + B K^-1 B with B = h C/2 and K = M + B.
        """
        if not self.s.implicit_damping:
            return mass
        part = np.broadcast_to(0.5 * h[..., None] * self.p["damping"], mass.shape[:-1])
        part = part[..., None] * np.eye(self.s.nv)
        if method.trapezoidal:
            return mass + part + part @ np.linalg.solve(mass + part, part)
        return mass + 2.0 * part

    def constant_forces(self) -> bool:
        """Whether the acceleration depends on the state by implicit dampers of joints alone, if at all: free
        motion has a closed form then, of both integrators.
        """
        swings = np.any(self.p["com"]) or self.s.sprung or self.s.springs
        return not (swings or (np.any(self.p["damping"]) and not self.s.implicit_damping))
