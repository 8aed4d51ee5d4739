"""How what a contact's row holds, J_i v' + d/h, or J_i v' + e J_n v of one that bounces, changes with the
configuration at fixed velocities.
"""

import warp as wp

from ...factories import cached
from ..topology import Topology
from ..work import WORK, Slot
from .pairs import ACROSS, TURNS_A, TURNS_B, make_pair_slopes
from .tables import Slopes


@cached
def make_gap_slopes(given: type, residual: str) -> wp.Function:
    """gaps(t, k, d, b, pair, start, normal, rub, y, h, first): d.gap_by_q from `first` on of the row
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
        pair: int,
        start: int,
        normal: V4,
        rub: dtype,
        y: wp.array(dtype=dtype),
        h: dtype,
        first: int,
    ):
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
            for i in range(t.pair_start[pair + 1] - t.pair_start[pair]):
                d.gap_by_q[b, first + i] = d.gap_by_q[b, first + i] + d.bounced[b, i]
            return
        for i in range(t.pair_start[pair + 1] - t.pair_start[pair]):
            e = d.of_contact[b, start + i]
            a = e[wp.static(TURNS_A)]
            c = e[wp.static(TURNS_B)]
            if t.pair_side[t.pair_start[pair] + i] != 3:
                value = e[wp.static(ACROSS)] + normal[2] * a + normal[3] * c
                d.gap_by_q[b, first + i] = d.gap_by_q[b, first + i] + value / h

    return gaps
