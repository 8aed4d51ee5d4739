"""Gaps a rounding beside those of the data, for islands that do not converge on them.

Where many rows touch exactly, and nothing presses, no set of rows is better than the next. A rounding of what
a row is judged by (`scales.py`), of every pair another one, decides it.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..motion.mechanism import COLUMN
from ..topology import CONTACT, Topology
from ..work import ASIDE, BESIDE, WORK, Island, Slot

NUDGES = {wp.float64: 1e-12, wp.float32: 1e-7}  # of what a row is judged by,
OTHERS = 1e-3  # and this part of that of the fastest row in the island, for those where nothing moves
GOLDEN = 0.6180339887498949  # no two multiples of it end in the same digits
MOST_BESIDE = 6  # tries, the n-th by n^2 to 2 n^2 nudges: by 7.2e-11 at most
MOST_RUBBING = 3  # with Coulomb's friction, which seldom fails for that


@cached
def make_beside(given: type) -> SimpleNamespace:
    """Warp functions that choose k.beside, what a try adds to d/h of a pair, and forget it."""
    dtype = WORK
    FRICTION = COLUMN["friction"]
    NUDGE, OTHER, ONE, ZERO = dtype(NUDGES[given]), dtype(OTHERS), dtype(1.0), dtype(0.0)

    @wp.func
    def forget(t: wp.ref[Topology], k: wp.ref[Slot]):
        """Every gap is that of the data again."""
        k.count[wp.static(BESIDE)] = 0
        if k.count[wp.static(ASIDE)] == 1:
            k.count[wp.static(ASIDE)] = 0
            for pair in range(t.pairs):
                k.beside[pair] = ZERO

    @wp.func
    def judged(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """What row r is judged by; of a row with friction without mu v_t, which is no measure of a gap."""
        i = k.row[r]
        if t.row_kind[i] == wp.static(CONTACT) and t.row_sign[i] != 0:
            return k.unit[r] / (ONE + k.numbers[t.columns[FRICTION] + t.row_index[i]])
        return k.unit[r]

    @wp.func
    def step_aside(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Choose the next try of an island that does not converge; others keep theirs, or the data."""
        k.count[wp.static(ASIDE)] = 1
        tries = k.count[wp.static(BESIDE)] + 1
        fastest = dtype(0.0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                fastest = wp.max(fastest, judged(t, k, r))
        for r in range(o.row, o.last_row):
            i = k.row[r]
            if t.row_kind[i] == wp.static(CONTACT):
                pair = t.row_index[i]
                unit = OTHER * fastest
                if k.acting[r] > 0:
                    unit = wp.max(unit, judged(t, k, r))
                part = wp.float64(tries * t.pairs + pair + 1) * wp.float64(GOLDEN)
                share = ONE + dtype(part - wp.floor(part))
                k.beside[pair] = NUDGE * dtype(tries * tries) * unit * share

    return SimpleNamespace(forget=forget, step_aside=step_aside)
