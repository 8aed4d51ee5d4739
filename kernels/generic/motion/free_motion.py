"""Where a step's motion goes without contact."""

import warp as wp

from ...factories import cached
from ..linear.doubted import make_doubted
from ..linear.envelope import make_envelope
from ..topology import Topology
from ..work import V3, WORK, Slot
from .mechanism import COLUMN, make_mechanism


@cached
def make_free_motion(given: type) -> wp.Function:
    """free_motion(t, k): k.vfree and k.v from M, in k.mass, and the forces, in k.move."""
    dtype = WORK
    number = make_mechanism(given).number
    env, doubted = make_envelope(), make_doubted()
    H, ONE = COLUMN["step_size"], dtype(1.0)

    @wp.func(inline=False)
    def free_motion(t: wp.ref[Topology], k: wp.ref[Slot]):
        """v_free = v + h M^-1 (r + u), no number where what springs and tendons tie has no digits left."""
        for i in range(k.mass.shape[0]):
            k.mass_factor[i] = k.mass[i]
        env.factor(k.mass_factor, t.mass_first, t.mass_at, 0, t.blocks)
        if t.springs + t.tendons > 0 and t.implicit_damping + t.implicit_stiffness > 0:
            if doubted.solve(t, k) == 1:
                k.move[0] = wp.sqrt(-ONE) * V3(ONE, ONE, ONE)
        else:
            env.solve(k.mass_factor, t.mass_first, t.mass_at, t.block_id, k.move, 0, t.blocks)
        h = number(t, k, H, 0)
        for i in range(t.blocks):
            k.before[i] = V3()
        for j in range(t.nv):
            k.before[t.dof_block[j]][t.dof_part[j]] = k.v0[j]
        for i in range(t.blocks):
            k.vfree[i] = k.before[i] + h * k.move[i]
            k.v[i] = k.vfree[i]

    return free_motion
