"""Derivatives of springs and dampers by loops over what moves their ends; the formulas are those of
`mechanism/springs.py`.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..mechanism import COLUMN, make_mechanism
from ..topology import MOVES_A, MOVES_B, TURN, Topology
from ..work import WORK, Lanes, Slot
from .tables import Groups, OfSpring, Pair, Slopes

SLOPE, BEND, DELTA, JAC_A, JAC_B, TURNS_A, TURNS_B = 0, 1, 2, 4, 6, 8, 9  # of `OfSpring`: a_j, (H y)_j,
# Delta_j, J_A, J_B (two each), A_j, B_j
PULL, BY_LENGTH, BY_RATE, INVERSE, SPAN, DAMPING = 0, 1, 2, 3, 4, 6  # of `pull`: G, G_s, G_m, 1/s, Delta, c


@cached
def make_spring_slopes(given: type) -> SimpleNamespace:
    """prepare(t, k, g, d, b): what others need. by_q(.., i, j, k), by_v(.., i, h, j, k): what
    spring i adds to d/dq_k and d/dv_k of (h r)_j, for entries j and k of the spring. damped(.., i, h, local,
    start): adds -m' d(h C)/dq m to d.scale_by_q from `start` on, m = d.answer.
    """
    dtype = WORK
    mech = make_mechanism(given)
    number, column = mech.number, mech.column
    H, K, C, LENGTH = (
        COLUMN[n] for n in ("step_size", "spring_stiffness", "spring_damping", "spring_length")
    )
    ZERO, HALF, ONE, TWO = dtype(0.0), dtype(0.5), dtype(1.0), dtype(2.0)
    SHORT, TINY = mech.SHORT, mech.TINY

    @wp.func
    def curve(g: Groups, d: Slopes, b: int, i: int, at: int, by: int):
        """H_jk."""
        e = d.of_spring[b, at]
        o = d.of_spring[b, by]
        low = e
        high = o
        if g.spring_dof[by] < g.spring_dof[at]:
            low = o
            high = e
        p = d.pull[b, i]
        x = p[wp.static(SPAN)]
        y = p[wp.static(SPAN + 1)]
        value = e[wp.static(DELTA)] * o[wp.static(DELTA)] + e[wp.static(DELTA + 1)] * o[wp.static(DELTA + 1)]
        value -= low[wp.static(TURNS_A)] * (y * high[wp.static(JAC_A)] - x * high[wp.static(JAC_A + 1)])
        value += low[wp.static(TURNS_B)] * (y * high[wp.static(JAC_B)] - x * high[wp.static(JAC_B + 1)])
        return value

    @wp.func
    def bent(g: Groups, d: Slopes, b: int, i: int, y: wp.array(dtype=dtype), by: int):
        """(H y)_k."""
        out = dtype(0.0)
        for at in range(g.spring_start[i], g.spring_start[i + 1]):
            out += y[g.spring_dof[at]] * curve(g, d, b, i, at, by)
        return out

    @wp.func
    def prepare(t: wp.ref[Topology], k: wp.ref[Slot], g: Groups, d: Slopes, b: int):
        h = number(t, k, H, 0)
        for i in range(t.springs):
            pa = mech.tied_point(t, k, 2 * i)
            pb = mech.tied_point(t, k, 2 * i + 1)
            delta = Pair(pb[0] - pa[0], pb[1] - pa[1])
            rate = dtype(0.0)
            for at in range(g.spring_start[i], g.spring_start[i + 1]):
                j = g.spring_dof[at]
                turns = wp.where(t.dof_kind[j] == TURN, ONE, ZERO)
                e = OfSpring()
                if (g.spring_side[at] & MOVES_A) != 0:
                    c = column(t, k, j, pa[0], pa[1])
                    e[wp.static(JAC_A)] = c[0]
                    e[wp.static(JAC_A + 1)] = c[1]
                    e[wp.static(TURNS_A)] = turns
                if (g.spring_side[at] & MOVES_B) != 0:
                    c = column(t, k, j, pb[0], pb[1])
                    e[wp.static(JAC_B)] = c[0]
                    e[wp.static(JAC_B + 1)] = c[1]
                    e[wp.static(TURNS_B)] = turns
                x = e[wp.static(JAC_B)] - e[wp.static(JAC_A)]
                y = e[wp.static(JAC_B + 1)] - e[wp.static(JAC_A + 1)]
                e[wp.static(DELTA)] = x
                e[wp.static(DELTA + 1)] = y
                e[wp.static(SLOPE)] = delta[0] * x + delta[1] * y
                d.of_spring[b, at] = e
                seen = d.velocity[b, j]
                if t.implicit_damping == 0:
                    seen -= d.change[b, j]
                rate += e[wp.static(SLOPE)] * h * seen
            rest = number(t, k, LENGTH, i)
            loss = number(t, k, C, i)
            eps = SHORT * rest + TINY
            inv = ONE / (wp.dot(delta, delta) + eps * eps)
            pull = h * number(t, k, K, i) * rest * wp.sqrt(inv)
            p = Lanes()
            p[wp.static(PULL)] = h * number(t, k, K, i) - pull + loss * rate * inv
            p[wp.static(BY_LENGTH)] = inv * (HALF * pull - loss * rate * inv)
            p[wp.static(BY_RATE)] = loss * inv
            p[wp.static(INVERSE)] = inv
            p[wp.static(SPAN)] = delta[0]
            p[wp.static(SPAN + 1)] = delta[1]
            p[wp.static(DAMPING)] = loss
            d.pull[b, i] = p
            for at in range(g.spring_start[i], g.spring_start[i + 1]):
                turned = bent(g, d, b, i, d.velocity[b], at)
                if t.implicit_damping == 0:
                    turned -= bent(g, d, b, i, d.change[b], at)
                e = d.of_spring[b, at]
                e[wp.static(BEND)] = h * turned
                d.of_spring[b, at] = e

    @wp.func
    def by_q(g: Groups, d: Slopes, b: int, i: int, at: int, by: int):
        p = d.pull[b, i]
        e = d.of_spring[b, at]
        o = d.of_spring[b, by]
        slope = (
            TWO * p[wp.static(BY_LENGTH)] * o[wp.static(SLOPE)] + p[wp.static(BY_RATE)] * o[wp.static(BEND)]
        )
        return -(p[wp.static(PULL)] * curve(g, d, b, i, at, by) + e[wp.static(SLOPE)] * slope)

    @wp.func
    def by_v(d: Slopes, b: int, i: int, h: dtype, at: int, by: int):
        e = d.of_spring[b, at]
        o = d.of_spring[b, by]
        return -h * d.pull[b, i][wp.static(BY_RATE)] * e[wp.static(SLOPE)] * o[wp.static(SLOPE)]

    @wp.func
    def damped(g: Groups, d: Slopes, b: int, i: int, h: dtype, local: wp.array(dtype=int), start: int):
        along = dtype(0.0)
        for at in range(g.spring_start[i], g.spring_start[i + 1]):
            along += d.answer[b, g.spring_dof[at]] * d.of_spring[b, at][wp.static(SLOPE)]
        p = d.pull[b, i]
        weight = TWO * h * p[wp.static(DAMPING)] * p[wp.static(INVERSE)] * along
        for at in range(g.spring_start[i], g.spring_start[i + 1]):
            value = bent(g, d, b, i, d.answer[b], at)
            value -= along * p[wp.static(INVERSE)] * d.of_spring[b, at][wp.static(SLOPE)]
            slot = start + local[g.spring_dof[at]]
            d.scale_by_q[b, slot] = d.scale_by_q[b, slot] - weight * value

    return SimpleNamespace(prepare=prepare, by_q=by_q, by_v=by_v, damped=damped)
