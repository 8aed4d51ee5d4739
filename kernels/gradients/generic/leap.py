"""What the leapfrog (M63) adds to an adjoint step.

Half of its Coriolis forces are those at the velocities p where Euler's step leads. So the weighed equations
are P.F1 + rho.F2 + P0.F0, with F0 = N (p - v) - h (r + u), Euler's step without contact, and P0 such that the
sum does not change with p: N P0 = -h/2 d(P.Gamma(p))/dp.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...generic.linear.envelope import make_envelope
from ...generic.topology import Topology
from ...generic.work import V3, WORK, Slot
from .dual import make_dual
from .passes import make_passes
from .room import DUAL, NEW, OLD, View

REFINEMENTS = 2


@cached
def make_leap(given: type, residual: str, graded: bool) -> SimpleNamespace:
    """predicted(t, k, w, external, world, fixed): adds what p brings to the slopes by q and v and, if
    `graded`, by the parameters; w.lead = P0, unless it is `fixed`, and w.by_lead = h/2 d(P.Gamma(p))/dp.
    joined(t, w): P + P0 for the rates P, which controls are felt by. swap(t, k, w), take(t, w): p in the
    place of v, and v in its own again, with the slopes by p in w.by_lead.
    """
    passes, dual, env = make_passes(given, graded), make_dual(given, residual), make_envelope()
    ZERO, ONE, HALF = WORK(0.0), WORK(1.0), WORK(0.5)

    @wp.func
    def swap(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View]):
        """p in the place of v, which is kept in w.by_lead."""
        for j in range(t.nv):
            at = wp.static(OLD) * t.nv + j
            w.by_lead[j] = w.rates[at]
            w.rates[at] = k.vfree[t.blocks + t.dof_block[j]][t.dof_part[j]]

    @wp.func
    def take(t: wp.ref[Topology], w: wp.ref[View]):
        """v in its place again, and the slopes by p in w.by_lead."""
        for j in range(t.nv):
            w.rates[wp.static(OLD) * t.nv + j] = w.by_lead[j]
            w.by_lead[j] = w.by_v[j]
            w.by_v[j] = ZERO

    @wp.func(inline=False)
    def answer(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View]):
        """w.lead"""
        for i in range(t.blocks):
            w.lead[i] = V3()
        for n in range(1 + REFINEMENTS):
            dual.momenta(t, k, w.lead)
            for i in range(t.blocks):
                k.move[i] = -k.balance[i]
            for j in range(t.nv):
                b = t.dof_block[j]
                k.move[b][t.dof_part[j]] = k.move[b][t.dof_part[j]] - w.by_lead[j]
            env.solve(k.mass_factor, t.mass_first, t.mass_at, t.block_id, k.move, 0, t.blocks)
            for i in range(t.blocks):
                w.lead[i] = w.lead[i] + k.move[i]

    @wp.func(inline=False)
    def predicted(
        t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], external: wp.array2d(dtype=given), world: int,
        fixed: int,
    ):  # fmt: skip
        swap(t, k, w)
        passes.turn(t, k, w, HALF)
        take(t, w)
        if fixed == 0:
            answer(t, k, w)
        for j in range(t.nv):
            b = t.dof_block[j]
            w.rates[wp.static(DUAL) * t.nv + j] = w.lead[b][t.dof_part[j]]
            w.rates[wp.static(NEW) * t.nv + j] = k.vfree[t.blocks + b][t.dof_part[j]]
        passes.rise(t, k, w)
        passes.bodies(t, k, w, ONE, ONE, external, world)
        passes.motion.joints(t, k, w)
        for i in range(t.springs):
            passes.motion.spring(t, k, w, i)
        passes.fall(t, k, w)

    @wp.func
    def joined(t: wp.ref[Topology], w: wp.ref[View]):
        for j in range(t.nv):
            at = wp.static(DUAL) * t.nv + j
            w.rates[at] = w.rates[at] + w.lead[t.dof_block[j]][t.dof_part[j]]

    return SimpleNamespace(predicted=predicted, joined=joined, swap=swap, take=take)
