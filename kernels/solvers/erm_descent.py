"""Minima of ERM's objective (15), which is not convex: descent from several starts.

Levenberg-Marquardt, never to a larger objective, with damped steps made longer as long as that helps (the
descent from a saddle starts slowly); a status says whether it ends where the gradient vanishes. The starts:
the REM solution, and minima of sum c_i w_i^2 + (1 - c_i) a_i^2, which the objective looks like where c_i = 1
for closed rows, 0 for open ones. c is the REM solution's choice but for one row; 1/2 but for one closed row;
or 1/2, which is ERM for sigma to infinity. After TRIAL iterations from each of these the best goes on to the
end; it counts where it beats the descent from the REM solution. How often that misses the least minimum is in
docs/understand/residuals.md.
"""

import dataclasses

import warp as wp

from ..contact.problem import make_measure, make_problem
from ..contact.rows import make_rows
from ..factories import cached
from ..method import Method
from ..residual.noise import make_noise
from ..residual.residuals import make_residuals
from ..specialisation import Specialisation
from ..status import NOT_CONVERGED, SOLVED
from .convex import make_solver
from .erm import PROXIMAL, make_erm, make_gather

MAX_ITERATIONS = 200
TRIES = 6  # a damped step, of a region that is not convex, is lengthened as often as the value falls
PROMISE = 10.0  # a start with sum min(a, w)^2 above this part of the objective at hand is passed over
TRIAL = 2  # iterations from a start before it is compared with the others
GAIN = {wp.float64: 1e-9, wp.float32: 1e-4}  # of the objective, at least, for another minimum to be taken
NOTHING = 1e-6  # an objective below this part of sum sigma^2 has nothing left to gain


@cached
def make_erm_search(n: int, dtype: type, residual: str) -> wp.Function:
    """minimise(A, w0, D, sigma, start, unit) -> lambda, w, status, iterations, for n rows."""
    erm = make_erm(n, dtype, residual)
    VR, MR = erm.VR, erm.MR
    terms, assemble, hessian, sizes = erm.terms, erm.assemble, erm.hessian, erm.sizes
    factor, substitute = erm.factor, erm.substitute
    value = make_residuals(dtype).by_name[residual]
    ZERO, HALF, ONE, TEN = (dtype(x) for x in (0.0, 0.5, 1.0, 10.0))
    GROW = dtype(4.0)
    TOL = dtype(1e-14 if dtype is wp.float64 else 1e-6)
    ACCEPT = dtype(1e-11 if dtype is wp.float64 else 2e-5)
    SMALLEST, LARGEST = dtype(1e-9 if dtype is wp.float64 else 1e-6), dtype(1e12)
    FIRST = dtype(1e-3)
    FLAT = dtype(1e-10 if dtype is wp.float64 else 1e-4)  # share of the value whose gain rounding may hide
    TAU = dtype(PROXIMAL[dtype])
    ROUND, LOST = (dtype(x) for x in ((1.1e-16, 1e-10) if dtype is wp.float64 else (6e-8, 2e-5)))
    FAR = dtype(PROMISE)
    KEEP, SPENT = dtype(1.0 - GAIN[dtype]), dtype(NOTHING)
    LAST = 2 * n + 2  # starts: 0, 1..n, n + 1..2 n, 2 n + 1, and the best of these but the first
    HUGE = dtype(1e300 if dtype is wp.float64 else 1e38)

    @wp.struct
    class Point:
        a: VR
        w: VR
        gradient: VR
        value: dtype
        worst: dtype  # largest component of the gradient, each over its unit times D_i + A_ii

    @wp.struct
    class End:
        lam: VR
        w: VR
        value: dtype
        status: int
        iterations: int

    @wp.func
    def evaluate(A: MR, w0: VR, scale: VR, sigma: VR, unit: VR, lam: VR):
        out = Point()
        out.w = w0 + A * lam
        ra = VR()
        rw = VR()
        for i in range(n):
            out.a[i] = scale[i] * lam[i]
            out.value += wp.static(value)(out.a[i], out.w[i], sigma[i])
            t = terms(out.a[i], out.w[i], sigma[i])
            ra[i] = scale[i] * t[0]
            rw[i] = t[1]
        out.gradient = ra + A * rw
        for i in range(n):
            out.worst = wp.max(out.worst, wp.abs(out.gradient[i]) / ((scale[i] + A[i, i]) * unit[i]))
        if not wp.isfinite(out.value + wp.dot(out.gradient, out.gradient)):  # wp.max drops a NaN
            out.worst = HUGE
        return out

    @wp.func
    def gain(at: Point, there: Point, step: VR):
        # values this close differ by rounding (tails cancel): the trapezoidal rule
        out = at.value - there.value
        if wp.abs(out) <= FLAT * at.value:
            out = -HALF * wp.dot(at.gradient + there.gradient, step)
        return out

    @wp.func
    def descend(A: MR, w0: VR, scale: VR, sigma: VR, unit: VR, start: VR, limit: int):
        """Levenberg-Marquardt from lambda = start: `limit` iterations, or less."""
        out = End()
        lam = start
        size = sizes(A, scale)
        at = evaluate(A, w0, scale, sigma, unit, lam)
        damping = dtype(0.0)
        it = int(0)
        status = int(wp.static(NOT_CONVERGED))
        while status == wp.static(NOT_CONVERGED) and it < limit:
            it += 1
            out.iterations += 1
            if at.worst <= TOL:
                status = wp.static(SOLVED)
                break
            moved = int(0)
            l, ok = factor(hessian(A, scale, sigma, at.a, at.w), size, damping + TAU)
            tries = int(0)
            step = VR()
            if ok == 1:
                tries = int(wp.static(TRIES))
                step = -substitute(l, at.gradient)
            while tries > 0:
                tries -= 1
                there = evaluate(A, w0, scale, sigma, unit, lam + step)
                if there.worst < HUGE and gain(at, there, step) > ZERO:
                    lam += step
                    at = there
                    moved = int(1)
                    step = GROW * step
                    if damping == ZERO:
                        tries = int(0)
                else:
                    tries = int(0)
            if moved == 1:
                damping = damping / TEN
                if damping < SMALLEST:
                    damping = ZERO
            else:
                damping = wp.max(TEN * damping, FIRST)
                if damping > LARGEST:
                    it = limit
        if status == wp.static(NOT_CONVERGED) and at.worst <= ACCEPT:
            status = wp.static(SOLVED)
        out.lam = lam
        out.w = at.w
        out.value = at.value
        out.status = status
        return out

    @wp.func
    def other_side(A: MR, w0: VR, scale: VR, closed: VR):
        """Minimum of sum closed_i w_i^2 + (1 - closed_i) a_i^2."""
        opened = VR()
        weighted = VR()
        for i in range(n):
            opened[i] = ONE - closed[i]
            weighted[i] = closed[i] * w0[i]
        l, _ok = factor(assemble(A, scale, opened, VR(), closed), sizes(A, scale), TAU)
        return -substitute(l, A * weighted)

    @wp.func
    def plain(A: MR, w0: VR, scale: VR, lam: VR):
        """sum min(a, w)^2"""
        w = w0 + A * lam
        out = dtype(0.0)
        for i in range(n):
            x = wp.min(scale[i] * lam[i], w[i])
            out += x * x
        return out

    @wp.func
    def minimise(A: MR, w0: VR, scale: VR, sigma: VR, rem: VR, unit: VR):
        """The least of the minima found from the REM solution and from other starts.

        unit: by row, what a vanishing gradient is relative to.
        """
        closed = VR()
        w = w0 + A * rem
        level = ZERO
        for i in range(n):
            level += sigma[i] * sigma[i]
            if scale[i] * rem[i] > w[i]:
                closed[i] = ONE
        best = End()
        hope = End()  # the best of the others
        iterations = int(0)
        k = int(0)
        while k <= wp.static(LAST):
            lam = rem
            limit = int(wp.static(MAX_ITERATIONS))
            worth = int(1)
            if k == wp.static(LAST):
                lam = hope.lam
                worth = wp.where(hope.value < HUGE, 1, 0)
            elif k > 0:
                limit = int(wp.static(TRIAL))
                choice = VR(HALF)
                if k <= n:
                    choice = closed
                    choice[k - 1] = ONE - closed[k - 1]
                elif k <= wp.static(2 * n):
                    choice[k - wp.static(n + 1)] = ONE
                lam = other_side(A, w0, scale, choice)
                worth = wp.where(best.value * FAR > plain(A, w0, scale, lam), 1, 0)
            if worth == 1:
                end = descend(A, w0, scale, sigma, unit, lam, limit)
                iterations += end.iterations
                if k == 0:
                    best = end
                    hope.value = HUGE
                    if best.status == wp.static(SOLVED) and best.value <= SPENT * level:
                        k = wp.static(LAST)
                elif k == wp.static(LAST):
                    if end.status == wp.static(SOLVED):
                        if best.status != wp.static(SOLVED) or end.value < best.value * KEEP:
                            best = end
                elif end.value < hope.value * KEEP:
                    hope = end
            k += 1
        for i in range(n):
            told = ZERO  # of w: impulses against each other may leave no digits of it
            for j in range(n):
                told += wp.abs(A[i, j] * best.lam[j])
            if not (ROUND * told <= LOST * unit[i]):
                best.status = wp.static(NOT_CONVERGED)
        return best.lam, best.w, best.status, iterations

    return minimise


def twin(method: Method) -> Method:
    """The REM method of the same noise."""
    return dataclasses.replace(method, residual=method.residual.replace("erm", "rem"))


@cached
def make_erm_solver(spec: Specialisation) -> wp.Function:
    """As `make_solver`; z = D lambda - w. `mask` must hold every row."""
    s, dtype, method = spec
    search = make_erm_search(s.nr, dtype, method.residual)
    r = make_rows(spec)
    t = r.types
    VQ, VR = t.VQ, t.VR
    NR, Problem = s.nr, make_problem(s, dtype)
    noise = make_noise(spec)
    rem = make_solver(spec._replace(method=twin(method)))
    measure = make_measure(spec)
    gather = make_gather(spec)
    MR = make_erm(NR, dtype, method.residual).MR
    ZERO = dtype(0.0)
    index = tuple(row.index for row in s.rows)

    @wp.func
    def units(p: Problem, w0: VR, A: MR, level: VR, rem: VR):
        """By row what a vanishing gradient is relative to: the largest, of rows that move with it, of terms
        where v_free or the REM solution closes a row, and of what velocities change by in that solution. A
        wall far away, d/h of thousands, is no measure of a contact, nor are impulses against each other.
        """
        own = VR()
        w = w0 + A * rem
        for i in range(wp.static(NR)):
            own[i] = level[i] + wp.abs(w[i] - w0[i])
            if w0[i] < ZERO or p.scale[i] * rem[i] > w[i]:
                terms = level[i] + wp.abs(p.rate[i]) + wp.abs(w0[i])
                if wp.static(r.limit[i]):
                    terms += wp.abs(p.vfree[wp.static(index[i])])
                else:
                    terms += wp.dot(wp.abs(p.jac[i]), wp.abs(p.vfree))
                own[i] = wp.max(own[i], terms)
        out = VR()
        for i in range(wp.static(NR)):
            for j in range(wp.static(NR)):
                if A[i, j] != ZERO or i == j:
                    out[i] = wp.max(out[i], own[j])
        return out

    @wp.func
    def solve(world: t.World, p: Problem, warm: VR):
        v, z, lam, status, iterations = wp.static(rem)(world, p, warm)
        if status == wp.static(SOLVED):
            level = VR()
            known = measure(world, p)
            for i in range(wp.static(NR)):
                level[i] = wp.static(noise.level[i])(world, p.sigma)
            A = gather(p.minv, p.jac)
            unit = units(p, known.w0, A, level, lam)
            lam, w, status, count = wp.static(search)(A, known.w0, p.scale, level, lam, unit)
            iterations += count
            f = VQ()
            for i in range(wp.static(NR)):
                z[i] = p.scale[i] * lam[i] - w[i]
                f = wp.static(r.adds[i])(f, p.jac, lam[i])
            v = p.vfree + p.minv * f
        return v, z, lam, status, iterations

    return solve
