"""Coulomb's hard friction of an island, solved directly.

Newton's method on modes (`modes.py`) starts at those of the last step. Where it fails, the interior-point
method finds a point to start from: at every of its points d/h is lifted by what mu |J_t v'| is there, so that
its path ends at Coulomb's law where it ends. Linearly at the last, so that modes take over before; and not
always, so that the fixed point of `coulomb.py` stays behind both.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...status import NONFINITE, NOT_CONVERGED, SOLVED
from ..earned import make_earned
from ..interior import MAX_ITERATIONS, make_interior
from ..newton import make_newton
from ..scales import make_scales
from ..topology import Topology
from ..work import WORK, Island, Slot
from .modes import make_modes

ATTEMPTS = 3  # from the last modes, from the interior-point method, without what cycles
WARM, POLISHING = 4, 12  # iterations on modes, from the last step's and from the other method's
FLOOR = 0.03  # of a and w that it starts from, relative to the size of the problem
HANDED_OVER = 1e-8  # sqrt(mu) relative to the size of the problem, where modes take over


@cached
def make_direct(given: type) -> SimpleNamespace:
    """stick_and_slide(t, k, o) -> status: k.v, k.z, k.lam and k.lift of an island."""
    dtype = WORK
    nt, solver, modes = make_newton(given, "hard"), make_interior(given, "hard"), make_modes(given)
    scales, adds_up = make_scales(given, "hard"), make_earned(given).adds_up
    ZERO, TINY, LIMIT = dtype(0.0), dtype(1e-30), dtype(HANDED_OVER**2)
    INSIDE, DIVERGED = dtype(FLOOR), dtype(1e12)

    @wp.func
    def enter(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, size: dtype):
        """From the last step's impulses (D lambda in k.excess) into the interior; the largest a that does not
        count as diverged.
        """
        for r in range(o.row, o.last_row):
            k.weight[r] = ZERO
            if k.acting[r] > 0:
                k.weight[r] = k.excess[r] / k.scale[r]
        modes.push(t, k, o)
        modes.measure(t, k, o)
        modes.lift(t, k, o)
        largest = size
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                k.a[r] = wp.max(k.excess[r], INSIDE * size)
                k.w[r] = wp.max(k.rate[r] - k.gap[r] + k.total[r], INSIDE * size)
                largest = wp.max(largest, k.a[r])
        return DIVERGED * largest

    @wp.func
    def approach(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, size: dtype, n: dtype):
        """k.v and impulses k.a near a solution, by the interior-point method."""
        bound = enter(t, k, o, size)
        it = int(0)
        while it < wp.static(MAX_ITERATIONS):
            it += 1
            modes.measure(t, k, o)
            modes.lift(t, k, o)
            largest = dtype(0.0)
            for r in range(o.row, o.last_row):
                if k.acting[r] > 0:
                    nt.put(k, r, 1)
                    largest = wp.max(largest, k.a[r])
                    k.res[r] = k.rate[r] - k.gap[r] + k.total[r] - k.w[r]
            nt.unbalanced(t, k, o)
            mean = solver.curve(k, o, n)
            if mean > LIMIT * size * size and largest < bound:
                nt.factor(t, k, o, ZERO)
                step = solver.aim(t, k, o, 1, n, size, ZERO, mean, 0)
                solver.advance(k, o, n, 1, step)
            else:
                it = int(wp.static(MAX_ITERATIONS))
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                k.a[r] = k.a[r] / k.scale[r]

    @wp.func
    def stick_and_slide(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """SOLVED, NONFINITE or NOT_CONVERGED."""
        modes.drop_lifts(k, o)
        size, n = scales(t, k, o)
        if not wp.isfinite(size):
            return wp.static(NONFINITE)
        size = wp.max(size, TINY)
        modes.warm(t, k, o)
        status = int(wp.static(NOT_CONVERGED))
        attempt = int(0)
        while attempt < wp.static(ATTEMPTS) and status == wp.static(NOT_CONVERGED):
            iterations = int(wp.static(WARM))
            if attempt > 0:
                iterations = int(wp.static(POLISHING))
            if attempt == 1:
                approach(t, k, o, size, n)
            elif attempt > 1:
                modes.let_go(t, k, o)
            if modes.newton(t, k, o, wp.where(attempt == 1, 0, 1), iterations) == 1:
                good = adds_up(t, k, o)
                if good == 0:
                    modes.leave_alone(t, k, o)
                    good = adds_up(t, k, o)
                status = wp.where(good == 1, wp.static(SOLVED), status)
            attempt += 1
        return status

    return SimpleNamespace(stick_and_slide=stick_and_slide, join_pairs=modes.join_pairs)
