"""Primal and dual interior-point method of the generic kernels: finds the rows that act for Newton's.

a = D lambda > 0 and w > 0, a w = m(a - w) + mu, as in `solvers/interior.py`, but v' is an unknown too and
need not balance the impulses before the end. It starts with a as large as all momentum of the scene on one
row could make it (a hundredth of that): from small impulses a heap of unequal masses took several times the
iterations.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..status import INFEASIBLE, NONFINITE, NOT_CONVERGED, SOLVED
from .earned import make_earned
from .newton import make_newton
from .topology import Topology
from .work import WORK, Work

MAX_ITERATIONS = 80
WARM_ITERATIONS, POLISHING = 8, 12  # of Newton's method before and after
# end: sqrt(mu) and residuals relative to the size of the problem
END = {
    False: (1e-10, 1e-13),
    True: (1e-14, 1e-13),  # hard: sqrt(mu) is what a row that only just touches is off by
}
MOMENTUM = 0.01
ROUNDS = 3  # for impulses that are the least there are
YIELDING = {
    wp.float64: 2e-12,
    wp.float32: 1e-7,
}  # of rows whose impulses must be the least there are


@cached
def make_solver(given: type, residual: str) -> SimpleNamespace:
    """solve(t, k, params, row, b, n) -> status: k.v, k.z, k.lam of the acting rows."""
    dtype = WORK
    nt = make_newton(given, residual)
    earned = make_earned(given)
    hard = residual == "hard"
    SIGMA = nt.SIGMA
    LIMIT, RESIDUAL = (dtype(x) for x in END[hard])
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    SHARE = dtype(MOMENTUM)
    POSITIVE = dtype(0.01)  # smallest weight, relative to that of the hard problem
    NEAREST, FARTHEST = dtype(1e-3), dtype(0.1)  # kept of the way to the boundary
    GOOD, MORE = nt.GOOD, earned.MORE
    TINY = dtype(1e-30)
    FLOOR = dtype(1e-30)
    DIVERGED = dtype(1e12)
    YIELDS = dtype(YIELDING[given])
    SHRINK = dtype(1e-3)  # of the yielding, from round to round
    FASTEST = dtype(1e6)  # V, relative to the size of the problem and to v_free

    @wp.func
    def product(t: Topology, params: wp.array2d(dtype=given), row: int, i: int, a: dtype, w: dtype):
        """(a w - m(a - w), m'(a - w))"""
        if wp.static(hard):
            return a * w, ZERO
        e = nt.smooth(t, params, row, i, a - w)
        return a * w - e[0] * e[1], e[2] * e[1] - e[3] * e[0]

    @wp.func
    def curve(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, n: int):
        """Excess and weights of every active row; mean |excess|."""
        mean = dtype(0.0)
        for r in range(n):
            i = k.active[r, b]
            a = k.a[i, b]
            w = k.w[i, b]
            excess, slope = product(t, params, row, i, a, w)
            p = wp.max(a + slope, POSITIVE * a)
            q = wp.max(w - slope, POSITIVE * w)
            total = p + q
            k.excess[i, b] = excess
            k.p[i, b] = p / total
            k.slack[i, b] = q / total
            k.total[i, b] = total
            mean += wp.abs(excess)
        return mean / dtype(n)

    @wp.func
    def length(k: Work, b: int, n: int, mu: dtype, kept: dtype):
        """Length of the step after which all a and w keep at least `kept` of themselves; at most 1."""
        fall = ZERO + TINY
        for r in range(n):
            i = k.active[r, b]
            e = nt.shift(k, i, b, mu, 1)
            da = k.p[i, b] * k.dz[i, b] + e
            dw = e - k.slack[i, b] * k.dz[i, b]
            fall = wp.max(fall, wp.max(-da / k.a[i, b], -dw / k.w[i, b]))
        return wp.min((ONE - kept) / fall, ONE)

    @wp.func
    def mean_after(
        t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, n: int, step: dtype
    ):
        """Mean |excess| after the straight step (mu = 0)."""
        mean = dtype(0.0)
        for r in range(n):
            i = k.active[r, b]
            e = nt.shift(k, i, b, ZERO, 1)
            a = k.a[i, b] + step * (k.p[i, b] * k.dz[i, b] + e)
            w = k.w[i, b] + step * (e - k.slack[i, b] * k.dz[i, b])
            excess, _slope = product(t, params, row, i, a, w)
            mean += wp.abs(excess)
        return mean / dtype(n)

    @wp.func
    def proves_infeasible(t: Topology, k: Work, b: int, n: int, size: dtype):
        """Farkas: lambda >= 0 and -lambda . d/h > |J' lambda| . V prove that no |v'| <= V opens the rows."""
        for i in range(t.nv):
            k.move[i, b] = ZERO
        work = dtype(0.0)
        for r in range(n):
            i = k.active[r, b]
            work -= k.lam[i, b] * k.rate[i, b]
            nt.add(t, k, k.move, i, k.lam[i, b], b)
        most = dtype(0.0)
        for i in range(t.nv):
            most += wp.abs(k.move[i, b]) * wp.max(size, wp.abs(k.vfree[i, b]))
        return work > most * FASTEST

    @wp.func
    def enter(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, n: int, size: dtype):
        """v' = v_free and a, w > 0 to start from; the largest a that does not count as diverged."""
        momentum = dtype(0.0)
        for i in range(t.nv):
            k.v[i, b] = k.vfree[i, b]
            momentum += k.mass[t.mass_at[i] + i, b] * wp.abs(k.vfree[i, b])
        largest = dtype(0.0)
        for r in range(n):
            i = k.active[r, b]
            alone = nt.smooth(t, params, row, i, -k.rate[i, b] - nt.dot(t, k, k.v, i, b))
            k.a[i, b] = alone[0] + size + SHARE * k.scale[i, b] * momentum
            k.w[i, b] = alone[1] + size
            largest = wp.max(largest, k.a[i, b])
        return DIVERGED * (largest + size)

    @wp.func
    def point(k: Work, b: int, n: int):
        """lambda and z at a and w; the largest a."""
        largest = dtype(0.0)
        for r in range(n):
            i = k.active[r, b]
            k.lam[i, b] = k.a[i, b] / k.scale[i, b]
            k.z[i, b] = k.a[i, b] - k.w[i, b]
            largest = wp.max(largest, k.a[i, b])
        return largest

    @wp.func
    def aim(
        t: Topology,
        k: Work,
        params: wp.array2d(dtype=given),
        row: int,
        b: int,
        n: int,
        size: dtype,
        yielding: dtype,
        mean: dtype,
    ):
        """The step from here: straight first, then towards the mu that this suggests; mu and its length."""
        mu = dtype(0.0)
        kept = dtype(0.0)
        step = dtype(0.0)
        looking = int(1)
        more = int(1)
        while more == 1:
            nt.direction(t, k, b, n, mu, 1, yielding)
            step = length(k, b, n, mu, kept)
            more = int(0)
            if looking == 1:
                looking = 0
                more = 1
                part = mean_after(t, k, params, row, b, n, step) / mean
                mu = wp.min(part * part * part, HALF) * mean  # never all of it, or short steps stall
                kept = wp.clamp(wp.sqrt(mean) / size, NEAREST, FARTHEST)
        return mu, step

    @wp.func
    def advance(
        t: Topology,
        k: Work,
        params: wp.array2d(dtype=given),
        row: int,
        b: int,
        n: int,
        mu: dtype,
        step: dtype,
    ):
        for i in range(t.nv):
            k.v[i, b] = k.v[i, b] + step * k.move[i, b]
        for r in range(n):
            i = k.active[r, b]
            e = nt.shift(k, i, b, mu, 1)
            dz = k.dz[i, b]
            a = k.a[i, b] + step * (k.p[i, b] * dz + e)
            w = k.w[i, b] + step * (e - k.slack[i, b] * dz)
            if wp.static(not hard):  # below the curve steps would get shorter and shorter
                least = nt.smooth(t, params, row, i, a - w)
                a = wp.max(a, least[0])
                w = wp.max(w, least[1])
            k.a[i, b] = a
            k.w[i, b] = w

    @wp.func
    def interior(
        t: Topology,
        k: Work,
        params: wp.array2d(dtype=given),
        row: int,
        b: int,
        n: int,
        size: dtype,
        yielding: dtype,
    ):
        """k.v and k.z near the solution; 1 if they are. Rows yield by `yielding` diag(A) lambda."""
        bound = enter(t, k, params, row, b, n, size)
        last = dtype(1e30)
        it = int(0)
        found = int(0)
        while it < wp.static(MAX_ITERATIONS) and found == 0:
            it += 1
            largest = point(k, b, n)
            worst = nt.residuals(t, k, b, n, yielding)
            mean = curve(t, k, params, row, b, n)
            centred = mean <= LIMIT * LIMIT * size * size
            stuck = worst > HALF * last and worst <= GOOD
            if centred and (worst <= RESIDUAL or stuck):
                found = int(1)
            elif not (largest < bound and wp.isfinite(mean)):
                it = wp.static(MAX_ITERATIONS)
            else:
                last = worst + ZERO
                nt.factor(t, k, b, n, yielding)
                mu, step = aim(t, k, params, row, b, n, size, yielding, mean)
                advance(t, k, params, row, b, n, mu, step)
        return found

    @wp.func
    def prepare(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, n: int):
        """diag(A) and D of the active rows; the size of velocities, and what the residuals are judged by."""
        size = dtype(0.0)
        heaviest = dtype(0.0)  # mass that a row meets on a side of its own
        for r in range(n):
            i = k.active[r, b]
            value = dtype(0.0)
            for side in range(2):
                start = t.row_trees[4 * i + 2 * side]
                end = t.row_trees[4 * i + 2 * side + 1]
                for j in range(start, end):
                    k.move[j, b] = ZERO
                for at in range(t.row_start[i], t.row_start[i + 1]):
                    k.move[t.row_place[at], b] = k.jac[at, b]
                nt.env.forward(k.mass_factor, t.mass_first, t.mass_at, k.move, start, end, b)
                part = dtype(0.0)
                for j in range(start, end):
                    part += k.move[j, b] * k.move[j, b]
                value += part
                if part > FLOOR:
                    heaviest = wp.max(heaviest, ONE / part)
            k.diag[i, b] = wp.max(value, FLOOR)
            k.scale[i, b] = wp.where(t.inertia_scaling == 1, k.diag[i, b], ONE)
            terms = wp.abs(k.rate[i, b])
            w = k.rate[i, b]
            for at in range(t.row_start[i], t.row_start[i + 1]):
                change = k.jac[at, b] * k.vfree[t.row_place[at], b]
                terms += wp.abs(change)
                w += change
            terms += wp.abs(w)
            alone = wp.max(-w, ZERO)
            if wp.static(not hard):
                sigma = dtype(params[row, t.columns[SIGMA] + i])
                terms += sigma
                alone += sigma
            k.alone[i, b] = wp.where(value > FLOOR, alone / k.diag[i, b], ZERO)
            k.own[i, b] = terms
            k.unit[i, b] = wp.where(w < ZERO, terms, ZERO)
            size = wp.max(size, terms)
            if not wp.isfinite(terms):
                size = terms
                break
        earned.share_units(t, k, b, n)
        earned.bounds(t, k, b, n, size, heaviest * size)
        return size

    @wp.func
    def least(
        t: Topology,
        k: Work,
        params: wp.array2d(dtype=given),
        row: int,
        b: int,
        n: int,
        size: dtype,
        yielding: dtype,
    ):
        """k.v and k.z near a solution whose impulses are the nearest to k.lam that there are; rows yield
        by `yielding` of what they press more than that. 1 if they are.
        """
        for r in range(n):
            i = k.active[r, b]
            k.best_z[i, b] = k.rate[i, b]
            k.rate[i, b] = k.rate[i, b] - yielding * k.diag[i, b] * k.lam[i, b]
        found = interior(t, k, params, row, b, n, size, yielding)
        for r in range(n):
            i = k.active[r, b]
            k.rate[i, b] = k.best_z[i, b]
        return found

    @wp.func
    def keep_least(k: Work, b: int, n: int, attempt: int):
        """k.least: the impulses that rows asked for when they yielded first (attempt 2), and what they ask
        for since, while that is of the same order: what grows with every round has no least.
        """
        for r in range(n):
            i = k.active[r, b]
            asked = k.a[i, b] / k.scale[i, b]
            if attempt > 2:
                asked = wp.min(asked, MORE * (k.least[i, b] + k.alone[i, b]))
            k.least[i, b] = asked

    @wp.func
    def solve(t: Topology, k: Work, params: wp.array2d(dtype=given), row: int, b: int, n: int):
        """Newton from k.v, k.z; where it fails, the interior-point method and Newton from its end. Impulses
        that do not add up on the scale of the data are looked for once more, the least that there are.
        """
        size = prepare(t, k, params, row, b, n)
        if not wp.isfinite(size):
            return wp.static(NONFINITE)
        size = wp.max(size, TINY)
        status = int(wp.static(NOT_CONVERGED))
        attempt = int(0)
        yielding = dtype(0.0)
        good = int(0)
        while status == wp.static(NOT_CONVERGED) and attempt < 2 + wp.static(ROUNDS):
            iterations = int(wp.static(WARM_ITERATIONS))
            if attempt > 0:
                iterations = int(wp.static(POLISHING))
            if attempt == 2:
                earned.see_all(t, k, b)
                yielding = ZERO + YIELDS
            for r in range(n):
                i = k.active[r, b]
                k.lam[i, b] = wp.where(attempt > 2, k.least[i, b], ZERO)
            if attempt > 0:
                found = least(t, k, params, row, b, n, size, yielding)
                keep_least(k, b, n, attempt)
                if attempt == 1 and found == 0:
                    if proves_infeasible(t, k, b, n, size):
                        status = int(wp.static(INFEASIBLE))
                yielding *= SHRINK
            if status == wp.static(NOT_CONVERGED):
                if nt.newton(t, k, params, row, b, n, iterations) == 1:
                    good = earned.adds_up(t, k, b, n)
                    if good == 0 and attempt < 2:
                        attempt = 1
                    elif good == 0:
                        good = earned.is_earned(t, k, b, n)
                    if good == 1:
                        status = int(wp.static(SOLVED))
            attempt += 1
        return status

    return SimpleNamespace(solve=solve, rounding=nt.rounding)
