"""M + J' kappa J~ of the modes of Coulomb's friction (`modes.py`), assembled and factored.

What a group's rows add to a block is summed up in registers before it is stored. A path changes one contact
at a time, and keeps what stands before the first block that this contact moves.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..linear.lu import make_lu
from ..linear.matrix import make_matrix
from ..topology import Topology
from ..work import M33, WORK, Island, Slot

OFF, HOLDS, SLIDES = 0, 1, 2  # modes of a row; SLIDES: presses, and holds the mean of the pair's rows


@cached
def make_modes_matrix() -> SimpleNamespace:
    """partner(t, k, r), factor_from(t, k, o, begin) and what solves with these factors."""
    dtype = WORK
    lu, ends = make_lu(), make_matrix().ends
    ZERO, HALF = dtype(0.0), dtype(0.5)

    @wp.func
    def partner(t: wp.ref[Topology], k: wp.ref[Slot], r: int):
        """The row whose mean with r is held: of one that slides the other one of the pair, else r itself."""
        if k.mode[r] == SLIDES:
            return r + t.row_sign[k.row[r]]
        return r

    @wp.func
    def cross_block(t: wp.ref[Topology], k: wp.ref[Slot], start: int, end: int, e: int, both: int):
        """J' kappa J~ of a group's rows, for the rows of block e and the columns of block both - e."""
        a, b, c = dtype(0.0), dtype(0.0), dtype(0.0)  # sums in registers: a matrix's are not
        d, g, h = dtype(0.0), dtype(0.0), dtype(0.0)
        p, q, s = dtype(0.0), dtype(0.0), dtype(0.0)
        f = both - e
        for r in range(start, end):
            if k.p[r] > ZERO:
                left = k.jac[k.entry[r] + e]
                held = HALF * k.p[r] * (k.jac[k.entry[r] + f] + k.jac[k.entry[partner(t, k, r)] + f])
                a += left[0] * held[0]
                b += left[0] * held[1]
                c += left[0] * held[2]
                d += left[1] * held[0]
                g += left[1] * held[1]
                h += left[1] * held[2]
                p += left[2] * held[0]
                q += left[2] * held[1]
                s += left[2] * held[2]
        return M33(a, b, c, d, g, h, p, q, s)

    @wp.func
    def assemble(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, begin: int):
        """The rows from place `begin` on of M + J' kappa J~ into k.factor, their columns into k.upper."""
        for place in range(begin, o.end):
            at = k.at[place]
            b = k.block[place]
            own = place - b + t.mass_first[b]
            for j in range(k.first[place], own):
                k.factor[at + j] = M33()
                k.upper[at + j] = M33()
            for j in range(own, place + 1):
                m = k.mass[t.mass_at[b] + j + b - place]
                k.factor[at + j] = m
                k.upper[at + j] = m
        for g in range(o.group, o.last_group):
            start, end, _entry, entries, one, two = ends(t, k, g)
            if entries > 2 or wp.max(k.place[one], k.place[two]) >= begin:
                pattern = k.pattern[start]
                for e in range(entries):
                    row = k.place[t.row_block[pattern + e]]
                    if row >= begin:
                        at = k.at[row] + row
                        k.factor[at] = k.factor[at] + cross_block(t, k, start, end, e, e + e)
                    for f in range(e):
                        column = k.place[t.row_block[pattern + f]]
                        if wp.max(row, column) >= begin:
                            at = k.at[wp.max(row, column)] + wp.min(row, column)
                            below = cross_block(t, k, start, end, wp.where(row < column, f, e), e + f)
                            k.factor[at] = k.factor[at] + below
                            above = cross_block(t, k, start, end, wp.where(row < column, e, f), e + f)
                            k.upper[at] = k.upper[at] + wp.transpose(above)

    @wp.func(inline=False)
    def factor_from(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, begin: int):
        """LU factors of the matrix of the modes at hand, of weights k.p, from place `begin` on."""
        assemble(t, k, o, begin)
        lu.factor(k.factor, k.upper, k.first, k.at, begin, o.end)

    return SimpleNamespace(partner=partner, factor_from=factor_from, lu=lu)
