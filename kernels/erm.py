"""Expected residual minimisation (15): lambda minimises sum_i r(D_i lambda_i, w_i), w = w0 + A lambda.

With x = a - w, p = s'(x), q = 1 - p, k = s''(x) of the smoothing s of the REM twin, r(a, w) = E[min(a, w +
noise)^2] has r_a = 2 a q, r_w = 2 (a p - s(x)) and the second derivatives 2 (q - a k), 2 a k, 2 (p - a k). r
is not convex: Levenberg-Marquardt from the REM solution, never to a larger objective, with damped steps made
longer as long as that helps (the descent from a saddle starts slowly); a status says whether it ends where
the gradient vanishes. No row is far enough to be left out: where one row cannot close its residual, any row
that moves with it takes part of it, D_i 2 a_i = -(A r_w)_i, at any distance. Only where no row can act are
all impulses zero.
"""

import dataclasses
from types import SimpleNamespace

import warp as wp

from .factories import cached
from .method import Method
from .noise import make_noise
from .problem import make_problem
from .residuals import make_residuals
from .rows import make_rows
from .smoothing import make_smoothing
from .solve import NOT_CONVERGED, SOLVED, make_solver
from .structure import Structure

MAX_ITERATIONS = 200
TRIES = 6  # a damped step, of a region that is not convex, is lengthened as often as the value falls
PROXIMAL = {wp.float64: 1e-13, wp.float32: 1e-6}  # of the Hessian's diagonal, for rows that repeat others


@cached
def make_erm(n: int, dtype: type, residual: str) -> SimpleNamespace:
    """Warp functions for n rows: `terms`, `hessian`, `factor`, `substitute` and `minimise`."""
    VR, MR = wp.types.vector(n, dtype), wp.types.matrix((n, n), dtype)
    TERMS = wp.types.vector(5, dtype)
    sm = make_smoothing(dtype, residual)
    value = make_residuals(dtype).by_name[residual]
    ZERO, HALF, ONE, TWO, TEN = (dtype(x) for x in (0.0, 0.5, 1.0, 2.0, 10.0))
    GROW = dtype(4.0)
    TOL = dtype(1e-14 if dtype is wp.float64 else 1e-6)
    ACCEPT = dtype(1e-11 if dtype is wp.float64 else 2e-5)
    ROUND = dtype(1e-15 if dtype is wp.float64 else 3e-7)
    SMALLEST, LARGEST = dtype(1e-9 if dtype is wp.float64 else 1e-6), dtype(1e12)
    FIRST = dtype(1e-3)
    FLAT = dtype(1e-10 if dtype is wp.float64 else 1e-4)  # share of the value whose gain rounding may hide
    TAU = dtype(PROXIMAL[dtype])

    @wp.func
    def terms(a: dtype, w: dtype, sigma: dtype):
        """(r_a, r_w, r_aa, r_aw, r_ww)."""
        x = a - w
        e = wp.static(sm.smooth)(x, sigma, ONE / sigma)
        bend = a * wp.static(sm.bend)(x, ONE / sigma)
        by_w = a * e[2] - e[0]
        if x > ZERO:
            by_w = w - a * e[3] - e[1]
        return TERMS(TWO * a * e[3], TWO * by_w, TWO * (e[3] - bend), TWO * bend, TWO * (e[2] - bend))

    @wp.struct
    class Point:
        a: VR
        w: VR
        gradient: VR
        value: dtype
        worst: dtype  # largest component of the gradient, each over D_i + A_ii

    @wp.func
    def evaluate(A: MR, w0: VR, scale: VR, sigma: VR, lam: VR):
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
            out.worst = wp.max(out.worst, wp.abs(out.gradient[i]) / (scale[i] + A[i, i]))
        return out

    @wp.func
    def hessian(A: MR, scale: VR, sigma: VR, a: VR, w: VR):
        """D R_aa D + D R_aw A + A R_aw D + A R_ww A."""
        out = MR()
        for k in range(n):
            t = terms(a[k], w[k], sigma[k])
            out[k, k] = out[k, k] + scale[k] * scale[k] * t[2]
            for i in range(n):
                cross = A[i, k] * scale[k] * t[3]
                out[i, k] = out[i, k] + cross
                out[k, i] = out[k, i] + cross
                for j in range(n):
                    out[i, j] = out[i, j] + A[i, k] * A[k, j] * t[4]
        return out

    @wp.func
    def factor(h: MR, size: VR, damping: dtype):
        """Cholesky factor of h + damping diag(size), and whether it exists."""
        out = MR()
        ok = int(1)
        for j in range(n):
            pivot = h[j, j] + damping * size[j]
            for k in range(j):
                pivot -= out[j, k] * out[j, k]
            if not (pivot > ROUND * size[j]):
                ok = int(0)
                pivot = ONE
            root = wp.sqrt(pivot)
            out[j, j] = root
            for i in range(j + 1, n):
                total = h[i, j]
                for k in range(j):
                    total -= out[i, k] * out[j, k]
                out[i, j] = total / root
        return out, ok

    @wp.func
    def substitute(l: MR, rhs: VR):
        """x of L L' x = rhs."""
        x = rhs
        for i in range(n):
            for k in range(i):
                x[i] = x[i] - l[i, k] * x[k]
            x[i] = x[i] / l[i, i]
        for m in range(n):
            i = n - 1 - m
            for k in range(i + 1, n):
                x[i] = x[i] - l[k, i] * x[k]
            x[i] = x[i] / l[i, i]
        return x

    @wp.func
    def sizes(A: MR, scale: VR):
        # what the Hessian's diagonal is measured against
        out = VR()
        for i in range(n):
            out[i] = TWO * (scale[i] * scale[i] + A[i, i] * A[i, i])
        return out

    @wp.func
    def gain(at: Point, there: Point, step: VR):
        # values this close differ by rounding (tails cancel): the trapezoidal rule
        out = at.value - there.value
        if wp.abs(out) <= FLAT * at.value:
            out = -HALF * wp.dot(at.gradient + there.gradient, step)
        return out

    @wp.func
    def minimise(A: MR, w0: VR, scale: VR, sigma: VR, start: VR):
        """lambda, w and the status, from lambda = start."""
        lam = start
        size = sizes(A, scale)
        at = evaluate(A, w0, scale, sigma, lam)
        unit = ZERO
        for i in range(n):
            unit = wp.max(unit, sigma[i] + wp.abs(w0[i]) + wp.abs(at.a[i]))
        damping = dtype(0.0)
        it = int(0)
        status = int(wp.static(NOT_CONVERGED))
        while status == wp.static(NOT_CONVERGED) and it < wp.static(MAX_ITERATIONS):
            it += 1
            if at.worst <= TOL * unit:
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
                there = evaluate(A, w0, scale, sigma, lam + step)
                if wp.isfinite(there.worst) and gain(at, there, step) > ZERO:
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
                    it = wp.static(MAX_ITERATIONS)
        if status == wp.static(NOT_CONVERGED) and at.worst <= ACCEPT * unit:
            status = wp.static(SOLVED)
        return lam, at.w, status, it

    return SimpleNamespace(
        VR=VR, MR=MR, terms=terms, hessian=hessian, factor=factor, substitute=substitute, sizes=sizes,
        minimise=minimise,
    )  # fmt: skip


def twin(method: Method) -> Method:
    """The REM method of the same noise."""
    return dataclasses.replace(method, residual=method.residual.replace("erm", "rem"))


@cached
def make_erm_solver(s: Structure, dtype: type, method: Method) -> wp.Function:
    """As `make_solver`; z = D lambda - w. `mask` must hold every row."""
    erm = make_erm(s.nr, dtype, method.residual)
    r = make_rows(s, dtype, method)
    t = r.types
    VQ, VR = t.VQ, t.VR
    NR, Problem = s.nr, make_problem(s, dtype)
    noise = make_noise(s, dtype, method)
    rem = make_solver(s, dtype, twin(method))
    gather = make_gather(s, dtype, method)

    @wp.func
    def solve(params: wp.array2d(dtype=dtype), row: int, p: Problem, warm: VR):
        v, z, lam, status, iterations = wp.static(rem)(params, row, p, warm)
        if status == wp.static(SOLVED):
            level = VR()
            w0 = VR()
            for i in range(wp.static(NR)):
                level[i] = wp.static(noise.level[i])(params, row, p.sigma)
                w0[i] = wp.static(r.dots[i])(p.jac, p.vfree) + p.rate[i]
            lam, w, status, count = wp.static(erm.minimise)(gather(p.minv, p.jac), w0, p.scale, level, lam)
            iterations += count
            f = VQ()
            for i in range(wp.static(NR)):
                z[i] = p.scale[i] * lam[i] - w[i]
                f = wp.static(r.adds[i])(f, p.jac, lam[i])
            v = p.vfree + p.minv * f
        return v, z, lam, status, iterations

    return solve


@cached
def make_gather(s: Structure, dtype: type, method: Method) -> wp.Function:
    """gather(minv, jac) -> A = J M^-1 J' (2a)."""
    r = make_rows(s, dtype, method)
    t = r.types
    MR = make_erm(s.nr, dtype, method.residual).MR
    NR = s.nr

    @wp.func
    def gather(minv: t.MQ, jac: t.JR):
        out = MR()
        for i in range(wp.static(NR)):
            m = wp.static(r.applies[i])(minv, jac)
            for j in range(wp.static(NR)):
                if wp.static(j >= i):
                    out[wp.static(i), wp.static(j)] = wp.static(r.dots[j])(jac, m)
                    out[wp.static(j), wp.static(i)] = out[wp.static(i), wp.static(j)]
        return out

    return gather
