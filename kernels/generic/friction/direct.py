"""Coulomb's hard friction of an island, solved directly.

Newton's method on modes (`modes.py`) starts at those of the last step, for a few iterations. Where it fails a
path is followed from there, and where that leads away one from nothing (`homotopy.py`); Newton's method takes
the last digits from its end. The fixed point of `coulomb.py` stays behind both: what has no solution at all
is told by it.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...status import NONFINITE, NOT_CONVERGED, SOLVED
from ..earned import make_earned
from ..scales import make_scales
from ..topology import Topology
from ..work import WORK, Island, Slot
from .homotopy import make_homotopy
from .modes import make_modes

ATTEMPTS = 5  # from the last modes, by a path from there, by three from nothing
WARM, POLISHING = 4, 12  # iterations on modes, from the last step's and from a path's end


@cached
def make_direct(given: type) -> SimpleNamespace:
    """stick_and_slide(t, k, o) -> status: k.v, k.z, k.lam and k.lift of an island."""
    dtype = WORK
    modes, homotopy = make_modes(given), make_homotopy(given)
    scales, adds_up = make_scales(given, "hard"), make_earned(given).adds_up
    ZERO, TINY = dtype(0.0), dtype(1e-30)

    @wp.func(inline=False)
    def stick_and_slide(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """SOLVED, NONFINITE or NOT_CONVERGED."""
        modes.drop_lifts(k, o)
        size, _n = scales(t, k, o)
        if not wp.isfinite(size):
            return wp.static(NONFINITE)
        size = wp.max(size, TINY)
        for r in range(o.row, o.last_row):
            k.excess[r] = wp.max(k.z[r], ZERO)
        status = int(wp.static(NOT_CONVERGED))
        attempt = int(0)
        while attempt < wp.static(ATTEMPTS) and status == wp.static(NOT_CONVERGED):
            iterations = int(wp.static(POLISHING))
            if attempt < 2:
                modes.warm(t, k, o)
            if attempt == 0:
                iterations = int(wp.static(WARM))
            elif attempt == 1:
                homotopy.from_here(t, k, o, size)
            else:
                homotopy.from_nothing(t, k, o, size, attempt - 2)
            if modes.newton(t, k, o, iterations) == 1:
                good = adds_up(t, k, o)
                if good == 0:
                    modes.leave_alone(t, k, o)
                    good = adds_up(t, k, o)
                status = wp.where(good == 1, wp.static(SOLVED), status)
            attempt += 1
        return status

    return SimpleNamespace(stick_and_slide=stick_and_slide, join_pairs=modes.join_pairs)
