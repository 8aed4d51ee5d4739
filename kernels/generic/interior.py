"""Primal and dual interior-point method of the generic kernels.

a = D lambda > 0 and w > 0, a w = m(a - w) + mu, as in `solvers/interior.py`, but v' is an unknown too and
need not balance the impulses before the end. Warm it starts from the last impulses and what they make of v';
cold with a as large as all momentum of the scene on one row could make it (a hundredth of that): from small
impulses a heap of unequal masses took several times the iterations. A step is aimed at the mean of a w that
the straight one suggests, with what that leaves of a w (Mehrotra).
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from .newton import make_newton
from .topology import Topology
from .work import V3, WORK, Island, Slot

MAX_ITERATIONS = 80
MOMENTUM = 0.01


@cached
def make_interior(given: type, residual: str) -> SimpleNamespace:
    """Warp functions of an island's iteration: enter, curve, aim, advance, and proves_infeasible."""
    dtype = WORK
    nt = make_newton(given, residual)
    hard = residual == "hard"
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    SHARE = dtype(MOMENTUM)
    POSITIVE = dtype(0.01)  # smallest weight, relative to that of the hard problem
    TRUSTED = dtype(0.8)  # length of a straight step whose second order is believed
    FLOORED = dtype(0.1)  # a and w of a warm start, relative to the size of the problem
    NEAREST, CLOSE = dtype(1e-6), dtype(0.005)  # kept of the way to the boundary
    CAREFUL, FARTHEST = dtype(1e-3), dtype(0.1)  # where that failed
    TINY = dtype(1e-30)
    DIVERGED = dtype(1e12)
    FASTEST = dtype(1e6)  # V, relative to the size of the problem and to v_free

    @wp.func
    def product(k: wp.ref[Slot], r: int, a: dtype, w: dtype):
        """(a w - m(a - w), m'(a - w))"""
        if wp.static(hard):
            return a * w, ZERO
        e = nt.smooth(k, r, a - w)
        return a * w - e[0] * e[1], e[2] * e[1] - e[3] * e[0]

    @wp.func
    def bend(k: wp.ref[Slot], r: int, a: dtype, w: dtype, excess: dtype, slope: dtype):
        """Excess and weights of a row; |excess|."""
        p = wp.max(a + slope, POSITIVE * a)
        q = wp.max(w - slope, POSITIVE * w)
        total = p + q
        inverse = ONE / total
        k.excess[r] = excess
        k.cross[r] = ZERO
        k.p[r] = p * inverse
        k.slack[r] = q * inverse
        k.total[r] = total
        return wp.abs(excess)

    @wp.func(inline=False)
    def curve(k: wp.ref[Slot], o: Island, n: dtype):
        """Excess and weights of every acting row; mean |excess|."""
        mean = dtype(0.0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                a = k.a[r]
                w = k.w[r]
                excess, slope = product(k, r, a, w)
                mean += bend(k, r, a, w, excess, slope)
        return mean / n

    @wp.func(inline=False)
    def mean_after(k: wp.ref[Slot], o: Island, n: dtype, step: dtype, cold: int):
        """Mean |excess| after the straight step (mu = 0); k.cross: the excess after all of it."""
        mean = dtype(0.0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                e = k.aimed[r]
                da = k.p[r] * k.dz[r] + e
                dw = e - k.slack[r] * k.dz[r]
                excess, _slope = product(k, r, k.a[r] + step * da, k.w[r] + step * dw)
                mean += wp.abs(excess)
                if cold == 0:
                    k.cross[r] = wp.where(step > TRUSTED, ONE, step * step) * da * dw
        return mean / n

    @wp.func(inline=False)
    def proves_infeasible(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, size: dtype):
        """Farkas: lambda >= 0 and -lambda . d/h > |J' lambda| . V prove that no |v'| <= V opens the rows."""
        for place in range(o.start, o.end):
            k.move[k.block[place]] = V3()
        work = dtype(0.0)
        for r in range(o.row, o.last_row):
            k.weight[r] = ZERO
            if k.acting[r] > 0:
                work -= k.lam[r] * k.rate[r]
                k.weight[r] = k.lam[r]
        nt.add_pushes(t, k, o)
        most = dtype(0.0)
        for place in range(o.start, o.end):
            i = k.block[place]
            free = wp.abs(k.vfree[i])
            most += wp.dot(wp.abs(k.move[i]), wp.max(V3(size, size, size), free))
        return work > most * FASTEST

    @wp.func
    def impulsive(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """k.v = v_free + M^-1 J' k.least"""
        for place in range(o.start, o.end):
            k.move[k.block[place]] = V3()
        for r in range(o.row, o.last_row):
            k.weight[r] = wp.where(k.acting[r] > 0, k.least[r], ZERO)
        nt.add_pushes(t, k, o)
        for place in range(o.start, o.end):
            u = t.block_unit[k.block[place]]
            start = t.unit_start[u]
            if k.block[place] == start:
                end = t.unit_start[u + 1]
                nt.env.solve(k.mass_factor, t.mass_first, t.mass_at, t.block_id, k.move, start, end)
        for place in range(o.start, o.end):
            i = k.block[place]
            k.v[i] = k.vfree[i] + k.move[i]

    @wp.func(inline=False)
    def enter(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, size: dtype, yielding: dtype, cold: int):
        """v', and a, w > 0 to start from; the largest a that does not count as diverged."""
        momentum = dtype(0.0)
        for place in range(o.start, o.end):
            i = k.block[place]
            k.v[i] = k.vfree[i]
            momentum += wp.dot(wp.get_diag(k.mass[t.mass_at[i] + i]), wp.abs(k.vfree[i]))
        if cold == 0:
            impulsive(t, k, o)
        largest = dtype(0.0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                w = k.rate[r] - yielding * k.diag[r] * k.least[r] + nt.dot(t, k, k.v, r)
                alone = nt.smooth(k, r, -w)
                if cold == 1:
                    k.a[r] = alone[0] + size + SHARE * k.scale[r] * momentum
                    k.w[r] = alone[1] + size
                else:
                    k.a[r] = wp.max(k.scale[r] * k.least[r], FLOORED * size)
                    k.w[r] = wp.max(w, FLOORED * size)
                largest = wp.max(largest, wp.max(k.a[r], alone[0] + size))
        return DIVERGED * (largest + size)

    @wp.func
    def aim(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        o: Island,
        inside: int,
        n: dtype,
        size: dtype,
        yielding: dtype,
        mean: dtype,
        cold: int,
    ):
        """The step from here; of the interior-point method straight first, then towards the mu that this
        suggests: warm, with what is left of the second order (Mehrotra's corrector is bold in a heap of very
        unequal masses). The step's length.
        """
        mu = dtype(0.0)
        kept = dtype(0.0)
        step = dtype(1.0)
        looking = int(inside)
        more = int(1)
        while more == 1:
            fall = nt.direction(t, k, o, mu, inside, yielding)
            more = int(0)
            if inside == 1:
                step = wp.min((ONE - kept) / wp.max(fall, TINY), ONE)
            if looking == 1:
                looking = 0
                more = 1
                part = mean_after(k, o, n, step, cold) / mean
                mu = wp.min(part * part * part, HALF) * mean  # never all of it, or short steps stall
                kept = wp.sqrt(mean) / size
                if cold == 1:
                    kept = wp.clamp(kept, CAREFUL, FARTHEST)
                else:
                    kept = wp.clamp(kept, NEAREST, CLOSE)
        return step

    @wp.func(inline=False)
    def advance(k: wp.ref[Slot], o: Island, n: dtype, inside: int, step: dtype):
        """Make the step; inside with what `curve` finds there, whose mean is given back."""
        for place in range(o.start, o.end):
            i = k.block[place]
            k.v[i] = k.v[i] + step * k.move[i]
        mean = dtype(0.0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                dz = k.dz[r]
                if inside == 0:
                    k.z[r] = k.z[r] + dz
                else:
                    e = k.aimed[r]
                    a = k.a[r] + step * (k.p[r] * dz + e)
                    w = k.w[r] + step * (e - k.slack[r] * dz)
                    slope = dtype(0.0)
                    excess = dtype(0.0)
                    if wp.static(hard):
                        excess = a * w
                    else:  # below the curve steps would get shorter and shorter
                        on = nt.smooth(k, r, a - w)
                        a = wp.max(a, on[0])
                        w = wp.max(w, on[1])
                        excess = a * w - on[0] * on[1]
                        slope = on[2] * on[1] - on[3] * on[0]
                    k.a[r] = a
                    k.w[r] = w
                    mean += bend(k, r, a, w, excess, slope)
        return mean / n

    return SimpleNamespace(
        enter=enter, curve=curve, aim=aim, advance=advance, proves_infeasible=proves_infeasible
    )
