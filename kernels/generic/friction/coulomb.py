"""Coulomb friction in the generic kernels: a fixed point around the convex problem.

With d/h + mu s in place of d/h, s = |J_t v'|, the two rows of Anitescu's relaxation are the exact planar law
(the paper's [8]; De Saxce's change of variables, solved for s as Acary and Cadoux do). mu s is |J_+ v' - J_-
v'|/2. Convex solves alternate with new values of mu s, extrapolated from the last two (Anderson's method of
depth one). Where the convex problem has no solution mu s goes halfway back to where it had one. Nothing
guarantees convergence, and a fixed point that fails proves nothing: what is JAMMED has a proof of its own
(jam.py).
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..motion.mechanism import COLUMN
from ..newton import make_newton
from ..topology import CONTACT, Topology
from ..work import WORK, Island, Slot

COULOMB_PASSES = 100
RETREATS = 8  # of mu s, halfway each
TOLERANCE = 4e-12  # of mu s, relative to the pair's own velocities
SLIPPING = 5e-11  # and of s
ROUNDING = 4e-16  # of J v', relative to its terms


@cached
def make_coulomb(given: type) -> SimpleNamespace:
    """lift(t, k, o, passes) -> 1 if k.rate of the acting pairs had to change; share(t, k, o)."""
    dtype = WORK
    turn_group = make_newton(given, "hard").turn_group
    HALF, ONE, ZERO = dtype(0.5), dtype(1.0), dtype(0.0)
    ENOUGH, SLIP, ROUND = dtype(TOLERANCE), dtype(SLIPPING), dtype(ROUNDING)
    FRICTION = COLUMN["friction"]
    FARTHEST, SMALLEST = dtype(2.0), dtype(1e-30)

    @wp.func
    def first_of_pair(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """The first row of the pair of row r if it has friction and r is its first acting row, else -1."""
        i = k.row[r]
        if k.acting[r] == 0 or t.row_kind[i] != CONTACT or t.row_sign[i] == 0:
            return -1
        if t.row_sign[i] > 0:
            return r
        return wp.where(k.acting[r - 1] > 0, -1, r - 1)

    @wp.func
    def uncertain(t: wp.ref[Topology], k: wp.ref[Slot], r: int, target: dtype):
        """By what mu s of the pair of row r may be off: by no more than its own data and rounding tell."""
        data = wp.abs(k.rate[r]) + target
        terms = dtype(0.0)
        start = k.entry[r]
        pattern = k.pattern[r]
        for e in range(k.entry[r + 1] - start):
            b = t.row_block[pattern + e]
            free = wp.abs(wp.cw_mul(k.jac[start + e], k.vfree[b]))
            moved = wp.abs(wp.cw_mul(k.jac[start + e], k.v[b]))
            data += free[0] + free[1] + free[2]
            terms += moved[0] + moved[1] + moved[2]
        mu = k.numbers[t.columns[FRICTION] + t.row_index[k.row[r]]]
        return wp.min(ENOUGH, SLIP * mu) * data + ROUND * terms

    @wp.func(inline=False)
    def lift(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, passes: int):
        """Compare mu s with what v' makes of it; where they differ, move it and k.rate. `passes` < 0: take it
        halfway back to where the convex problem had a solution.
        """
        settled = int(1)
        along = dtype(0.0)
        across = dtype(0.0)
        for g in range(o.group, o.last_group):
            turn_group(t, k, g, k.v, k.dz)
        for r in range(o.row, o.last_row):
            first = first_of_pair(t, k, r)
            if first >= 0:
                target = HALF * wp.abs(k.dz[first] - k.dz[first + 1])
                miss = target - k.lift[first]
                change = miss - k.miss[first]
                along += miss * change
                across += change * change
                if settled == 1:
                    if not (wp.abs(miss) <= uncertain(t, k, first, target)):
                        settled = 0
        if settled == 1 and passes >= 0:
            return 0
        share = dtype(0.0)
        if passes > 1 and across > SMALLEST:
            share = wp.clamp(along / across, -FARTHEST, ONE - dtype(0.05))
        for r in range(o.row, o.last_row):
            first = first_of_pair(t, k, r)
            if first >= 0:
                target = HALF * wp.abs(k.dz[first] - k.dz[first + 1])
                moved = wp.max(target - share * (target - k.target[first]), ZERO)
                if passes < 0:
                    moved = HALF * (k.lift[first] + k.target[first] - k.miss[first])
                else:
                    k.miss[first] = target - k.lift[first]
                    k.target[first] = target
                k.lift[first] = moved
                k.rate[first] = k.gap[first] + k.lift[first]
                k.rate[first + 1] = k.gap[first + 1] + k.lift[first]
        return 1

    @wp.func
    def share(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Halves of what both rows of a contact press, which were one without friction: nothing rubs."""
        for r in range(o.row, o.last_row):
            first = first_of_pair(t, k, r)
            if first >= 0:
                lam = HALF * (k.lam[first] + k.lam[first + 1])
                z = HALF * (k.z[first] + k.z[first + 1])
                for row in range(first, first + 2):
                    k.lam[row] = lam
                    k.z[row] = z

    return SimpleNamespace(lift=lift, share=share)
