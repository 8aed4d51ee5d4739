"""Whether bodies can follow all rows that a step with Coulomb's friction holds, whatever way they are moved.

Rows whose C are dependent may hold no more than each other: of a chain that lies along a plane every
contact's gap follows from some others', wherever the chain is. All of them are held then, and any impulses of
the step give its derivative. Where they do not, the step has a kink or contacts slide after all, and a vertex
tells (`vertex.py`). Coordinates moved by numbers of no pattern ask for changes of C v': whether the linear
system's solution has them tells.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..linear.lu import make_lu
from ..motion.mechanism import COLUMN, make_mechanism
from ..newton import make_newton
from ..topology import CONTACT, Topology
from ..work import V3, WORK, Island, Slot
from .gaps import limit_slope, make_gap_slopes
from .pairs import make_pair_slopes
from .slips import make_slips
from .tables import Slopes
from .vertex import scattered

MET = 1e-6  # of the largest change that is asked for, in units of the rows' own impulses
TRIES = 4  # rows yield, most where heavy bodies press light ones: what they leave is asked for again


@cached
def make_agreement(given: type, residual: str) -> SimpleNamespace:
    """agree(t, k, d, b, o, start): 1 if bodies of an island, whose acting rows begin at `start` of the list,
    follow all of its rows. Uses the system's factor, d.of_contact, d.gap_by_q, k.dz, k.cross, k.weight and
    k.move.
    """
    nt, lu, slips = make_newton(given, residual), make_lu(), make_slips()
    number = make_mechanism(given).number
    pairs, gaps = make_pair_slopes(given, residual), make_gap_slopes(given, residual)
    V4 = wp.types.vector(4, WORK)
    H, FRICTION = COLUMN["step_size"], COLUMN["friction"]
    ZERO, ONE = WORK(0.0), WORK(1.0)

    @wp.func
    def of_contact(t: wp.ref[Topology], d: Slopes, b: int, pair: int):
        """How the row in d.gap_by_q changes."""
        out = ZERO + ZERO
        begin = t.pair_start[pair]
        for at in range(begin, t.pair_start[pair + 1]):
            out += d.gap_by_q[b, at - begin] * scattered(t.pair_dof[at])
        return out

    @wp.func
    def ask(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, o: Island, start: int):
        """k.dz: the changes that rows that press ask of C v'; the largest, and how many these are."""
        h = number(t, k, H, 0)
        normal = V4()
        last = int(-1)
        size = ZERO + ZERO
        count = int(0)
        r = start + 0
        for s in range(o.row, o.last_row):
            k.dz[s] = ZERO
            if k.acting[s] > 0:
                if k.p[s] == ONE:
                    i = k.row[s]
                    index = t.row_index[i]
                    if t.row_kind[i] == CONTACT:
                        if index != last:
                            normal = pairs.prepare(t, k, d, b, index, 0)
                            last = index + 0
                        rub = ZERO + ZERO
                        if d.slides[b, r] == 0:
                            rub = WORK(t.row_sign[i]) * number(t, k, FRICTION, index)
                        gaps(t, k, d, b, i, 0, normal, rub, k.v0, h, 0)
                        k.dz[s] = -of_contact(t, d, b, index)
                    else:
                        k.dz[s] = -limit_slope(t, k, i) * scattered(index) / h
                    size = wp.max(size, wp.abs(k.dz[s]) / wp.sqrt(k.diag[s]))
                    count += 1
                r += 1
        return size, count

    @wp.func
    def rate(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, r: int, s: int):
        """C_r of k.move."""
        out = ZERO + ZERO
        for e in range(k.entry[s + 1] - k.entry[s]):
            block = t.row_block[k.pattern[s] + e]
            out += wp.dot(slips.held_entry(t, k, s, e, d.slides[b, r]), k.move[block])
        return out

    @wp.func
    def follow(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, o: Island):
        """k.move: how bodies follow rows that push by k.weight."""
        for place in range(o.start, o.end):
            k.move[k.block[place]] = V3()
        nt.add_pushes(t, k, o)
        lu.solve(k.factor, d.upper[b], k.first, k.at, k.block, k.move, o.start, o.end)

    @wp.func(inline=False)
    def agree(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, o: Island, start: int):
        size, count = ask(t, k, d, b, o, start)
        if count < 2:
            return int(1)
        most = WORK(wp.static(MET)) * size
        for s in range(o.row, o.last_row):
            k.weight[s] = ZERO
            k.cross[s] = k.dz[s]
        tries = int(0)
        missed = int(1)
        while missed == 1 and tries < wp.static(TRIES):
            tries += 1
            missed = int(0)
            r = start + 0
            for s in range(o.row, o.last_row):
                if k.acting[s] > 0:
                    k.weight[s] = k.weight[s] + d.share[b, r][3] * k.cross[s]
                    r += 1
            follow(t, k, d, b, o)
            r = start + 0
            for s in range(o.row, o.last_row):
                if k.acting[s] > 0:
                    if k.p[s] == ONE:
                        k.cross[s] = k.dz[s] - rate(t, k, d, b, r, s)
                        if not (wp.abs(k.cross[s]) <= most * wp.sqrt(k.diag[s])):
                            missed = 1
                    r += 1
        return 1 - missed

    return SimpleNamespace(agree=agree)
