"""Derivatives of springs and dampers by loops over what moves their ends; the formulas are those of
`mechanism/springs.py` and, of what implicit stiffness adds to M, of `mechanism/stiff_springs.py`.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...mechanism.stiff_springs import SHARE
from ..motion.mechanism import COLUMN, make_mechanism
from ..topology import MOVES_A, MOVES_B, TURN, Topology
from ..work import WORK, Lanes, Slot
from .tables import Groups, OfSpring, Pair, Slopes

SLOPE, BEND, DELTA, JAC_A, JAC_B, TURNS_A, TURNS_B = 0, 1, 2, 4, 6, 8, 9  # of `OfSpring`: a_j, (H y)_j,
# Delta_j, J_A, J_B (two each), A_j, B_j; and of w = v' - v:
TURN_W, BEND_W = 10, 12  # sum_i w_i Delta_ij (two), (H w)_j
PULL, BY_LENGTH, BY_RATE, INVERSE, SPAN, DAMPING = (
    0,
    1,
    2,
    3,
    4,
    6,
)  # of `pull`: G, G_s, G_m, 1/s, Delta, c;
# h^2/2 k times G, F, G_s, F_s of K; D w, a.w:
ACROSS, ALONG, ACROSS_S, ALONG_S, SPAN_W, SLOPE_W = 7, 8, 9, 10, 11, 13


@cached
def make_spring_slopes(given: type) -> SimpleNamespace:
    """prepare(t, k, g, d, b): what others need. by_q(.., i, j, k), by_v(.., i, h, j, k): what
    spring i adds to d/dq_k and d/dv_k of (h r)_j, for entries j and k of the spring. damped(.., i, h, local,
    start): adds -m' d(h C)/dq m to d.scale_by_q from `start` on, m = d.answer. stiff_by_q, stiff_by_v and
    stiffened: of -h^2/2 K (v' - v), and -m' d(h^2/2 K)/dq m.
    """
    dtype = WORK
    mech = make_mechanism(given)
    number, column = mech.number, mech.column
    H, K, C, LENGTH = (
        COLUMN[n] for n in ("step_size", "spring_stiffness", "spring_damping", "spring_length")
    )
    ZERO, HALF, ONE, TWO = dtype(0.0), dtype(0.5), dtype(1.0), dtype(2.0)
    PART, THREE_HALVES = dtype(SHARE), dtype(1.5)
    SHORT, TINY = mech.SHORT, mech.TINY

    @wp.func
    def turned(g: Groups, d: Slopes, b: int, at: int, by: int, x: dtype, y: dtype):
        """(x, y) . Delta_jk."""
        e = d.of_spring[b, at]
        o = d.of_spring[b, by]
        low = e
        high = o
        if g.spring_dof[by] < g.spring_dof[at]:
            low = o
            high = e
        value = low[wp.static(TURNS_B)] * (y * high[wp.static(JAC_B)] - x * high[wp.static(JAC_B + 1)])
        value -= low[wp.static(TURNS_A)] * (y * high[wp.static(JAC_A)] - x * high[wp.static(JAC_A + 1)])
        return value

    @wp.func
    def meet(d: Slopes, b: int, at: int, by: int):
        """Delta_j . Delta_k."""
        e = d.of_spring[b, at]
        o = d.of_spring[b, by]
        return e[wp.static(DELTA)] * o[wp.static(DELTA)] + e[wp.static(DELTA + 1)] * o[wp.static(DELTA + 1)]

    @wp.func
    def curve(g: Groups, d: Slopes, b: int, i: int, at: int, by: int):
        """H_jk."""
        p = d.pull[b, i]
        return meet(d, b, at, by) + turned(g, d, b, at, by, p[wp.static(SPAN)], p[wp.static(SPAN + 1)])

    @wp.func
    def bent(g: Groups, d: Slopes, b: int, i: int, y: wp.array(dtype=dtype), by: int):
        """(H y)_k."""
        out = dtype(0.0)
        for at in range(g.spring_start[i], g.spring_start[i + 1]):
            out += y[g.spring_dof[at]] * curve(g, d, b, i, at, by)
        return out

    @wp.func
    def swung(g: Groups, d: Slopes, b: int, i: int, y: wp.array(dtype=dtype), by: int):
        """sum_j y_j Delta_jk."""
        out = Pair()
        for at in range(g.spring_start[i], g.spring_start[i + 1]):
            rate = y[g.spring_dof[at]]
            out += rate * Pair(turned(g, d, b, at, by, ONE, ZERO), turned(g, d, b, at, by, ZERO, ONE))
        return out

    @wp.func
    def spanned(g: Groups, d: Slopes, b: int, i: int, y: wp.array(dtype=dtype)):
        """D y."""
        out = Pair()
        for at in range(g.spring_start[i], g.spring_start[i + 1]):
            e = d.of_spring[b, at]
            out += y[g.spring_dof[at]] * Pair(e[wp.static(DELTA)], e[wp.static(DELTA + 1)])
        return out

    @wp.func
    def stiffen(g: Groups, d: Slopes, b: int, i: int, share: dtype, rest: dtype):
        """What is needed of K, times `share`."""
        p = d.pull[b, i]
        inv = p[wp.static(INVERSE)]
        rho = rest * wp.sqrt(inv)
        p[wp.static(ALONG)] = share * wp.min(rho, ONE) * inv
        p[wp.static(ALONG_S)] = -share * inv * inv
        if rho < ONE:
            p[wp.static(ACROSS)] = share * (ONE - rho)
            p[wp.static(ACROSS_S)] = HALF * share * rho * inv
            p[wp.static(ALONG_S)] = -THREE_HALVES * share * rho * inv * inv
        way = spanned(g, d, b, i, d.change[b])
        p[wp.static(SPAN_W)] = way[0]
        p[wp.static(SPAN_W + 1)] = way[1]
        p[wp.static(SLOPE_W)] = way[0] * p[wp.static(SPAN)] + way[1] * p[wp.static(SPAN + 1)]
        d.pull[b, i] = p
        for at in range(g.spring_start[i], g.spring_start[i + 1]):
            way = swung(g, d, b, i, d.change[b], at)
            turn = bent(g, d, b, i, d.change[b], at)
            e = d.of_spring[b, at]
            e[wp.static(TURN_W)] = way[0]
            e[wp.static(TURN_W + 1)] = way[1]
            e[wp.static(BEND_W)] = turn
            d.of_spring[b, at] = e

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
                turning = bent(g, d, b, i, d.velocity[b], at)
                if t.implicit_damping == 0:
                    turning -= bent(g, d, b, i, d.change[b], at)
                e = d.of_spring[b, at]
                e[wp.static(BEND)] = h * turning
                d.of_spring[b, at] = e
            if t.implicit_stiffness == 1:
                stiffen(g, d, b, i, PART * h * h * wp.max(number(t, k, K, i), ZERO), rest)

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

    @wp.func
    def stiff_by_q(g: Groups, d: Slopes, b: int, i: int, at: int, by: int):
        p = d.pull[b, i]
        e = d.of_spring[b, at]
        o = d.of_spring[b, by]
        x = p[wp.static(SPAN_W)]
        y = p[wp.static(SPAN_W + 1)]
        slope = p[wp.static(SLOPE_W)]
        alike = turned(g, d, b, at, by, x, y)
        alike += e[wp.static(DELTA)] * o[wp.static(TURN_W)]
        alike += e[wp.static(DELTA + 1)] * o[wp.static(TURN_W + 1)]
        along = curve(g, d, b, i, at, by) * slope + e[wp.static(SLOPE)] * o[wp.static(BEND_W)]
        rise = p[wp.static(ACROSS_S)] * (e[wp.static(DELTA)] * x + e[wp.static(DELTA + 1)] * y)
        rise += p[wp.static(ALONG_S)] * slope * e[wp.static(SLOPE)]
        total = p[wp.static(ACROSS)] * alike + p[wp.static(ALONG)] * along
        return -(total + TWO * rise * o[wp.static(SLOPE)])

    @wp.func
    def stiff_by_v(d: Slopes, b: int, i: int, at: int, by: int):
        p = d.pull[b, i]
        along = d.of_spring[b, at][wp.static(SLOPE)] * d.of_spring[b, by][wp.static(SLOPE)]
        return p[wp.static(ACROSS)] * meet(d, b, at, by) + p[wp.static(ALONG)] * along

    @wp.func
    def stiffened(g: Groups, d: Slopes, b: int, i: int, local: wp.array(dtype=int), start: int):
        p = d.pull[b, i]
        way = spanned(g, d, b, i, d.answer[b])
        slope = way[0] * p[wp.static(SPAN)] + way[1] * p[wp.static(SPAN + 1)]
        rise = p[wp.static(ACROSS_S)] * wp.dot(way, way) + p[wp.static(ALONG_S)] * slope * slope
        for at in range(g.spring_start[i], g.spring_start[i + 1]):
            value = p[wp.static(ACROSS)] * wp.dot(way, swung(g, d, b, i, d.answer[b], at))
            value += p[wp.static(ALONG)] * slope * bent(g, d, b, i, d.answer[b], at)
            value += rise * d.of_spring[b, at][wp.static(SLOPE)]
            slot = start + local[g.spring_dof[at]]
            d.scale_by_q[b, slot] = d.scale_by_q[b, slot] - TWO * value

    return SimpleNamespace(
        prepare=prepare,
        by_q=by_q,
        by_v=by_v,
        damped=damped,
        stiff_by_q=stiff_by_q,
        stiff_by_v=stiff_by_v,
        stiffened=stiffened,
    )
