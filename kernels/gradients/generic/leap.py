"""What the leapfrog (M63) adds to an adjoint step.

Half of its Coriolis forces are those at the velocities p where Euler's step leads, with contact. P.F1 +
rho.F2 of the whole step has slopes by p, h/2 d(P.Gamma(p))/dp; these weigh Euler's step, whose own adjoint
follows.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...generic.topology import Topology
from ...generic.work import WORK, Slot
from .passes import make_passes
from .room import DUAL, OLD, View

OTHER = 1e-5  # relative to a world's speeds: another solution, as Coulomb's friction may have


@cached
def make_leap(given: type, graded: bool) -> SimpleNamespace:
    """by_predicted(t, k, w): w.by_lead, the slopes by p, and what p's place brings to those by q and, if
    `graded`, by the parameters. swap(t, k, w), take(t, w): p in the place of v, and v in its own again, with
    the slopes by p in w.by_lead. hold(t, w): slopes of the whole step aside, w.weight those by p; join(t, w):
    both steps' slopes, P of both for the rates P. same(t, k): 1 if Euler's step, solved again, leads to p.
    """
    passes = make_passes(given, graded)
    ZERO, ONE, HALF, APART = WORK(0.0), WORK(1.0), WORK(0.5), WORK(OTHER)

    @wp.func
    def swap(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View]):
        for j in range(t.nv):
            at = wp.static(OLD) * t.nv + j
            w.by_lead[j] = w.rates[at]
            w.rates[at] = k.vfree[t.blocks + t.dof_block[j]][t.dof_part[j]]

    @wp.func
    def take(t: wp.ref[Topology], w: wp.ref[View]):
        for j in range(t.nv):
            w.rates[wp.static(OLD) * t.nv + j] = w.by_lead[j]
            w.by_lead[j] = w.by_v[j]
            w.by_v[j] = ZERO

    @wp.func(inline=False)
    def by_predicted(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View]):
        swap(t, k, w)
        passes.turn(t, k, w, HALF)
        take(t, w)

    @wp.func
    def hold(t: wp.ref[Topology], w: wp.ref[View]):
        for j in range(t.nv):
            w.held[j] = w.by_q[j]
            w.held[t.nv + j] = w.by_v[j]
            w.held[2 * t.nv + j] = w.rates[wp.static(DUAL) * t.nv + j]
            w.weight[j] = ZERO
            w.weight[t.nv + j] = w.by_lead[j]

    @wp.func
    def join(t: wp.ref[Topology], w: wp.ref[View]):
        for j in range(t.nv):
            w.by_q[j] = w.by_q[j] + w.held[j]
            w.by_v[j] = w.by_v[j] + w.held[t.nv + j]
            at = wp.static(DUAL) * t.nv + j
            w.rates[at] = w.rates[at] + w.held[2 * t.nv + j]

    @wp.func
    def same(t: wp.ref[Topology], k: wp.ref[Slot]):
        found = int(1)
        largest = ZERO + ONE
        for j in range(t.nv):
            largest = wp.max(largest, wp.abs(k.v[t.dof_block[j]][t.dof_part[j]]))
        for j in range(t.nv):
            b = t.dof_block[j]
            if not (wp.abs(k.v[b][t.dof_part[j]] - k.vfree[t.blocks + b][t.dof_part[j]]) <= APART * largest):
                found = 0
        return found

    return SimpleNamespace(by_predicted=by_predicted, swap=swap, take=take, hold=hold, join=join, same=same)
