"""Where a step's motion goes without contact: Euler's rule, or the leapfrog's (M63)."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..linear.doubted import make_doubted
from ..linear.envelope import make_envelope
from ..topology import TURN, Topology
from ..work import V2, V3, WORK, Slot
from .mechanism import COLUMN, make_mechanism


@cached
def make_free_motion(given: type) -> SimpleNamespace:
    """euler(t, k): k.vfree from M, in k.mass, and the forces, in k.move. leap(t, k) and leap_on(t, k): after
    it, and after the step that it leads to.
    """
    dtype = WORK
    mech = make_mechanism(given)
    number = mech.number
    env, doubted = make_envelope(), make_doubted()
    H, COM, MASS = (COLUMN[n] for n in ("step_size", "com", "mass"))
    ZERO, ONE, TWO, HALF = dtype(0.0), dtype(1.0), dtype(2.0), dtype(0.5)

    @wp.func
    def respond(t: wp.ref[Topology], k: wp.ref[Slot]):
        """k.move = M^-1 k.move, no number where what springs and tendons tie has no digits left."""
        if t.springs + t.tendons > 0 and t.implicit_damping + t.implicit_stiffness > 0:
            if doubted.solve(t, k) == 1:
                k.move[0] = wp.sqrt(-ONE) * V3(ONE, ONE, ONE)
        else:
            env.solve(k.mass_factor, t.mass_first, t.mass_at, t.block_id, k.move, 0, t.blocks)

    @wp.func(inline=False)
    def coriolis(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
        """The Coriolis acceleration of a body's centre of mass at the predicted velocities, less that at v;
        the centre's columns.
        """
        cx = number(t, k, COM, 2 * i)
        cy = number(t, k, COM, 2 * i + 1)
        p = k.frame[i]
        x = p[2] + p[0] * cx - p[1] * cy
        y = p[3] + p[1] * cx + p[0] * cy
        out = V2()
        turning = ZERO + ZERO  # rates of the revolute joints before this one
        faster = ZERO + ZERO
        for at in range(t.chain_start[i], t.chain_start[i + 1]):
            j = t.chain[at]
            arm = mech.column(t, k, j, x, y)
            k.column[j] = arm
            v = k.v0[j]
            late = k.vfree[t.blocks + t.dof_block[j]][t.dof_part[j]]
            one = TWO * turning
            two = TWO * faster
            if t.dof_kind[j] == TURN:
                one += v
                two += late
                turning += v
                faster += late
            out += (two * late - one * v) * V2(-arm[1], arm[0])
        return out

    @wp.func(inline=False)
    def euler(t: wp.ref[Topology], k: wp.ref[Slot]):
        """k.vfree and k.v = v + h M^-1 (r + u)"""
        for i in range(k.mass.shape[0]):
            k.mass_factor[i] = k.mass[i]
        env.factor(k.mass_factor, t.mass_first, t.mass_at, 0, t.blocks)
        respond(t, k)
        h = number(t, k, H, 0)
        for i in range(t.blocks):
            k.before[i] = V3()
        for j in range(t.nv):
            k.before[t.dof_block[j]][t.dof_part[j]] = k.v0[j]
        for i in range(t.blocks):
            k.vfree[i] = k.before[i] + h * k.move[i]

    @wp.func
    def late(t: wp.ref[Topology], k: wp.ref[Slot]):
        """k.move: what half of the Coriolis forces at p is less than half of those at v."""
        for i in range(t.blocks):
            k.move[i] = V3()
        for i in range(t.nb):
            force = -HALF * number(t, k, MASS, i) * coriolis(t, k, i)
            for at in range(t.chain_start[i], t.chain_start[i + 1]):
                j = t.chain[at]
                b = t.dof_block[j]
                k.move[b][t.dof_part[j]] = k.move[b][t.dof_part[j]] + wp.dot(k.column[j], force)

    @wp.func(inline=False)
    def leap(t: wp.ref[Topology], k: wp.ref[Slot]):
        """k.vfree of Euler's step, which touches nothing, becomes the leapfrog's; p is where that led."""
        for i in range(t.blocks):
            k.vfree[t.blocks + i] = k.vfree[i]
        late(t, k)
        respond(t, k)
        h = number(t, k, H, 0)
        for i in range(t.blocks):
            k.vfree[i] = k.vfree[t.blocks + i] + h * k.move[i]

    @wp.func(inline=False)
    def leap_on(t: wp.ref[Topology], k: wp.ref[Slot]):
        """The same of a step that ended at k.v, which is p; 0: nothing changes by it."""
        for i in range(t.blocks):
            k.vfree[t.blocks + i] = k.v[i]
            k.balance[i] = k.vfree[i]
        late(t, k)
        changed = int(0)
        for i in range(t.blocks):
            changed = wp.where(k.move[i] == V3(), changed, 1)
        if changed == 1:
            respond(t, k)
            h = number(t, k, H, 0)
            for i in range(t.blocks):
                k.vfree[i] = k.balance[i] + h * k.move[i]
                k.v[i] = k.vfree[i]
        return changed

    return SimpleNamespace(euler=euler, leap=leap, leap_on=leap_on)
