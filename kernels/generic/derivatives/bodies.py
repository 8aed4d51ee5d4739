"""Derivatives of the equations of motion of bodies, by loops over their chains.

The formulas are those of `mechanism/dynamics_derivatives.py`: with P2(y, k) = sum_i y_i d2p/dq_i dq_k =
perp(J_k sum_{i <= k} y_i + sum_{i > k} y_i J_i), sums over what turns the body (i in the first one, k in the
second). What a body adds to entry (j, k) of a matrix is left to whoever needs it: columns, or a product from
the left.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ..motion.mechanism import COLUMN, make_mechanism
from ..topology import TURN, Topology
from ..work import WORK, Lanes, Slot
from .tables import OfBody, Pair, Share, Slopes


@cached
def make_bodies(given: type) -> SimpleNamespace:
    """prepare(t, k, d, b, external, world): what the others need of a solved step, from
    d.velocity and d.change. by_q(t, d, b, body, j, k) and by_v(t, k, d, b, body, j, k): what a body
    adds to d/dq_k and d/dv_k of -(M (v' - v) - h r)_j, where j and k are entries of its chain.
    turned(t, k, d, b, body, mass, out, start): adds -m' (dM/dq) m, m = d.answer. Of a leapfrog's whole step
    (M63), half of whose Coriolis forces are those at p, where Euler's ends: bend(t, k, d, b): what `prepare`
    made of those at v becomes that of the mean; coriolis(t, k, d, b, part): adds to d.known what dp, in
    d.ahead, makes of it.
    """
    dtype = WORK
    mech = make_mechanism(given)
    number, column = mech.number, mech.column
    ZERO, TWO, HALF = dtype(0.0), dtype(2.0), dtype(0.5)
    H, GRAVITY, MASS, INERTIA, COM = (COLUMN[n] for n in ("step_size", "gravity", "mass", "inertia", "com"))

    @wp.func
    def perp(x: dtype, y: dtype):
        return Pair(-y, x)

    @wp.func
    def centre(t: wp.ref[Topology], k: wp.ref[Slot], b: int, i: int):
        """Centre of mass of a body."""
        cx = number(t, k, COM, 2 * i)
        cy = number(t, k, COM, 2 * i + 1)
        f = k.frame[i]
        return Pair(f[2] + f[0] * cx - f[1] * cy, f[3] + f[1] * cx + f[0] * cy)

    @wp.func
    def chain(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, i: int, h: dtype):
        """d.of_body: J, P2(w) + h perp P2(s) and P2(v) of a body; J w + h perp J s."""
        p = centre(t, k, b, i)
        start = t.chain_start[i]
        end = t.chain_start[i + 1]
        turning = dtype(0.0)  # sums of v, w and s over what turns the body so far
        faster = dtype(0.0)
        bias = dtype(0.0)
        total = Pair()
        for at in range(start, end):
            j = t.chain[at]
            arm = column(t, k, j, p[0], p[1])
            w = d.change[b, j]
            v = d.velocity[b, j] - w
            rate = TWO * turning
            if t.dof_kind[j] == TURN:
                rate += v
            weight = rate * v
            if t.dof_kind[j] == TURN:
                turning += v
                faster += w
                bias += weight
            total += w * arm + (h * weight) * perp(arm[0], arm[1])
            d.of_body[b, at] = OfBody(arm[0], arm[1], faster, bias, turning, weight)
        by_w = Pair()  # sums of w_i J_i and so on over what comes later
        by_s = Pair()
        by_v = Pair()
        for back in range(end - start):
            at = end - 1 - back
            j = t.chain[at]
            e = d.of_body[b, at]
            arm = Pair(e[0], e[1])
            first = e[2] * arm
            second = e[3] * arm
            third = e[4] * arm
            if t.dof_kind[j] == TURN:
                first += by_w
                second += by_s
                third += by_v
            w = d.change[b, j]
            by_w += w * arm
            by_s += e[5] * arm
            by_v += (d.velocity[b, j] - w) * arm
            bent = perp(first[0], first[1]) - h * second
            rest = perp(third[0], third[1])
            d.of_body[b, at] = OfBody(arm[0], arm[1], bent[0], bent[1], rest[0], rest[1])
        return total

    @wp.func
    def prepare(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        d: Slopes,
        b: int,
        external: wp.array2d(dtype=given),
        world: int,
    ):
        h = number(t, k, H, 0)
        for i in range(t.nb):
            total = chain(t, k, d, b, i, h)
            total -= h * Pair(number(t, k, GRAVITY, 0), number(t, k, GRAVITY, 1))
            if external.shape[0] > 0:
                share = h / number(t, k, MASS, i)
                total -= share * Pair(dtype(external[world, 3 * i]), dtype(external[world, 3 * i + 1]))
            d.acceleration[b, i] = total

    @wp.func
    def by_q(t: wp.ref[Topology], d: Slopes, b: int, body: int, mass: dtype, at: int, by: int):
        e = d.of_body[b, at]
        f = d.of_body[b, by]
        value = e[0] * f[2] + e[1] * f[3]
        low = wp.min(at, by)
        if t.dof_kind[t.chain[low]] == TURN:
            a = d.acceleration[b, body]
            g = d.of_body[b, wp.max(at, by)]
            value += g[0] * a[1] - g[1] * a[0]
        return -mass * value

    @wp.func
    def by_v(t: wp.ref[Topology], d: Slopes, b: int, mass: dtype, inertia: dtype, h: dtype, at: int, by: int):
        e = d.of_body[b, at]
        f = d.of_body[b, by]
        value = mass * (e[0] * (f[0] - TWO * h * f[4]) + e[1] * (f[1] - TWO * h * f[5]))
        if t.dof_kind[t.chain[at]] == TURN and t.dof_kind[t.chain[by]] == TURN:
            value += inertia
        return value

    @wp.func
    def turned(
        t: wp.ref[Topology], d: Slopes, b: int, body: int, mass: dtype, local: wp.array(dtype=int), start: int
    ):
        """Add -m' (dM/dq) m of a body to d.scale_by_q, m = d.answer, from `start` on."""
        begin = t.chain_start[body]
        end = t.chain_start[body + 1]
        along = Pair()
        for at in range(begin, end):
            e = d.of_body[b, at]
            along += d.answer[b, t.chain[at]] * Pair(e[0], e[1])
        rate = dtype(0.0)
        for at in range(begin, end):
            j = t.chain[at]
            e = d.of_body[b, at]
            if t.dof_kind[j] == TURN:
                rate += d.answer[b, j]
            slot = start + local[j]
            d.scale_by_q[b, slot] = d.scale_by_q[b, slot] - TWO * mass * rate * (
                along[1] * e[0] - along[0] * e[1]
            )
        later = dtype(0.0)
        for back in range(end - begin):
            at = end - 1 - back
            j = t.chain[at]
            e = d.of_body[b, at]
            if t.dof_kind[j] == TURN:
                slot = start + local[j]
                d.scale_by_q[b, slot] = d.scale_by_q[b, slot] - TWO * mass * later
            later += d.answer[b, j] * (along[1] * e[0] - along[0] * e[1])

    @wp.func
    def predicted(t: wp.ref[Topology], k: wp.ref[Slot], j: int):
        return k.vfree[t.blocks + t.dof_block[j]][t.dof_part[j]]

    @wp.func
    def bend_chain(t: wp.ref[Topology], k: wp.ref[Slot], d: Slopes, b: int, i: int, h: dtype):
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

    return SimpleNamespace(
        bend=bend,
        coriolis=coriolis,
        prepare=prepare,
        by_q=by_q,
        by_v=by_v,
        turned=turned,
        MASS=MASS,
        INERTIA=INERTIA,
        H=H,
        ZERO=ZERO,
    )
