"""Hard contact of one mechanism in given modes: accelerations, what ends the modes, impacts.

The rows are the joint limits and then the pair. Rows that push are equations of the accelerations, a
differential-algebraic system of index 1; states are y = (q, v, energy lost to damping, friction and impacts).
"""

import numpy as np

from .mechanics import Array, Mechanism, Touch
from .modes import OFF, SIGN, STICK, Row, choose, solve_mode

Modes = tuple[str, ...]  # one per limit, then the pair's

TOUCHING = 1e-9  # gaps, relative speeds and forces below this are zero [m, rad; per s; N, N m]


class Flow:
    """Equations of one mechanism in given modes, and what ends them."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.m = mechanism
        self.nv = mechanism.nv
        self.limits = len(mechanism.limits)
        self.count = self.limits + mechanism.touches

    def rows(self, which: list[int], touch: Touch | None) -> list[Row]:
        """Rows of accelerations."""
        out = []
        for k in which:
            if k < self.limits:
                unit = np.zeros(self.nv)
                unit[self.m.limits[k].dof] = self.m.limits[k].sign
                out.append(Row(unit, 0.0))
            else:
                assert touch is not None
                out.append(
                    Row(touch.normal, touch.normal_bias, touch.tangent, touch.tangent_bias, self.m.friction)
                )
        return out

    def solve(self, y: Array, modes: Modes) -> tuple[Array, Array, Array, Touch | None]:
        """Acceleration (nv,), forces (count, 2), M, and the pair's rows if it pushes."""
        q, v = y[: self.nv], y[self.nv : 2 * self.nv]
        frames = self.m.frames(q, v)
        mass, force = self.m.dynamics(frames, v)
        which = [k for k, mode in enumerate(modes) if mode != OFF]
        touch = self.m.touch(frames, v) if self.limits in which else None
        answer = solve_mode(mass, force, self.rows(which, touch), tuple(modes[k] for k in which))
        forces = np.zeros((self.count, 2))
        for i, k in enumerate(which):
            forces[k] = answer.normal[i], answer.tangential[i]
        return answer.x, forces, mass, touch

    def derivative(self, y: Array, modes: Modes) -> Array:
        """y' of y = (q, v, energy lost to damping and friction)."""
        v = y[self.nv : 2 * self.nv]
        acceleration, forces, _, touch = self.solve(y, modes)
        lost = self.m.damping @ (v * v)
        if touch is not None:
            lost -= forces[self.limits, 1] * touch.tangent_speed
        return np.concatenate([v, acceleration, [lost]])

    def gaps(self, q: Array) -> Array:
        """Gap of every limit, then of the pair, (count,)."""
        out = [limit.sign * (q[limit.dof] - limit.bound) for limit in self.m.limits]
        return np.array([*out, self.m.gap(q)] if self.m.touches else out)

    def guards(self, y: Array, modes: Modes) -> Array:
        """What must stay positive for the modes to last, (count, 2): gap or force, then slip or cone."""
        q = y[: self.nv]
        out = np.ones((self.count, 2))
        gaps = self.gaps(q)
        _, forces, _, touch = self.solve(y, modes)
        for k, mode in enumerate(modes):
            out[k, 0] = gaps[k] if mode == OFF else forces[k, 0]
            if mode in SIGN and touch is not None:
                out[k, 1] = SIGN[mode] * touch.tangent_speed
            elif mode == STICK and k == self.limits:
                out[k, 1] = self.m.friction * forces[k, 0] - abs(forces[k, 1])
        return out

    def project(self, y: Array, modes: Modes) -> tuple[Array, float]:
        """y with the pushing rows at gap 0 and speed 0, and by how much it moved."""
        which = [k for k, mode in enumerate(modes) if mode != OFF]
        out = y.copy()
        if not which:
            return out, 0.0
        nv = self.nv
        for _ in range(2):
            q, v = out[:nv], out[nv : 2 * nv]
            _, _, mass, touch = self.solve(out, modes)
            rows = self.rows(which, touch)
            normal = np.array([row.normal for row in rows])
            push = np.linalg.solve(mass, normal.T)
            gaps = np.array([touch.gap if k == self.limits and touch else self.gaps(q)[k] for k in which])
            out[:nv] = q - push @ np.linalg.solve(normal @ push, gaps)
            if touch is not None and modes[self.limits] == STICK:
                normal = np.vstack([normal, touch.tangent])
                push = np.linalg.solve(mass, normal.T)
            out[nv : 2 * nv] = v - push @ np.linalg.solve(normal @ push, normal @ v)
        return out, float(np.abs(out - y).max())

    # ---------------------------------------------------------------- what an event does

    def impact(self, y: Array, share: float = 1.0) -> tuple[list[Array], float]:
        """Velocities (nv,) that an impact of all touching rows may leave, and the fastest approach before.

        share < 1 stops only that share of the approach, as a time step does in which the gap closes.
        """
        q, v = y[: self.nv], y[self.nv : 2 * self.nv]
        which = [int(k) for k in np.nonzero(self.gaps(q) < TOUCHING)[0]]
        frames = self.m.frames(q, v)
        mass, _ = self.m.dynamics(frames, v)
        touch = self.m.touch(frames, v) if self.limits in which else None
        speeds = [row.normal @ v for row in self.rows(which, touch)]
        rows = [
            row._replace(normal_offset=(1.0 - share) * max(-speed, 0.0), tangent_offset=0.0)
            for row, speed in zip(self.rows(which, touch), speeds)
        ]
        answers = choose(mass, mass @ v, rows)
        return [answer.x for answer in answers], max([-s for s in speeds], default=0.0)

    def settle(self, y: Array) -> Modes:
        """The modes that the motion goes on with: touching rows that do not part, by their accelerations."""
        q, v = y[: self.nv], y[self.nv : 2 * self.nv]
        frames = self.m.frames(q, v)
        mass, force = self.m.dynamics(frames, v)
        touch = self.m.touch(frames, v) if self.m.touches else None
        near = [int(k) for k in np.nonzero(self.gaps(q) < TOUCHING)[0]]
        near = [k for k in near if self.rows([k], touch)[0].normal @ v < TOUCHING]
        rows = self.rows(near, touch)
        if touch is not None and self.limits in near and abs(touch.tangent_speed) > TOUCHING:
            rows[-1] = rows[-1]._replace(slip=float(np.sign(touch.tangent_speed)))
        modes = [OFF] * self.count
        for k, mode in zip(near, choose(mass, force, rows)[0].modes):
            modes[k] = mode
        return tuple(modes)
