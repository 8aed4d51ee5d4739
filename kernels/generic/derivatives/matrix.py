"""The matrix M + J' W C of a solved step's derivatives, and its factor (`system.py`)."""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..linear.lu import make_lu
from ..newton import PROXIMAL, make_newton
from ..topology import Topology
from ..work import ISLANDS, M33, WORK, Island, Slot, island
from .slips import make_slips
from .tables import Share, Slopes


@cached
def make_matrix(given: type, residual: str) -> SimpleNamespace:
    """factor(t, k, d, b): k.factor and, where C is not J, d.upper of the acting rows, by k.p, k.slack,
    d.slides and d.yielding. factor_island(t, k, d, b, o, start): of an island, whose acting rows begin at
    `start`; where the next island's begin.
    """
    dtype = WORK
    lu, slips, nt = make_lu(), make_slips(), make_newton(given, residual)
    ONE, TAU = dtype(1.0), dtype(PROXIMAL)

    @wp.func
    def yields(k: wp.ref[Slot], d: Slopes, b: int, o: Island, start: int):
        """What a row yields by with dz, 1/T, p/D, p/(T D)."""
        tau = TAU + d.yielding[b, 0]
        r = start + 0
        for s in range(o.row, o.last_row):
            if k.acting[s] > 0:
                own = tau * k.p[s] * k.diag[s] / k.scale[s]
                inverse = ONE / (k.slack[s] + own)
                push = k.p[s] / k.scale[s]
                d.share[b, r] = Share(own, inverse, push, push * inverse)
                r += 1
        return r

    @wp.func
    def assemble(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, o: Island, start: int):
        """M + J' W C of an island, whose acting rows begin at `start`: the lower envelope in k.factor, the
        transpose of the upper one in d.upper.
        """
        upper = d.upper[b]
        for place in range(o.start, o.end):
            at = k.at[place]
            c = k.block[place]
            own = place - c + t.mass_first[c]
            for j in range(k.first[place], place + 1):
                m = M33()
                if j >= own:
                    m = k.mass[t.mass_at[c] + j + c - place]
                k.factor[at + j] = m
                upper[at + j] = m
        r = int(start)
        for s in range(o.row, o.last_row):
            if k.acting[s] > 0:
                weight = d.share[b, r][3]
                slides = d.slides[b, r]
                count = k.entry[s + 1] - k.entry[s]
                for one in range(count):
                    left = weight * k.jac[k.entry[s] + one]
                    high = k.place[t.row_block[k.pattern[s] + one]]
                    for two in range(count):
                        right = slips.held_entry(t, k, s, two, slides)
                        low = k.place[t.row_block[k.pattern[s] + two]]
                        if low <= high:
                            k.factor[k.at[high] + low] = k.factor[k.at[high] + low] + wp.outer(left, right)
                        else:
                            upper[k.at[low] + high] = upper[k.at[low] + high] + wp.outer(right, left)
                r += 1

    @wp.func(inline=False)
    def factor_island(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, o: Island, start: int):
        end = yields(k, d, b, o, start)
        if t.coulomb == 1:
            assemble(t, k, d, b, o, start)
            lu.factor(k.factor, d.upper[b], k.first, k.at, o.start, o.end)
        else:
            nt.factor(t, k, o, d.yielding[b, 0])
        return end

    @wp.func
    def factor(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int):
        start = int(0)
        for i in range(k.count[wp.static(ISLANDS)]):
            start = factor_island(t, k, d, b, island(k, i), start)

    return SimpleNamespace(factor=factor, factor_island=factor_island)
