"""Passes of Coulomb's fixed point that need not end: each is one step of Newton's method.

A pass of `coulomb.py` solves the convex problem to the last digit before mu s is looked at again. Where only
the modes of a solution are wanted a step is enough, along which rows change sets one after the other.
"""

import warp as wp

from ...factories import cached
from ..linear.pivots import SOFTENED, make_pivots
from ..newton import make_newton
from ..topology import Topology
from ..work import WORK, Island, Slot
from .coulomb import make_coulomb

QUIET = 3  # in a row along which no row changes its set, after which there are no more
PIVOTS = 50  # of a pass
BY_BLOCK = 10  # in all passes, for every block of an island that is not large: what takes more is wedged


@cached
def make_passes(given: type) -> wp.Function:
    """approach(t, k, o, large) -> 1 with (k.v, k.z) near a solution, from where they are, with no more passes
    than the island has blocks; 0 where they lead far away, if it is not `large`. Needs scales and d/h without
    a lift.
    """
    nt, follow, lift = make_newton(given, "hard"), make_pivots(given), make_coulomb(given).lift
    ZERO, SOFTER = WORK(0.0), WORK(SOFTENED)

    @wp.func(inline=False)
    def approach(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, large: bool):
        passes, quiet = int(0), int(0)
        most = o.end - o.start
        left = wp.static(BY_BLOCK) * most
        going = lift(t, k, o, passes)
        while going == 1 and passes < most and quiet < wp.static(QUIET) and (large or left > 0):
            _worst, changed, _largest = nt.residuals(t, k, o, 0, ZERO)
            if changed == 1 or passes == 0:
                nt.factor(t, k, o, SOFTER)
            nt.direction(t, k, o, ZERO, 0, SOFTER)
            made = follow(t, k, o, wp.where(large, wp.static(PIVOTS), left))
            left -= made
            quiet = wp.where(made == 0, quiet + 1, 0)
            passes += 1
            going = lift(t, k, o, passes)
        return wp.where(large or left > 0, 1, 0)

    return approach
