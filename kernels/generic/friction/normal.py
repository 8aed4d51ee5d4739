"""What a large coefficient hides: the rows J_n +- mu J_t of a contact are judged on scales with mu v_t in
them, of which w_n, their mean, may be a rounding. So w_n is judged once more, by its own terms: under every
law no contact closes, and under Coulomb's none that presses opens.
"""

import warp as wp

from ...factories import cached
from ..motion.mechanism import COLUMN
from ..topology import CONTACT, Topology
from ..work import WORK, Island, Slot

OPEN = {wp.float64: 1e-8, wp.float32: 2e-5}  # of w_n, relative to what the data set of it
ROUNDED = 5e-14  # and relative to all terms of J v'


@cached
def make_normal(given: type) -> wp.Function:
    """keeps_apart(t, k, o) -> 1 if no contact of an island closes, nor one that presses opens."""
    dtype = WORK
    SHARE, LEAST = dtype(OPEN[given]), dtype(ROUNDED)
    HALF, ONE, ZERO = dtype(0.5), dtype(1.0), dtype(0.0)
    FRICTION = COLUMN["friction"]

    @wp.func
    def is_apart(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """Whether w_n of the pair of row r is nothing, or is open and may be."""
        w = k.gap[r]
        terms = wp.abs(w)
        rounds = wp.abs(w)
        for e in range(k.entry[r + 1] - k.entry[r]):
            first = k.jac[k.entry[r] + e]
            normal = HALF * (first + k.jac[k.entry[r + 1] + e])
            b = t.row_block[k.pattern[r] + e]
            w += wp.dot(normal, k.v[b])
            terms += wp.dot(wp.abs(normal), wp.abs(k.vfree[b]))
            rounds += wp.dot(wp.abs(first) + wp.abs(normal), wp.abs(k.v[b]))
        miss = wp.where(t.coulomb == 1 and k.lam[r] + k.lam[r + 1] > ZERO, wp.abs(w), -w)
        if miss <= LEAST * rounds:
            return True
        mu = k.numbers[t.columns[FRICTION] + t.row_index[k.row[r]]]
        size = wp.max(terms, wp.max(k.unit[r], k.unit[r + 1]) / (ONE + mu))
        return miss <= SHARE * size + LEAST * rounds

    @wp.func(inline=False)
    def keeps_apart(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        good = int(1)
        for r in range(o.row, o.last_row):
            i = k.row[r]
            if t.row_kind[i] == CONTACT and t.row_sign[i] > 0:
                if k.acting[r] + k.acting[r + 1] > 0 and not is_apart(t, k, r):
                    good = 0
        return good

    return keeps_apart
