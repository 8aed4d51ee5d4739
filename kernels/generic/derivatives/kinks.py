"""Which hard rows the derivatives of a solved step hold, and the factor of these, an island at a time.

Without Coulomb's friction they are a vertex (`vertex.py`). With it they are all rows of the modes found,
where bodies can follow these (`agreement.py`), and else what sticks beside gaps (`sticking.py`).
"""

import warp as wp

from ...factories import cached
from ..topology import Topology
from ..work import ISLANDS, WORK, Island, Slot, island
from .agreement import make_agreement
from .matrix import make_matrix
from .slips import make_slips
from .sticking import make_sticking
from .tables import Slopes
from .vertex import make_vertex

AT_ONCE = 4  # contacts that are tried together at first


@cached
def make_kinks(given: type, residual: str) -> wp.Function:
    """hold(t, k, d, b, yielding): k.p, k.slack, k.lam, d.slides and the factor; k.least is what k.lam was.
    Uses all that these four do.
    """
    agreement, matrix, slips = make_agreement(given, residual), make_matrix(given, residual), make_slips()
    sticking, vertex = make_sticking(), make_vertex(given, residual)

    @wp.func(inline=False)
    def agrees(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, o: Island, start: int):
        """Whether bodies can follow what is held; the factor of that."""
        matrix.factor_island(t, k, d, b, o, start)
        return agreement.agree(t, k, d, b, o, start)

    @wp.func(inline=False)
    def hold_friction(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, o: Island, start: int,
                      yielding: WORK):  # fmt: skip
        end = start + 0
        for s in range(o.row, o.last_row):
            end += wp.where(k.acting[s] > 0, 1, 0)
        slips.mark(t, k, d, b, start, end)
        if agrees(t, k, d, b, o, start) == 1:
            return end
        sticking.remember(t, k, d, b, o, start)
        vertex.walk(t, k, o, yielding)
        slips.mark(t, k, d, b, start, end)
        sticking.loosen(t, k, d, b, o, start)
        stale = 1 - agrees(t, k, d, b, o, start)
        if stale == 1:
            sticking.restore(t, k, o)
            slips.mark(t, k, d, b, start, end)
        most = int(wp.static(AT_ONCE))
        count = sticking.try_next(t, k, d, b, o, start, most)
        while count > 0:
            good = agrees(t, k, d, b, o, start)
            sticking.decide(t, k, d, b, o, start, good, count)
            stale = 1 - good
            most = wp.where(good == 1, 4 * most, 1)
            count = sticking.try_next(t, k, d, b, o, start, most)
        if stale == 1:
            matrix.factor_island(t, k, d, b, o, start)
        return end

    @wp.func
    def hold(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, yielding: WORK):
        vertex.open(t, k)
        start = int(0)
        for i in range(k.count[wp.static(ISLANDS)]):
            o = island(k, i)
            if t.coulomb == 1:
                start = hold_friction(t, k, d, b, o, start, yielding)
            else:
                vertex.walk(t, k, o, yielding)
                start = matrix.factor_island(t, k, d, b, o, start)

    return hold
