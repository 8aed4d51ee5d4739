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

from ..factories import cached
from .newton import make_newton
from .topology import CONTACT, Topology
from .work import WORK, Work

COULOMB_PASSES = 100
RETREATS = 8  # of mu s, halfway each
TOLERANCE = 4e-12  # of mu s, relative to the pair's own velocities
ROUNDING = 4e-16  # of J v', relative to its terms


@cached
def make_coulomb(given: type) -> SimpleNamespace:
    """lift(t, k, b, n, passes) -> 1 if k.rate of the acting pairs had to change."""
    dtype = WORK
    dot = make_newton(given, "hard").dot
    HALF, ONE, ZERO = dtype(0.5), dtype(1.0), dtype(0.0)
    ENOUGH, ROUND = dtype(TOLERANCE), dtype(ROUNDING)
    FARTHEST, SMALLEST = dtype(2.0), dtype(1e-30)

    @wp.func
    def first_of_pair(t: Topology, k: Work, b: int, r: int):
        """The pair of the r-th acting row if it has friction and this is its first acting row, else -1."""
        i = k.active[r, b]
        if t.row_kind[i] != CONTACT or t.row_sign[i] == 0:
            return -1
        pair = t.row_index[i]
        if i > t.pair_row[pair] and k.acting[t.pair_row[pair], b] > 0:
            return -1
        return pair

    @wp.func
    def uncertain(t: Topology, k: Work, b: int, i: int, target: dtype):
        """By what mu s of the pair of row i may be off: by no more than its own data and rounding tell."""
        data = wp.abs(k.rate[i, b]) + target
        terms = dtype(0.0)
        for at in range(t.row_start[i], t.row_start[i + 1]):
            p = t.row_place[at]
            data += wp.abs(k.jac[at, b] * k.vfree[p, b])
            terms += wp.abs(k.jac[at, b] * k.v[p, b])
        return ENOUGH * data + ROUND * terms

    @wp.func
    def lift(t: Topology, k: Work, b: int, n: int, passes: int):
        """Compare mu s with what v' makes of it; where they differ, move it and k.rate. `passes` < 0: take it
        halfway back to where the convex problem had a solution.
        """
        settled = int(1)
        along = dtype(0.0)
        across = dtype(0.0)
        for r in range(n):
            pair = first_of_pair(t, k, b, r)
            if pair >= 0:
                first = t.pair_row[pair]
                target = HALF * wp.abs(dot(t, k, k.v, first, b) - dot(t, k, k.v, first + 1, b))
                miss = target - k.lift[pair, b]
                change = miss - k.miss[pair, b]
                along += miss * change
                across += change * change
                if not (wp.abs(miss) <= uncertain(t, k, b, first, target)):
                    settled = 0
        if settled == 1 and passes >= 0:
            return 0
        share = dtype(0.0)
        if passes > 1 and across > SMALLEST:
            share = wp.clamp(along / across, -FARTHEST, ONE - dtype(0.05))
        for r in range(n):
            pair = first_of_pair(t, k, b, r)
            if pair >= 0:
                first = t.pair_row[pair]
                target = HALF * wp.abs(dot(t, k, k.v, first, b) - dot(t, k, k.v, first + 1, b))
                moved = wp.max(target - share * (target - k.target[pair, b]), ZERO)
                if passes < 0:
                    moved = HALF * (k.lift[pair, b] + k.target[pair, b] - k.miss[pair, b])
                else:
                    k.miss[pair, b] = target - k.lift[pair, b]
                    k.target[pair, b] = target
                k.lift[pair, b] = moved
                k.rate[first, b] = k.gap[first, b] + k.lift[pair, b]
                k.rate[first + 1, b] = k.gap[first + 1, b] + k.lift[pair, b]
        return 1

    return SimpleNamespace(lift=lift)
