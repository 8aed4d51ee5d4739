"""What the leapfrog (M63) adds to the derivatives of the equations of motion.

Half of its Coriolis forces are those at the velocities p where Euler's step leads, with contact: dp by the
columns of (q, v, u), in d.ahead, comes first.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..motion.mechanism import COLUMN, make_mechanism
from ..topology import TURN, Topology
from ..work import WORK, Lanes, Slot
from .tables import Pair, Share, Slopes


@cached
def make_leap(given: type) -> SimpleNamespace:
    """bend(t, k, d, b): what `bodies.prepare` made of Coriolis forces at v becomes that of the mean.
    coriolis(t, k, d, b, part): adds to d.known what p's change makes of it.
    """
    number = make_mechanism(given).number
    ZERO, TWO, HALF = WORK(0.0), WORK(2.0), WORK(0.5)
    H, MASS = COLUMN["step_size"], COLUMN["mass"]

    @wp.func
    def predicted(t: wp.ref[Topology], k: wp.ref[Slot], j: int):
        return k.vfree[t.blocks + t.dof_block[j]][t.dof_part[j]]

    @wp.func
    def bend_chain(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, i: int, h: WORK):
        """Of a body's d.of_body and d.acceleration; P2(p) into d.of_coriolis."""
        start = t.chain_start[i]
        end = t.chain_start[i + 1]
        turning = ZERO + ZERO  # sums of v, p and of what changes over what turns the body so far
        faster = ZERO + ZERO
        change = ZERO + ZERO
        total = d.acceleration[b, i]
        for at in range(start, end):
            j = t.chain[at]
            e = d.of_body[b, at]
            v = d.velocity[b, j] - d.change[b, j]
            late = predicted(t, k, j)
            one = TWO * turning
            two = TWO * faster
            if t.dof_kind[j] == TURN:
                one += v
                two += late
                turning += v
                faster += late
            weight = HALF * (two * late - one * v)
            if t.dof_kind[j] == TURN:
                change += weight
            total += (h * weight) * Pair(-e[1], e[0])
            d.of_coriolis[b, at] = Share(change, weight, faster, ZERO)
        d.acceleration[b, i] = total
        by_change = Pair()  # sums over what comes later
        by_late = Pair()
        for back in range(end - start):
            at = end - 1 - back
            j = t.chain[at]
            e = d.of_body[b, at]
            s = d.of_coriolis[b, at]
            arm = Pair(e[0], e[1])
            second = s[0] * arm
            third = s[2] * arm
            if t.dof_kind[j] == TURN:
                second += by_change
                third += by_late
            by_change += s[1] * arm
            by_late += predicted(t, k, j) * arm
            e[2] = e[2] - h * second[0]
            e[3] = e[3] - h * second[1]
            d.of_body[b, at] = e
            d.of_coriolis[b, at] = Share(-third[1], third[0], ZERO, ZERO)

    @wp.func(inline=False)
    def bend(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int):
        h = number(t, k, H, 0)
        for i in range(t.nb):
            bend_chain(t, k, d, b, i, h)

    @wp.func(inline=False)
    def coriolis(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, part: int):
        h = number(t, k, H, 0)
        first = part * 3 * t.blocks
        for i in range(t.nb):
            x = Lanes()
            y = Lanes()
            for by in range(t.chain_start[i], t.chain_start[i + 1]):
                j = t.chain[by]
                ahead = d.ahead[b, first + 3 * t.dof_block[j] + t.dof_part[j]]
                s = d.of_coriolis[b, by]
                x += s[0] * ahead
                y += s[1] * ahead
            share = -h * number(t, k, MASS, i)
            for at in range(t.chain_start[i], t.chain_start[i + 1]):
                j = t.chain[at]
                p = 3 * t.dof_block[j] + t.dof_part[j]
                e = d.of_body[b, at]
                d.known[b, p] = d.known[b, p] + share * (e[0] * x + e[1] * y)

    return SimpleNamespace(bend=bend, coriolis=coriolis)
