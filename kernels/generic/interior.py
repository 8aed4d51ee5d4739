"""What solves an island: Newton's method, and where it fails a primal and dual interior-point method.

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
from .newton import ACCEPTED, REFINED, TOLERANCE, make_newton
from .scales import make_scales
from .topology import Topology
from .work import V3, WORK, Island, Slot

MAX_ITERATIONS = 80
WARM_ITERATIONS, POLISHING = 8, 12  # of Newton's method before and after
PATIENCE = 6  # iterations of it without a gain, where it has nearly ended
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
    """solve(t, k, o) -> status: k.v, k.z, k.lam of the acting rows of an island."""
    dtype = WORK
    nt = make_newton(given, residual)
    earned = make_earned(given)
    scales = make_scales(given, residual)
    hard = residual == "hard"
    LIMIT, RESIDUAL = (dtype(x) for x in END[hard])
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    SHARE = dtype(MOMENTUM)
    POSITIVE = dtype(0.01)  # smallest weight, relative to that of the hard problem
    TRUSTED = dtype(0.8)  # length of a straight step whose second order is believed
    NEAREST = dtype(5e-3)  # most that is kept of the way to the boundary
    GOOD, MORE = nt.GOOD, earned.MORE
    AIM, FINE, NEAR = dtype(TOLERANCE), dtype(min(ACCEPTED[given], REFINED)), dtype(1e-4)
    TINY, HUGE = dtype(1e-30), dtype(1e300)
    DIVERGED = dtype(1e12)
    YIELDS = dtype(YIELDING[given])
    SHRINK = dtype(1e-3)  # of the yielding, from round to round
    FASTEST = dtype(1e6)  # V, relative to the size of the problem and to v_free

    @wp.func
    def product(k: wp.ref[Slot], r: int, a: dtype, w: dtype):
        """(a w - m(a - w), m'(a - w))"""
        if wp.static(hard):
            return a * w, ZERO
        e = nt.smooth(k, r, a - w)
        return a * w - e[0] * e[1], e[2] * e[1] - e[3] * e[0]

    @wp.func
    def curve(k: wp.ref[Slot], o: Island, n: dtype):
        """Excess and weights of every acting row; mean |excess|."""
        mean = dtype(0.0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                a = k.a[r]
                w = k.w[r]
                excess, slope = product(k, r, a, w)
                p = wp.max(a + slope, POSITIVE * a)
                q = wp.max(w - slope, POSITIVE * w)
                total = p + q
                k.excess[r] = excess
                k.cross[r] = ZERO
                k.p[r] = p / total
                k.slack[r] = q / total
                k.total[r] = total
                mean += wp.abs(excess)
        return mean / n

    @wp.func
    def length(k: wp.ref[Slot], o: Island, mu: dtype, kept: dtype):
        """Length of the step after which all a and w keep at least `kept` of themselves; at most 1."""
        fall = ZERO + TINY
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                e = nt.shift(k, r, mu, 1)
                da = k.p[r] * k.dz[r] + e
                dw = e - k.slack[r] * k.dz[r]
                fall = wp.max(fall, wp.max(-da / k.a[r], -dw / k.w[r]))
        return wp.min((ONE - kept) / fall, ONE)

    @wp.func
    def mean_after(k: wp.ref[Slot], o: Island, n: dtype, step: dtype):
        """Mean |excess| after the straight step (mu = 0); k.cross: the excess after all of it."""
        mean = dtype(0.0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                e = nt.shift(k, r, ZERO, 1)
                da = k.p[r] * k.dz[r] + e
                dw = e - k.slack[r] * k.dz[r]
                excess, _slope = product(k, r, k.a[r] + step * da, k.w[r] + step * dw)
                mean += wp.abs(excess)
                if wp.static(hard):
                    k.cross[r] = wp.where(step > TRUSTED, ONE, step * step) * da * dw
        return mean / n

    @wp.func
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
    def enter(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, size: dtype, yielding: dtype):
        """v' = v_free and a, w > 0 to start from; the largest a that does not count as diverged."""
        momentum = dtype(0.0)
        for place in range(o.start, o.end):
            i = k.block[place]
            k.v[i] = k.vfree[i]
            momentum += wp.dot(wp.get_diag(k.mass[t.mass_at[i] + i]), wp.abs(k.vfree[i]))
        largest = dtype(0.0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                rate = k.rate[r] - yielding * k.diag[r] * k.least[r]
                alone = nt.smooth(k, r, -rate - nt.dot(t, k, k.v, r))
                k.a[r] = alone[0] + size + SHARE * k.scale[r] * momentum
                k.w[r] = alone[1] + size
                largest = wp.max(largest, k.a[r])
        return DIVERGED * (largest + size)

    @wp.func
    def point(k: wp.ref[Slot], o: Island, inside: int):
        """Interior point: lambda and z at a and w; the largest a. Newton's method: lambda, w and slopes at
        z.
        """
        largest = dtype(0.0)
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                if inside == 1:
                    k.lam[r] = k.a[r] / k.scale[r]
                    k.z[r] = k.a[r] - k.w[r]
                    largest = wp.max(largest, k.a[r])
                else:
                    e = nt.smooth(k, r, k.z[r])
                    k.lam[r] = e[0] / k.scale[r]
                    k.w[r] = e[1]
                    k.p[r] = e[2]
                    k.slack[r] = e[3]
        return largest

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
    ):
        """The step from here; of the interior-point method straight first, then towards the mu that this
        suggests. mu and the step's length.
        """
        mu = dtype(0.0)
        kept = dtype(0.0)
        step = dtype(1.0)
        looking = int(inside)
        more = int(1)
        while more == 1:
            nt.direction(t, k, o, mu, inside, yielding)
            more = int(0)
            if inside == 1:
                step = length(k, o, mu, kept)
            if looking == 1:
                looking = 0
                more = 1
                part = mean_after(k, o, n, step) / mean
                mu = wp.min(part * part * part, HALF) * mean  # never all of it, or short steps stall
                kept = wp.clamp(wp.sqrt(mean) / size, ZERO, NEAREST)
        return mu, step

    @wp.func
    def advance(k: wp.ref[Slot], o: Island, inside: int, mu: dtype, step: dtype):
        for place in range(o.start, o.end):
            i = k.block[place]
            k.v[i] = k.v[i] + step * k.move[i]
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                dz = k.dz[r]
                if inside == 0:
                    k.z[r] = k.z[r] + dz
                else:
                    e = nt.shift(k, r, mu, 1)
                    a = k.a[r] + step * (k.p[r] * dz + e)
                    w = k.w[r] + step * (e - k.slack[r] * dz)
                    if wp.static(not hard):  # below the curve steps would get shorter and shorter
                        least = nt.smooth(k, r, a - w)
                        a = wp.max(a, least[0])
                        w = wp.max(w, least[1])
                    k.a[r] = a
                    k.w[r] = w

    @wp.func
    def keep_least(k: wp.ref[Slot], o: Island, attempt: int):
        """k.least: the impulses that rows asked for when they yielded first (attempt 2), and what they ask
        for since, while that is of the same order: what grows with every round has no least.
        """
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                asked = k.a[r] / k.scale[r]
                if attempt > 2:
                    asked = wp.min(asked, MORE * (k.least[r] + k.alone[r]))
                k.least[r] = asked

    @wp.func
    def from_nothing(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Before rows yield first: no impulse is expected, and no rounding forgiven."""
        earned.see_all(t, k, o)
        for r in range(o.row, o.last_row):
            k.least[r] = ZERO

    @wp.func
    def keep_best(k: wp.ref[Slot], o: Island):
        for place in range(o.start, o.end):
            k.best_v[k.block[place]] = k.v[k.block[place]]
        for r in range(o.row, o.last_row):
            k.best_z[r] = k.z[r]

    @wp.func
    def take_best(k: wp.ref[Slot], o: Island):
        for place in range(o.start, o.end):
            k.v[k.block[place]] = k.best_v[k.block[place]]
        for r in range(o.row, o.last_row):
            if k.acting[r] > 0:
                k.z[r] = k.best_z[r]
                k.lam[r] = nt.smooth(k, r, k.z[r])[0] / k.scale[r]

    @wp.func
    def is_solved(worst: dtype, last: dtype):
        """Whether an interior point's residuals are small, or get no smaller."""
        return wp.where(worst <= RESIDUAL or (worst > HALF * last and worst <= GOOD), 1, 0)

    @wp.func
    def look_back(k: wp.ref[Slot], o: Island, attempt: int, it: int, worst: dtype, best: dtype, misses: int):
        """Keep the best point of Newton's method; its residual, the iterations without a gain, and whether
        they end here: at the aim, or where there is none.
        """
        least = wp.min(worst, best)
        missed = misses + wp.where(worst > HALF * best, 1, 0)
        if worst < best:
            keep_best(k, o)
        patience = wp.where(least > FINE and least < NEAR, wp.static(PATIENCE), 2)  # nearly solved
        ended = int(0)
        if missed >= patience or not (worst < HUGE) or least <= AIM:
            ended = 1
        if it >= wp.where(attempt == 0, wp.static(WARM_ITERATIONS), wp.static(POLISHING)):
            ended = 1
        return least, missed, ended

    @wp.func
    def judge(t: wp.ref[Topology], k: wp.ref[Slot], o: Island, attempt: int):
        """1: what Newton's method ended at is a solution, 0: it is none, -1: its impulses do not add up."""
        if earned.adds_up(t, k, o) == 1:
            return 1
        if attempt < 2:
            return -1
        return earned.is_earned(t, k, o)

    @wp.func
    def solve(t: wp.ref[Topology], k: wp.ref[Slot], o: Island):
        """Newton from k.v, k.z; where it fails, the interior-point method and Newton from its end. Impulses
        that do not add up on the scale of the data are looked for once more, the least that there are: rows
        yield by `yielding` of what they press more than k.least.
        """
        size, n = scales(t, k, o)
        if not wp.isfinite(size):
            return wp.static(NONFINITE)
        size = wp.max(size, TINY)
        status = int(wp.static(NOT_CONVERGED))
        attempt = int(0)
        yielding = dtype(0.0)
        inside = int(0)  # 1: in the interior-point method
        it = int(0)
        best = ZERO + HUGE  # residual, of Newton's method; of the last point, of the other
        misses = int(0)
        bound = dtype(0.0)
        while status == wp.static(NOT_CONVERGED) and attempt < 2 + wp.static(ROUNDS):
            yields = wp.where(inside == 1, yielding, ZERO)
            largest = point(k, o, inside)
            worst = nt.residuals(t, k, o, yields)
            mean = dtype(0.0)
            ended = int(0)
            found = int(0)
            it += 1
            if inside == 1:
                mean = curve(k, o, n)
                if mean <= LIMIT * LIMIT * size * size:
                    found = is_solved(worst, best)
                if found == 1 or it > wp.static(MAX_ITERATIONS) or not (largest < bound and mean < HUGE):
                    ended = 1
                best = worst + ZERO
            else:
                best, misses, ended = look_back(k, o, attempt, it, worst, best, misses)
            if ended == 0:
                nt.factor(t, k, o, yields)
                mu, step = aim(t, k, o, inside, n, size, yields, mean)
                advance(k, o, inside, mu, step)
            elif inside == 1:
                keep_least(k, o, attempt)
                if attempt == 1 and found == 0 and proves_infeasible(t, k, o, size):
                    status = int(wp.static(INFEASIBLE))
                yielding *= SHRINK
                inside = 0
                it = 0
                misses = 0
                best = ZERO + HUGE
            else:
                take_best(k, o)
                good = int(0)
                if best <= GOOD:
                    good = judge(t, k, o, attempt)
                status = wp.where(good == 1, wp.static(SOLVED), status)
                attempt = wp.where(good < 0, 2, attempt + 1)
                if attempt == 2:
                    from_nothing(t, k, o)
                    yielding = ZERO + YIELDS
                if status != wp.static(SOLVED):
                    bound = enter(t, k, o, size, yielding)
                inside = 1
                it = 0
                best = ZERO + HUGE
        return status

    return SimpleNamespace(
        solve=solve, point=point, curve=curve, aim=aim, advance=advance, rounding=nt.rounding
    )
