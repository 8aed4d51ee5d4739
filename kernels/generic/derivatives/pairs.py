"""Derivatives of a contact pair's rows by the configuration, by loops over what moves the pair.

The formulas are those of `contact/derivatives.py`, with the kinds of shapes known at run time. With f = fn n
+ ft t and y fixed,

    d(fn J_n + ft J_t)_j/dq_k = a_j alpha_k + A_j (fn h_A'_k - ft u_A,k) + B_j (fn h_B'_k - ft u_B,k) + C_jk,

a_j = fn t.Delta_j - ft n.Delta_j, A_j and B_j tell whether j turns the body, u_A,k = h_A' (alpha_k - A_k),
and C_jk = B_i f.perp(J_B,l) - A_i f.perp(J_A,l) for the lower i and the higher l of j and k.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..motion.mechanism import make_mechanism
from ..topology import MOVES_A, MOVES_B, TURN, Topology
from ..work import WORK, Slot
from .tables import OfContact, Slopes
from .touched import make_touched

ALONG, ACROSS, ALPHA, SUPPORT_A, SUPPORT_B, SHIFT_A, SHIFT_B, JAC_A, JAC_B, TURNS_A, TURNS_B = (
    *range(8), 9, 11, 12,
)  # fmt: skip
# of `OfContact`: t.Delta_j, n.Delta_j; by q_j: alpha, h_A', h_B', u_A, u_B; J_A, J_B (two each), A_j, B_j


@cached
def make_pair_slopes(given: type, residual: str) -> SimpleNamespace:
    """prepare(.., pair, start): d.of_contact of a pair from `start` on; (n, h_A', h_B'). force(n, fn, ft): f.
    entry(e, o, f, fn, ft, below): the derivative above, for the j of entry e and the k of entry o.
    contract(..., pair, start, y, f, fn, ft, out, first): sum_j y_j of it into out[first + k] for all k.
    """
    dtype = WORK
    V2, V3, V4 = wp.types.vector(2, dtype), wp.types.vector(3, dtype), wp.types.vector(4, dtype)
    column = make_mechanism(given).column
    touched = make_touched(given, residual)
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)

    @wp.func
    def moved(t: wp.ref[Topology], k: wp.ref[Slot], b: int, at: int, side: int, p: V4):
        """Velocity of the centre of A or B by an entry of its pair, and 1 if that turns the body."""
        if (t.pair_side[at] & side) == 0:
            return V3()
        j = t.pair_dof[at]
        c = column(t, k, j, p[0], p[1])
        return V3(c[0], c[1], wp.where(t.dof_kind[j] == TURN, ONE, ZERO))

    @wp.func
    def normal_by_q(flat: int, ha: V4, hb: V4, radius: dtype, reach: dtype, along: dtype, a: dtype, c: dtype):
        """Derivatives of alpha, h_A' and h_B' by what turns A by a and B by c."""
        support_b = hb[2] * (a - c)
        beside = V3(a, along - reach * a - support_b, support_b)
        if flat == 1:
            return beside
        alpha = (along + ha[2] * a + hb[2] * c) / radius
        beyond = V3(alpha, ha[2] * (alpha - a), hb[2] * (alpha - c))
        if flat == 2:
            return HALF * (beside + beyond)
        return beyond

    @wp.func
    def prepare(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        d: Slopes,
        b: int,
        pair: int,
        start: int,
    ):
        g = touched(t, k, pair)
        n = g.n
        reach = n[0] * (g.pb[0] - g.pa[0]) + n[1] * (g.pb[1] - g.pa[1])
        first = t.pair_start[pair]
        for at in range(first, t.pair_start[pair + 1]):
            ja = moved(t, k, b, at, MOVES_A, g.pa)
            jb = moved(t, k, b, at, MOVES_B, g.pb)
            x = jb[0] - ja[0]
            y = jb[1] - ja[1]
            along = n[0] * y - n[1] * x
            change = normal_by_q(g.flat, g.ha, g.hb, g.curvature, reach, along, ja[2], jb[2])
            e = OfContact()
            e[wp.static(ALONG)] = along
            e[wp.static(ACROSS)] = n[0] * x + n[1] * y
            e[wp.static(ALPHA)] = change[0]
            e[wp.static(SUPPORT_A)] = change[1]
            e[wp.static(SUPPORT_B)] = change[2]
            e[wp.static(SHIFT_A)] = g.ha[1] * (change[0] - ja[2])
            e[wp.static(SHIFT_B)] = g.hb[1] * (change[0] - jb[2])
            e[wp.static(JAC_A)] = ja[0]
            e[wp.static(JAC_A + 1)] = ja[1]
            e[wp.static(JAC_B)] = jb[0]
            e[wp.static(JAC_B + 1)] = jb[1]
            e[wp.static(TURNS_A)] = ja[2]
            e[wp.static(TURNS_B)] = jb[2]
            d.of_contact[b, start + at - first] = e
        return V4(n[0], n[1], g.ha[1], g.hb[1])

    @wp.func
    def force(n: V2, fn: dtype, ft: dtype):
        return V2(fn * n[0] - ft * n[1], fn * n[1] + ft * n[0])

    @wp.func
    def entry(e: OfContact, o: OfContact, f: V2, fn: dtype, ft: dtype, below: int):
        """The derivative by o's degree of freedom of e's; below = 1: e's is the lower one."""
        low = e
        high = o
        if below == 0:
            low = o
            high = e
        value = (fn * e[wp.static(ALONG)] - ft * e[wp.static(ACROSS)]) * o[wp.static(ALPHA)]
        value += e[wp.static(TURNS_A)] * (fn * o[wp.static(SUPPORT_A)] - ft * o[wp.static(SHIFT_A)])
        value += e[wp.static(TURNS_B)] * (fn * o[wp.static(SUPPORT_B)] - ft * o[wp.static(SHIFT_B)])
        value -= low[wp.static(TURNS_A)] * (f[1] * high[wp.static(JAC_A)] - f[0] * high[wp.static(JAC_A + 1)])
        value += low[wp.static(TURNS_B)] * (f[1] * high[wp.static(JAC_B)] - f[0] * high[wp.static(JAC_B + 1)])
        return value

    @wp.func
    def contract(
        t: wp.ref[Topology],
        d: Slopes,
        b: int,
        pair: int,
        start: int,
        y: wp.array(dtype=dtype),
        f: V2,
        fn: dtype,
        ft: dtype,
        out: wp.array(dtype=dtype),
        first: int,
    ):
        """out[first + k] = sum_j y_j d(fn J_n + ft J_t)_j/dq_k for every entry k of a pair."""
        begin = t.pair_start[pair]
        count = t.pair_start[pair + 1] - begin
        along = dtype(0.0)
        a = dtype(0.0)
        c = dtype(0.0)
        for i in range(count):
            e = d.of_contact[b, start + i]
            rate = y[t.pair_dof[begin + i]]
            along += rate * (fn * e[wp.static(ALONG)] - ft * e[wp.static(ACROSS)])
            a += rate * e[wp.static(TURNS_A)]
            c += rate * e[wp.static(TURNS_B)]
        higher_a = dtype(0.0)  # a tree's entries go from its leaves to its root
        higher_b = dtype(0.0)
        for i in range(count):
            e = d.of_contact[b, start + i]
            rate = y[t.pair_dof[begin + i]]
            value = along * e[wp.static(ALPHA)]
            value += a * (fn * e[wp.static(SUPPORT_A)] - ft * e[wp.static(SHIFT_A)])
            value += c * (fn * e[wp.static(SUPPORT_B)] - ft * e[wp.static(SHIFT_B)])
            value += e[wp.static(TURNS_B)] * higher_b - e[wp.static(TURNS_A)] * higher_a
            out[first + i] = value
            higher_a += rate * (f[1] * e[wp.static(JAC_A)] - f[0] * e[wp.static(JAC_A + 1)])
            higher_b += rate * (f[1] * e[wp.static(JAC_B)] - f[0] * e[wp.static(JAC_B + 1)])
        a = ZERO
        c = ZERO
        for back in range(count):
            i = count - 1 - back
            e = d.of_contact[b, start + i]
            rate = y[t.pair_dof[begin + i]]
            a += rate * e[wp.static(TURNS_A)]
            c += rate * e[wp.static(TURNS_B)]
            value = c * (f[1] * e[wp.static(JAC_B)] - f[0] * e[wp.static(JAC_B + 1)])
            value -= a * (f[1] * e[wp.static(JAC_A)] - f[0] * e[wp.static(JAC_A + 1)])
            out[first + i] = out[first + i] + value

    return SimpleNamespace(prepare=prepare, force=force, entry=entry, contract=contract)
