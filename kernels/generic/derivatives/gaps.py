"""How what a contact's row holds, J_i v' + d/h, or J_i v' + e J_n v of one that bounces, changes with the
configuration at fixed velocities. Of an overlap that is not pushed out in one step, d/h is a number.
"""

import warp as wp

from ...factories import cached
from ..topology import LOWER, Topology
from ..work import WORK, Slot
from .pairs import ACROSS, TURNS_A, TURNS_B, make_pair_slopes
from .tables import Slopes


@wp.func
def limit_slope(t: wp.ref[Topology], k: wp.ref[Slot], i: int):
    """How what the row i of a limit holds, times h, changes with its degree of freedom."""
    if t.overlaps == 1:
        if k.fixed[i] != 0:
            return WORK(0.0)
    return wp.where(t.row_kind[i] == wp.static(LOWER), WORK(1.0), WORK(-1.0))


@cached
def make_gap_slopes(given: type, residual: str) -> wp.Function:
    """gaps(t, k, d, b, i, start, normal, rub, y, h, first): d.gap_by_q from `first` on of the scene's row i,
    J_n + rub J_t of a pair whose entries in d.of_contact are at `start`; `normal` is what `pairs.prepare`
    gave, y = v' by degrees of freedom.
    """
    dtype = WORK
    pairs = make_pair_slopes(given, residual)
    V2, V4 = wp.types.vector(2, dtype), wp.types.vector(4, dtype)
    ZERO, ONE = dtype(0.0), dtype(1.0)

    @wp.func
    def gaps(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        d: Slopes,
        b: int,
        i: int,
        start: int,
        normal: V4,
        rub: dtype,
        y: wp.array(dtype=dtype),
        h: dtype,
        first: int,
    ):
        pair = t.row_index[i]
        bounce = dtype(0.0)
        if t.bounces == 1:
            bounce = k.bounce[pair] + ZERO
        f = pairs.force(V2(normal[0], normal[1]), ONE, rub)
        pairs.contract(t, d, b, pair, start, y, f, ONE, rub, d.gap_by_q[b], first)
        if bounce > ZERO:
            for j in range(t.nv):
                d.before[b, j] = k.before[t.dof_block[j]][t.dof_part[j]]
            across = bounce * V2(normal[0], normal[1])
            pairs.contract(t, d, b, pair, start, d.before[b], across, bounce, ZERO, d.bounced[b], 0)
            for at in range(t.pair_start[pair + 1] - t.pair_start[pair]):
                d.gap_by_q[b, first + at] = d.gap_by_q[b, first + at] + d.bounced[b, at]
            return
        if t.overlaps == 1:
            if k.fixed[i] != 0:
                return
        for at in range(t.pair_start[pair + 1] - t.pair_start[pair]):
            e = d.of_contact[b, start + at]
            a = e[wp.static(TURNS_A)]
            c = e[wp.static(TURNS_B)]
            if (t.pair_side[t.pair_start[pair] + at] & 3) != 3:
                value = e[wp.static(ACROSS)] + normal[2] * a + normal[3] * c
                d.gap_by_q[b, first + at] = d.gap_by_q[b, first + at] + value / h

    return gaps
