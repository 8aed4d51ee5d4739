"""Kinematics and dynamics of a planar tree by loops over its tables.

The formulas are those of `mechanism/dynamics.py`.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...mechanism.stiff_springs import SHARE
from ...structure import WORLD
from ..topology import AXIS, JOINT, NUMBERS, SHIFT_Y, TURN, Topology, place
from ..work import M33, V2, V3, V4, WORK, Slot

COLUMN = {name: i for i, name in enumerate(NUMBERS)}


@cached
def make_mechanism(given: type) -> SimpleNamespace:
    """Warp functions of a mechanism given by tables."""
    dtype = WORK
    ZERO, ONE, TWO = dtype(0.0), dtype(1.0), dtype(2.0)
    H = COLUMN["step_size"]
    ANCHOR, ANGLE, AXIS_OF, COM, MASS, INERTIA, GRAVITY, DAMPING = (
        COLUMN[n] for n in ("anchor", "angle", "axis", "com", "mass", "inertia", "gravity", "damping")
    )
    STIFFNESS, REST, PULL, DAMP, LENGTH, TIED, ARMATURE = (
        COLUMN[n] for n in ("stiffness", "rest", "spring_stiffness", "spring_damping", "spring_length",
                            "spring_point", "armature")
    )  # fmt: skip
    PRISMATIC, FREE = JOINT["prismatic"], JOINT["free"]
    SHORT, TINY = dtype(1e-3), dtype(1e-5)  # as in `springs.py`
    PART = dtype(SHARE)

    @wp.func
    def number(t: wp.ref[Topology], k: wp.ref[Slot], name: int, i: int):
        return k.numbers[t.columns[name] + i]

    @wp.func(inline=False)
    def frames(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Orientation and joint position of every body."""
        for i in range(t.nb):
            x = number(t, k, ANCHOR, 2 * i)
            y = number(t, k, ANCHOR, 2 * i + 1)
            angle = number(t, k, ANGLE, i)
            dof = t.first_dof[i]
            if t.joint[i] == PRISMATIC:
                x += number(t, k, AXIS_OF, 2 * i) * k.q[dof]
                y += number(t, k, AXIS_OF, 2 * i + 1) * k.q[dof]
            elif t.joint[i] == FREE:
                x += k.q[dof]
                y += k.q[dof + 1]
                angle += k.q[dof + 2]
            else:
                angle += k.q[dof]
            up = t.parent[i]
            px = x
            py = y
            if up != WORLD:
                f = k.frame[up]
                angle += k.twist[up][2]
                px = f[2] + f[0] * x - f[1] * y
                py = f[3] + f[1] * x + f[0] * y
            k.twist[i] = V3(ZERO, ZERO, angle)
            k.frame[i] = V4(wp.cos(angle), wp.sin(angle), px, py)

    @wp.func
    def axis(t: wp.ref[Topology], k: wp.ref[Slot], dof: int):
        """Direction in the world of a degree of freedom that shifts."""
        body = t.dof_body[dof]
        kind = t.dof_kind[dof]
        a = V2(ONE, ZERO)
        if kind == AXIS:
            a = V2(number(t, k, AXIS_OF, 2 * body), number(t, k, AXIS_OF, 2 * body + 1))
        elif kind == SHIFT_Y:
            a = V2(ZERO, ONE)
        up = t.parent[body]
        if up == WORLD:
            return a
        f = k.frame[up]
        return V2(f[0] * a[0] - f[1] * a[1], f[1] * a[0] + f[0] * a[1])

    @wp.func
    def column(t: wp.ref[Topology], k: wp.ref[Slot], dof: int, x: dtype, y: dtype):
        """Velocity of a point of a body that `dof` moves, at unit rate."""
        if t.dof_kind[dof] == TURN:
            f = k.frame[t.dof_body[dof]]
            return V2(f[3] - y, x - f[2])
        return axis(t, k, dof)

    @wp.func
    def twists(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Velocity of every body's joint and its rate of turning, at k.v."""
        for i in range(t.nb):
            up = t.parent[i]
            own = V3()
            if up != WORLD:
                f = k.frame[i]
                base = k.frame[up]
                w = k.twist[up]
                own = V3(w[0] - w[2] * (f[3] - base[3]), w[1] + w[2] * (f[2] - base[2]), w[2])
            if t.free_block[i] >= 0:
                own = k.v[t.free_block[i]]
            else:
                dof = t.first_dof[i]
                for j in range(dof, dof + wp.where(t.joint[i] == FREE, 3, 1)):
                    rate = k.v[t.dof_block[j]][t.dof_part[j]]
                    if t.dof_kind[j] == TURN:
                        own += V3(ZERO, ZERO, rate)
                    else:
                        a = axis(t, k, j)
                        own += V3(a[0] * rate, a[1] * rate, ZERO)
            k.twist[i] = own

    @wp.func
    def bias(t: wp.ref[Topology], k: wp.ref[Slot], i: int, x: dtype, y: dtype):
        """What gravity and motion give the body's centre of mass (x, y) as acceleration; its columns."""
        ax = number(t, k, GRAVITY, 0)
        ay = number(t, k, GRAVITY, 1)
        turning = dtype(0.0)  # rate of the revolute joints before this one
        for at in range(t.chain_start[i], t.chain_start[i + 1]):
            j = t.chain[at]
            arm = column(t, k, j, x, y)
            k.column[j] = arm
            rate = TWO * turning
            if t.dof_kind[j] == TURN:
                rate += k.v0[j]
                turning += k.v0[j]
            weight = rate * k.v0[j]
            ax += arm[1] * weight
            ay -= arm[0] * weight
        return V2(ax, ay)

    @wp.func
    def add_mass(t: wp.ref[Topology], k: wp.ref[Slot], one: int, two: int, value: dtype):
        """Add to entry (one, two) of M, two dofs; in a diagonal block to both triangles."""
        b = t.dof_block[one]
        c = t.dof_block[two]
        i = t.dof_part[one]
        j = t.dof_part[two]
        if b < c:
            k.mass[t.mass_at[c] + b][j, i] = k.mass[t.mass_at[c] + b][j, i] + value
        else:
            k.mass[t.mass_at[b] + c][i, j] = k.mass[t.mass_at[b] + c][i, j] + value
            if b == c and i != j:
                k.mass[t.mass_at[b] + c][j, i] = k.mass[t.mass_at[b] + c][j, i] + value

    @wp.func
    def joints(t: wp.ref[Topology], k: wp.ref[Slot]):
        """No force and no mass, but the joints' damping and their own inertia."""
        for i in range(k.mass.shape[0]):
            k.mass[i] = M33()
        for i in range(t.blocks):
            k.move[i] = V3()
            for j in range(3):
                if t.block_dof[3 * i + j] < 0:
                    k.mass[t.mass_at[i] + i][j, j] = ONE
        h = number(t, k, H, 0)
        for j in range(t.nv):
            damping = number(t, k, DAMPING, j)
            b = t.dof_block[j]
            part = t.dof_part[j]
            k.move[b][part] = -damping * k.v0[j]
            if t.implicit_damping == 1:
                k.mass[t.mass_at[b] + b][part, part] = h * damping
        for i in range(t.rotors):
            j = t.rotor_dof[i]
            add_mass(t, k, j, j, number(t, k, ARMATURE, j))

    @wp.func
    def free_body(
        t: wp.ref[Topology], k: wp.ref[Slot], i: int, x: dtype, y: dtype, mass: dtype, inertia: dtype, f: V3
    ):
        """M and force of a body that is free in the world, its centre of mass at (x, y)."""
        p = k.frame[i]
        arm = V2(p[3] - y, x - p[2])
        rate = k.v0[t.first_dof[i] + 2]
        fx = f[0] + mass * (number(t, k, GRAVITY, 0) + arm[1] * rate * rate)
        fy = f[1] + mass * (number(t, k, GRAVITY, 1) - arm[0] * rate * rate)
        b = t.free_block[i]
        mx = mass * arm[0]
        my = mass * arm[1]
        turn = mx * arm[0] + my * arm[1] + inertia
        k.move[b] = k.move[b] + V3(fx, fy, arm[0] * fx + arm[1] * fy + f[2])
        at = t.mass_at[b] + b
        k.mass[at] = k.mass[at] + M33(mass, ZERO, mx, ZERO, mass, my, mx, my, turn)

    @wp.func(inline=False)
    def chained_body(
        t: wp.ref[Topology], k: wp.ref[Slot], i: int, x: dtype, y: dtype, mass: dtype, inertia: dtype, f: V3
    ):
        """M and force of any other body."""
        acceleration = bias(t, k, i, x, y)
        fx = f[0] + mass * acceleration[0]
        fy = f[1] + mass * acceleration[1]
        start = t.chain_start[i]
        for at in range(start, t.chain_start[i + 1]):
            j = t.chain[at]
            arm = k.column[j]
            turns = t.dof_kind[j] == TURN
            force = arm[0] * fx + arm[1] * fy
            if turns:
                force += f[2]
            b = t.dof_block[j]
            k.move[b][t.dof_part[j]] = k.move[b][t.dof_part[j]] + force
            for other in range(start, at + 1):
                i2 = t.chain[other]
                value = mass * wp.dot(arm, k.column[i2])
                if turns and t.dof_kind[i2] == TURN:
                    value += inertia
                add_mass(t, k, j, i2, value)

    @wp.func(inline=False)
    def dynamics(t: wp.ref[Topology], k: wp.ref[Slot], external: wp.array2d(dtype=given), world: int):
        """M into k.mass, r(q, v) and the external forces into k.move.

        With implicit damping M + h C stands for M, with implicit stiffness M + h C + h^2/2 K; `springs`
        adds their part.
        """
        joints(t, k)
        for i in range(t.nb):
            mass = number(t, k, MASS, i)
            inertia = number(t, k, INERTIA, i)
            cx = number(t, k, COM, 2 * i)
            cy = number(t, k, COM, 2 * i + 1)
            p = k.frame[i]
            x = p[2] + p[0] * cx - p[1] * cy
            y = p[3] + p[1] * cx + p[0] * cy
            f = V3()
            if external.shape[0] > 0:
                f = V3(dtype(external[world, 3 * i]), dtype(external[world, 3 * i + 1]),
                       dtype(external[world, 3 * i + 2]))  # fmt: skip
            if t.free_block[i] >= 0:
                free_body(t, k, i, x, y, mass, inertia, f)
            else:
                chained_body(t, k, i, x, y, mass, inertia, f)

    @wp.func
    def tied_point(t: wp.ref[Topology], k: wp.ref[Slot], end: int):
        """End of a spring: place (x, y) and velocity of a point of a body."""
        body = t.spring_body[end]
        x = number(t, k, TIED, 2 * end)
        y = number(t, k, TIED, 2 * end + 1)
        if body == WORLD:
            return V4(x, y, ZERO, ZERO)
        f = k.frame[body]
        px = f[2] + f[0] * x - f[1] * y
        py = f[3] + f[1] * x + f[0] * y
        vx = dtype(0.0)
        vy = dtype(0.0)
        for at in range(t.chain_start[body], t.chain_start[body + 1]):
            arm = column(t, k, t.chain[at], px, py)
            vx += arm[0] * k.v0[t.chain[at]]
            vy += arm[1] * k.v0[t.chain[at]]
        return V4(px, py, vx, vy)

    @wp.func
    def add_force(t: wp.ref[Topology], k: wp.ref[Slot], dof: int, force: dtype):
        b = t.dof_block[dof]
        k.move[b][t.dof_part[dof]] = k.move[b][t.dof_part[dof]] + force

    @wp.func(inline=False)
    def push(t: wp.ref[Topology], k: wp.ref[Slot], body: int, p: V4, f: V2):
        """Add the generalised force of f at point p of a body to k.move."""
        if body != WORLD:
            for at in range(t.chain_start[body], t.chain_start[body + 1]):
                arm = column(t, k, t.chain[at], p[0], p[1])
                add_force(t, k, t.chain[at], wp.dot(arm, f))

    @wp.func
    def slope(t: wp.ref[Topology], k: wp.ref[Slot], j: int, p: V4, d: V2):
        """How fast a point moves along d at unit rate of `j`."""
        arm = column(t, k, j, p[0], p[1])
        return arm[0] * d[0] + arm[1] * d[1]

    @wp.func(inline=False)
    def couple(
        t: wp.ref[Topology], k: wp.ref[Slot], left: int, p: V4, right: int, o: V4, d: V2, weight: dtype
    ):
        """Add weight (d.J_left)' (d.J_right) of points of two bodies to the lower triangle."""
        if left != WORLD and right != WORLD:
            for at in range(t.chain_start[left], t.chain_start[left + 1]):
                one = t.chain[at]
                push_one = weight * slope(t, k, one, p, d)
                for by in range(t.chain_start[right], t.chain_start[right + 1]):
                    two = t.chain[by]
                    if place(t, two) <= place(t, one):
                        add_mass(t, k, one, two, push_one * slope(t, k, two, o, d))

    @wp.func
    def tie(t: wp.ref[Topology], k: wp.ref[Slot], i: int, pa: V4, pb: V4, d: V2, weight: dtype):
        """Add weight a a', a = d.D of the ends of spring i, to k.mass."""
        first = t.spring_body[2 * i]
        other = t.spring_body[2 * i + 1]
        couple(t, k, first, pa, first, pa, d, weight)
        couple(t, k, other, pb, other, pb, d, weight)
        couple(t, k, first, pa, other, pb, d, -weight)
        couple(t, k, other, pb, first, pa, d, -weight)

    @wp.func
    def resist(t: wp.ref[Topology], k: wp.ref[Slot], i: int, pa: V4, pb: V4, d: V2, inv: dtype, rho: dtype):
        """Add h C and h^2/2 K of spring i to k.mass: along d, then alike in x and y."""
        h = number(t, k, H, 0)
        along = dtype(0.0)
        across = dtype(0.0)
        if t.implicit_damping == 1:
            along = h * (number(t, k, DAMP, i) * inv)
        if t.implicit_stiffness == 1:
            stiff = PART * h * h * wp.max(number(t, k, PULL, i), ZERO)
            along += stiff * wp.min(rho, ONE) * inv
            across = stiff * wp.max(ONE - rho, ZERO)
        count = wp.where(across > ZERO, 3, 1)
        for n in range(count):
            way = d
            weight = along
            if n > 0:
                way = V2(wp.where(n == 1, ONE, ZERO), wp.where(n == 2, ONE, ZERO))
                weight = across
            tie(t, k, i, pa, pb, way, weight)

    @wp.func(inline=False)
    def springs(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Add the forces of springs at joints and between points, as `springs.py` has them."""
        for i in range(t.sprung):
            j = t.sprung_dof[i]
            stretch = k.q[j] - number(t, k, REST, j)
            add_force(t, k, j, -number(t, k, STIFFNESS, j) * stretch)
            if t.implicit_stiffness == 1:
                h = number(t, k, H, 0)
                add_mass(t, k, j, j, PART * h * h * wp.max(number(t, k, STIFFNESS, j), ZERO))
        for i in range(t.springs):
            pa = tied_point(t, k, 2 * i)
            pb = tied_point(t, k, 2 * i + 1)
            d = V2(pb[0] - pa[0], pb[1] - pa[1])
            rate = d[0] * (pb[2] - pa[2]) + d[1] * (pb[3] - pa[3])
            rest = number(t, k, LENGTH, i)
            eps = SHORT * rest + TINY
            inv = ONE / (wp.dot(d, d) + eps * eps)
            g = number(t, k, PULL, i) * (ONE - rest * wp.sqrt(inv))
            g += number(t, k, DAMP, i) * rate * inv
            push(t, k, t.spring_body[2 * i], pa, g * d)
            push(t, k, t.spring_body[2 * i + 1], pb, -g * d)
            if t.implicit_damping == 1 or t.implicit_stiffness == 1:
                resist(t, k, i, pa, pb, d, inv, rest * wp.sqrt(inv))

    return SimpleNamespace(
        number=number,
        frames=frames,
        column=column,
        twists=twists,
        dynamics=dynamics,
        springs=springs,
        tied_point=tied_point,
        SHORT=SHORT,
        TINY=TINY,
        add_force=add_force,
        add_mass=add_mass,
    )
