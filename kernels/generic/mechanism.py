"""Kinematics and dynamics of a planar tree by loops over its tables.

The formulas are those of `mechanism/dynamics.py`.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..structure import WORLD
from .topology import AXIS, JOINT, NUMBERS, SHIFT_Y, TURN, Topology
from .work import WORK, Work

COLUMN = {name: i for i, name in enumerate(NUMBERS)}


@cached
def make_mechanism(given: type) -> SimpleNamespace:
    """Warp functions of a mechanism given by tables; `b` is the slot of a world's workspace."""
    dtype = WORK
    V2, V4 = wp.types.vector(2, dtype), wp.types.vector(4, dtype)
    ZERO, ONE, TWO = dtype(0.0), dtype(1.0), dtype(2.0)
    H = COLUMN["step_size"]
    ANCHOR, ANGLE, AXIS_OF, COM, MASS, INERTIA, GRAVITY, DAMPING, GEAR = (
        COLUMN[n] for n in ("anchor", "angle", "axis", "com", "mass", "inertia", "gravity", "damping", "gear")
    )
    STIFFNESS, REST, PULL, DAMP, LENGTH, TIED = (
        COLUMN[n]
        for n in ("stiffness", "rest", "spring_stiffness", "spring_damping", "spring_length", "spring_point")
    )
    PRISMATIC, FREE = JOINT["prismatic"], JOINT["free"]
    SHORT, TINY = dtype(1e-3), dtype(1e-5)  # as in `springs.py`

    @wp.func
    def number(t: Topology, params: wp.array2d(dtype=given), row: int, name: int, i: int):
        return dtype(params[row, t.columns[name] + i])

    @wp.func
    def frames(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int):
        """Orientation and joint position of every body."""
        for i in range(t.nb):
            x = number(t, params, row, ANCHOR, 2 * i)
            y = number(t, params, row, ANCHOR, 2 * i + 1)
            angle = number(t, params, row, ANGLE, i)
            dof = t.first_dof[i]
            if t.joint[i] == PRISMATIC:
                x += number(t, params, row, AXIS_OF, 2 * i) * k.q[dof, b]
                y += number(t, params, row, AXIS_OF, 2 * i + 1) * k.q[dof, b]
            elif t.joint[i] == FREE:
                x += k.q[dof, b]
                y += k.q[dof + 1, b]
                angle += k.q[dof + 2, b]
            else:
                angle += k.q[dof, b]
            up = t.parent[i]
            if up != WORLD:
                c = k.frame[4 * up, b]
                sn = k.frame[4 * up + 1, b]
                angle += k.angle[up, b]
                k.frame[4 * i + 2, b] = k.frame[4 * up + 2, b] + c * x - sn * y
                k.frame[4 * i + 3, b] = k.frame[4 * up + 3, b] + sn * x + c * y
            else:
                k.frame[4 * i + 2, b] = x
                k.frame[4 * i + 3, b] = y
            k.angle[i, b] = angle
            k.frame[4 * i, b] = wp.cos(angle)
            k.frame[4 * i + 1, b] = wp.sin(angle)

    @wp.func
    def column(
        t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, dof: int, x: dtype, y: dtype
    ):
        """Velocity of a point of a body that `dof` moves, at unit rate."""
        body = t.dof_body[dof]
        kind = t.dof_kind[dof]
        if kind == TURN:
            return V2(k.frame[4 * body + 3, b] - y, x - k.frame[4 * body + 2, b])
        ax = ONE
        ay = ZERO
        if kind == AXIS:
            ax = number(t, params, row, AXIS_OF, 2 * body)
            ay = number(t, params, row, AXIS_OF, 2 * body + 1)
        elif kind == SHIFT_Y:
            ax = ZERO
            ay = ONE
        up = t.parent[body]
        if up == WORLD:
            return V2(ax, ay)
        c = k.frame[4 * up, b]
        sn = k.frame[4 * up + 1, b]
        return V2(c * ax - sn * ay, sn * ax + c * ay)

    @wp.func
    def bias(
        t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, i: int, x: dtype, y: dtype
    ):
        """What gravity and motion give the body's centre of mass (x, y) as acceleration; its columns."""
        ax = number(t, params, row, GRAVITY, 0)
        ay = number(t, params, row, GRAVITY, 1)
        turning = dtype(0.0)  # rate of the revolute joints before this one
        for at in range(t.chain_start[i], t.chain_start[i + 1]):
            j = t.chain[at]
            arm = column(t, k, params, row, b, j, x, y)
            k.column[2 * j, b] = arm[0]
            k.column[2 * j + 1, b] = arm[1]
            rate = TWO * turning
            if t.dof_kind[j] == TURN:
                rate += k.v0[j, b]
                turning += k.v0[j, b]
            weight = rate * k.v0[j, b]
            ax += arm[1] * weight
            ay -= arm[0] * weight
        return V2(ax, ay)

    @wp.func
    def dynamics(
        t: Topology,
        k: Work,
        params: wp.array2d(dtype=given),
        row: int,
        b: int,
        external: wp.array2d(dtype=given),
        world: int,
    ):
        """M into k.mass, r(q, v) and the external forces into k.move.

        With implicit damping M + h C stands for M; `springs` adds their part.
        """
        h = number(t, params, row, H, 0)
        for i in range(k.mass.shape[0]):
            k.mass[i, b] = ZERO
        for j in range(t.nv):
            damping = number(t, params, row, DAMPING, j)
            p = t.place[j]
            k.move[p, b] = -damping * k.v0[j, b]
            if t.implicit_damping == 1:
                k.mass[t.mass_at[p] + p, b] = h * damping
        for i in range(t.nb):
            mass = number(t, params, row, MASS, i)
            inertia = number(t, params, row, INERTIA, i)
            cx = number(t, params, row, COM, 2 * i)
            cy = number(t, params, row, COM, 2 * i + 1)
            x = k.frame[4 * i + 2, b] + k.frame[4 * i, b] * cx - k.frame[4 * i + 1, b] * cy
            y = k.frame[4 * i + 3, b] + k.frame[4 * i + 1, b] * cx + k.frame[4 * i, b] * cy
            start = t.chain_start[i]
            end = t.chain_start[i + 1]
            acceleration = bias(t, k, params, row, b, i, x, y)
            fx = mass * acceleration[0]
            fy = mass * acceleration[1]
            torque = dtype(0.0)
            if external.shape[0] > 0:
                fx += dtype(external[world, 3 * i])
                fy += dtype(external[world, 3 * i + 1])
                torque += dtype(external[world, 3 * i + 2])
            for at in range(start, end):
                j = t.chain[at]
                pj = t.place[j]
                jx = k.column[2 * j, b]
                jy = k.column[2 * j + 1, b]
                turns = t.dof_kind[j] == TURN
                k.move[pj, b] = k.move[pj, b] + jx * fx + jy * fy
                if turns:
                    k.move[pj, b] = k.move[pj, b] + torque
                for other in range(start, at + 1):
                    i2 = t.chain[other]
                    value = mass * (jx * k.column[2 * i2, b] + jy * k.column[2 * i2 + 1, b])
                    if turns and t.dof_kind[i2] == TURN:
                        value += inertia
                    low = wp.max(pj, t.place[i2])
                    slot = t.mass_at[low] + wp.min(pj, t.place[i2])
                    k.mass[slot, b] = k.mass[slot, b] + value

    @wp.func
    def tied_point(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, end: int):
        """End of a spring: place (x, y) and velocity of a point of a body."""
        body = t.spring_body[end]
        x = number(t, params, row, TIED, 2 * end)
        y = number(t, params, row, TIED, 2 * end + 1)
        if body == WORLD:
            return V4(x, y, ZERO, ZERO)
        c = k.frame[4 * body, b]
        sn = k.frame[4 * body + 1, b]
        px = k.frame[4 * body + 2, b] + c * x - sn * y
        py = k.frame[4 * body + 3, b] + sn * x + c * y
        vx = dtype(0.0)
        vy = dtype(0.0)
        for at in range(t.chain_start[body], t.chain_start[body + 1]):
            arm = column(t, k, params, row, b, t.chain[at], px, py)
            vx += arm[0] * k.v0[t.chain[at], b]
            vy += arm[1] * k.v0[t.chain[at], b]
        return V4(px, py, vx, vy)

    @wp.func
    def push(
        t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, body: int, p: V4, f: V2
    ):
        """Add the generalised force of f at point p of a body to k.move."""
        if body != WORLD:
            for at in range(t.chain_start[body], t.chain_start[body + 1]):
                arm = column(t, k, params, row, b, t.chain[at], p[0], p[1])
                place = t.place[t.chain[at]]
                k.move[place, b] = k.move[place, b] + arm[0] * f[0] + arm[1] * f[1]

    @wp.func
    def slope(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, j: int, p: V4, d: V2):
        """How fast a point moves along d at unit rate of `j`."""
        arm = column(t, k, params, row, b, j, p[0], p[1])
        return arm[0] * d[0] + arm[1] * d[1]

    @wp.func
    def couple(
        t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, left: int, p: V4, right: int,
        o: V4, d: V2, weight: dtype,
    ):  # fmt: skip
        """Add weight (d.J_left)' (d.J_right) of points of two bodies to the lower triangle."""
        if left != WORLD and right != WORLD:
            for at in range(t.chain_start[left], t.chain_start[left + 1]):
                i = t.place[t.chain[at]]
                push_i = weight * slope(t, k, params, row, b, t.chain[at], p, d)
                for by in range(t.chain_start[right], t.chain_start[right + 1]):
                    j = t.place[t.chain[by]]
                    if j <= i:
                        slot = t.mass_at[i] + j
                        value = push_i * slope(t, k, params, row, b, t.chain[by], o, d)
                        k.mass[slot, b] = k.mass[slot, b] + value

    @wp.func
    def drag(
        t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, i: int, pa: V4, pb: V4,
        d: V2, damping: dtype,
    ):  # fmt: skip
        """Add h C of the damper of spring i, c a a'/s, to k.mass."""
        weight = number(t, params, row, H, 0) * damping
        first = t.spring_body[2 * i]
        other = t.spring_body[2 * i + 1]
        couple(t, k, params, row, b, first, pa, first, pa, d, weight)
        couple(t, k, params, row, b, other, pb, other, pb, d, weight)
        couple(t, k, params, row, b, first, pa, other, pb, d, -weight)
        couple(t, k, params, row, b, other, pb, first, pa, d, -weight)

    @wp.func
    def springs(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int):
        """Add the forces of springs at joints and between points, as `springs.py` has them."""
        for i in range(t.sprung):
            j = t.sprung_dof[i]
            p = t.place[j]
            stretch = k.q[j, b] - number(t, params, row, REST, j)
            k.move[p, b] = k.move[p, b] - number(t, params, row, STIFFNESS, j) * stretch
        for i in range(t.springs):
            pa = tied_point(t, k, params, row, b, 2 * i)
            pb = tied_point(t, k, params, row, b, 2 * i + 1)
            d = V2(pb[0] - pa[0], pb[1] - pa[1])
            rate = d[0] * (pb[2] - pa[2]) + d[1] * (pb[3] - pa[3])
            rest = number(t, params, row, LENGTH, i)
            eps = SHORT * rest + TINY
            inv = ONE / (wp.dot(d, d) + eps * eps)
            g = number(t, params, row, PULL, i) * (ONE - rest * wp.sqrt(inv))
            g += number(t, params, row, DAMP, i) * rate * inv
            push(t, k, params, row, b, t.spring_body[2 * i], pa, g * d)
            push(t, k, params, row, b, t.spring_body[2 * i + 1], pb, -g * d)
            if t.implicit_damping == 1:
                drag(t, k, params, row, b, i, pa, pb, d, number(t, params, row, DAMP, i) * inv)

    @wp.func
    def control_force(
        t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, i: int, u: dtype
    ):
        """Add the force of actuator i."""
        p = t.place[t.actuator[i]]
        k.move[p, b] = k.move[p, b] + number(t, params, row, GEAR, i) * u

    return SimpleNamespace(
        number=number,
        frames=frames,
        column=column,
        dynamics=dynamics,
        springs=springs,
        tied_point=tied_point,
        SHORT=SHORT,
        TINY=TINY,
        control_force=control_force,
    )
