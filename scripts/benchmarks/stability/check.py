"""An independent float64 account of recorded steps, in NumPy alone: the judge of the stability battery.

It shares no code with the kernels: motion and contact are those of `benchmarks/mechanics`. What a recorded
step is held against is in equations.py. Arrays are (B, N, ...): worlds, steps. Where a distance has several
equal maximisers each of them may be the normal.
"""

from dataclasses import dataclass

import numpy as np

from slcp_warp import Scene
from slcp_warp.description.kinematics import Array
from slcp_warp.kernels.method import Method

from ..mechanics.contact import CHOICES, Touches, touches
from ..mechanics.leaps import late
from ..mechanics.tree import Mechanics, Motion
from .equations import Problem

DIRECTIONS = 360  # in which distances are searched


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


class Checker:
    """The truth about one scene; `numbers` as `Parameters` holds them, shared or one row per world."""

    def __init__(self, scene: Scene, numbers: dict[str, Array]) -> None:
        self.scene, self.s = scene, scene.structure
        self.numbers = {name: np.asarray(value, float) for name, value in numbers.items()}
        self.p: dict[str, Array] = {}
        for name, value in scene.default_parameters().items():
            given = self.numbers.get(name, value)
            self.p[name] = given[:, None] if given.ndim > value.ndim else given[None, None]

    def mechanics(self, steps: int) -> Mechanics:
        """The mechanics of all steps in a row, those of a world beside each other."""
        default = self.scene.default_parameters()
        return Mechanics(self.scene, {
            name: np.repeat(value, steps, 0) if value.ndim > default[name].ndim else value
            for name, value in self.numbers.items() if name in default
        })  # fmt: skip

    def motion(self, q: Array, v: Array, u: Array | None) -> tuple[Mechanics, Motion]:
        """M, C and the forces of all steps in a row."""
        mechanics = self.mechanics(q.shape[1])
        return mechanics, mechanics.motion(_flat(q), _flat(v), None if u is None else _flat(u))

    def dynamics(self, q: Array, v: Array, u: Array | None) -> tuple[Array, Array, Array, Array]:
        """M (..., nv, nv), r + u (..., nv), the sum of the magnitudes of its terms, and the energy (...)."""
        return self.forces(*self.motion(q, v, u), v)

    def forces(self, mechanics: Mechanics, motion: Motion, v: Array) -> tuple[Array, Array, Array, Array]:
        """What `dynamics` gives, of a motion at velocities v (B, N, nv)."""
        drag = np.einsum("bij,bj->bi", motion.damping, _flat(v))
        energy = mechanics.kinetic(motion.mass, _flat(v)) + motion.potential
        return (
            motion.mass.reshape(*v.shape, -1),
            (motion.force - drag).reshape(v.shape),
            (motion.terms + np.abs(drag)).reshape(v.shape),
            energy.reshape(v.shape[:2]),
        )

    def contacts(self, q: Array, choice: int = 0) -> tuple[Array, Array, Array, Array]:
        """Distances of all limits and pairs, their normal and tangential rows, and how much they weigh.

        Returns d (..., n), J_n (..., n, nv), J_t (..., n, nv), sum of the lengths that d is made of (..., n).
        n counts limits first, then pairs. `choice`: which of several equal normals is taken.
        """
        found: Touches = touches(self.mechanics(q.shape[1]), _flat(q), DIRECTIONS, choice)
        gaps, rows, sizes = [], [], []
        for row in self.s.rows:
            if row.kind == "limit":
                bound = self.p["lower" if row.sign > 0 else "upper"][..., row.index]
                gaps.append(row.sign * (q[..., row.index] - bound))
                unit = np.zeros(q.shape)
                unit[..., row.index] = row.sign
                rows.append(unit)
                sizes.append(np.abs(q[..., row.index]) + np.abs(bound))

        def both(limits: list[Array], pairs: Array, axis: int) -> Array:
            of_pairs = pairs.reshape(*q.shape[:2], *pairs.shape[1:])
            return np.concatenate([np.stack(limits, axis), of_pairs], axis) if limits else of_pairs

        return (
            both(gaps, found.gap, -1),
            both(rows, found.normal, -2),
            both([0.0 * unit for unit in rows], found.tangent, -2),
            both(sizes, found.extent, -1),
        )

    @property
    def choices(self) -> int:
        """How many normals a pair may have: an ellipse's distance has several maxima."""
        kinds = [{self.s.shapes[p.shape_a].kind, self.s.shapes[p.shape_b].kind} for p in self.s.pairs]
        return CHOICES if any("ellipse" in pair and "halfplane" not in pair for pair in kinds) else 1

    def judge(self, x: Array, after: Array, impulse: Array, u: Array | None, method: Method) -> Verdict:
        """Judge steps from x (B, N, nx) to `after` (B, N, nx) with row impulses (B, N, nr)."""
        nv = self.s.nv
        q, v, q1, v1 = x[..., :nv], x[..., nv:], after[..., :nv], after[..., nv:]
        h = self.p["step_size"]
        mechanics, drive = self.motion(q, v, u)
        _, force, size, energy = self.forces(mechanics, drive, v)
        mass = mechanics.effective(drive, method.trapezoidal).reshape(*q.shape, nv)
        if method.trapezoidal and not self.constant_forces():
            force, size = self._trapezoidal_force(mechanics, mass, q, v, u)
        leaps = method.leapfrog and not self.constant_forces()
        if leaps:
            force, size = self._leapt(mechanics, mass, force, size, q, v, u)
        last = self.dynamics(q1, v1, None)[3]
        gap_after = self.contacts(q1)[0].min(-1)
        moved = h[..., None] * (0.5 * (v + v1) if method.trapezoidal else v1)
        update = np.abs(q1 - q - moved) / (np.abs(q1) + np.abs(q) + np.abs(moved) + 1e-30)
        motion = contact = np.full(q.shape[:-1], np.inf)
        flies = np.all(impulse == 0.0, -1)
        for choice in range(self.choices):
            d, jn, jt, lengths = self.contacts(q, choice)
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
            flies &= problem.opens(problem.free) & problem.opens(0.5 * (v + problem.free))
            if not method.trapezoidal:
                m_error = np.maximum(m_error, update.max(-1))
            elif not method.erm:
                m_error = np.where(flies, np.maximum(m_error, update.max(-1)), m_error)
            better = ~(m_error + c_error >= motion + contact)
            motion, contact = np.where(better, m_error, motion), np.where(better, c_error, contact)
        if method.trapezoidal and not self.constant_forces():  # a predictor's impulses stretch springs
            motion = np.where(flies, motion, np.nan)
        elif leaps:  # Coriolis forces are those of a prediction with contact
            motion = np.where(flies, motion, np.nan)
        elif method.trapezoidal and np.any(self.p["damping"]):  # a predictor's impulses are felt by dampers
            motion = np.where(np.any(impulse != 0.0, -1), np.nan, motion)
        return Verdict(motion, contact, gap_after, np.concatenate([energy, last[:, -1:]], 1))

    def _trapezoidal_force(
        self, mechanics: Mechanics, mass: Array, q: Array, v: Array, u: Array | None
    ) -> tuple[Array, Array]:
        """The force (B, N, nv) that takes v where the trapezoidal method takes it in free flight, and the sum
        of the magnitudes of its terms.
        """
        here = _flat(q), _flat(v), None if u is None else _flat(u), 0.0 * _flat(v)
        reached = mechanics.trapezoid(*here)
        moved = reached.reshape(v.shape) - v, mechanics.amplified(*here, reached).reshape(v.shape)
        force, size = (
            np.einsum("bnij,bnj->bni", matrix, each) / self.p["step_size"][..., None]
            for matrix, each in zip((mass, np.abs(mass)), moved)
        )
        return force, size

    def _leapt(
        self,
        mechanics: Mechanics,
        mass: Array,
        force: Array,
        size: Array,
        q: Array,
        v: Array,
        u: Array | None,
    ) -> tuple[Array, Array]:
        """Euler's force (B, N, nv) and its size become the leapfrog's in free flight."""
        h = self.p["step_size"][..., None]
        reached = v + h * np.linalg.solve(mass, force[..., None])[..., 0]
        of = _flat(q), _flat(v), None if u is None else _flat(u), _flat(reached)
        added, more = (part.reshape(v.shape) / h for part in late(mechanics, *of))
        return force + added, size + more

    def constant_forces(self) -> bool:
        """Whether the acceleration depends on the state by implicit dampers of joints alone, if at all: free
        motion has a simple form then, of both integrators.
        """
        swings = np.any(self.p["com"]) or self.s.sprung or self.s.springs
        return not (swings or (np.any(self.p["damping"]) and not self.s.implicit_damping))


def _flat(values: Array) -> Array:
    """Values (B, N, ...) of worlds and steps in a row (B N, ...)."""
    return values.reshape(values.shape[0] * values.shape[1], *values.shape[2:])
