"""Newton's method for the smoothed complementarity problem in mixed form.

Unknowns z, one a row: D lambda = s(z), w = s(-z), and v' = v_free + M^-1 J' lambda exactly; what is left is
r(z) = J v' + d/h - s(-z) = 0. A Newton step solves [M, -J'; J, C](dv, dlambda) = (0, -r), C = D
s'(-z)/s'(z) (elimination.py) and is shortened until sum r_i^2/A_ii falls. Where it does not, or the
semismooth Newton of the `hard` problem (3) cycles, an interior-point method (interior.py) finds a better z
to go on from, or a proof that no velocity opens the rows. For REM-logistic, eq. (17), the root is unique
(DESIGN 3).
"""

import functools

import warp as wp

from .elimination import PROXIMAL
from .interior import make_interior
from .method import Method
from .noise import make_noise
from .rows import make_rows
from .smoothing import make_smoothing
from .structure import Structure

SOLVED, NOT_CONVERGED, INFEASIBLE, NONFINITE, JAMMED = 0, 1, 2, 3, 4
COLD = 1.0e30  # a multiplier that stands for "no warm start"
ITERATIONS = {False: 20, True: 8}  # of Newton's method for the smoothed and the hard problem


@functools.cache
def make_solver(s: Structure, dtype: type, method: Method) -> wp.Function:
    """solve(params, row, minv, vfree, jac, rate, scale, sigma, mask, warm) -> (v', z, lambda, status)."""
    r = make_rows(s, dtype, method)
    t = r.types
    sm = make_smoothing(dtype, method.residual)
    interior = make_interior(s, dtype, method)
    VQ, MQ, VR, JR = t.VQ, t.MQ, t.VR, t.JR
    NR = s.nr
    noise = make_noise(s, dtype, method)
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    BEND = dtype(0.5 * sm.steepest)
    UNUSED = dtype(COLD)
    HUGE = dtype(1e300 if dtype is wp.float64 else 1e38)
    TOL = dtype(2e-14 if dtype is wp.float64 else 1e-6)
    ACCEPT, LARGEST = (dtype(x) for x in ((3e-13, 1e-10) if dtype is wp.float64 else (1e-5, 1e-5)))
    ROUNDING = dtype(1e-15)  # of the impulses' own velocities, which cancel between heavy and light bodies
    DECREASE = dtype(1e-4)
    SHORTEST = dtype(0.05)
    TAU = dtype(PROXIMAL[dtype])
    SMALLEST = dtype(1e-30)
    CERTIFICATE = dtype(1e-18 if dtype is wp.float64 else 1e-11)  # a square: tells 1:1e6 in mass from zero
    limit, index = r.limit, tuple(row.index for row in s.rows)

    def make_couple(first: int) -> wp.Function:
        @wp.func
        def couple(minv: MQ, jac: JR, scale: VR, diag: VR, w0: VR, z: VR):
            """z of the hard two-row problem of one frictional contact, alone."""
            out = z
            c = wp.static(r.dots[first + 1])(jac, wp.static(r.applies[first])(minv, jac))
            w1 = w0[wp.static(first)]
            w2 = w0[wp.static(first + 1)]
            a1 = diag[wp.static(first)]
            a2 = diag[wp.static(first + 1)]
            det = a1 * a2 - c * c
            l1 = (c * w2 - a2 * w1) / det
            l2 = (c * w1 - a1 * w2) / det
            if not (l1 > ZERO and l2 > ZERO):
                l1 = wp.max(-w1 / a1, ZERO)
                l2 = ZERO
                if w2 + c * l1 < ZERO:
                    l1 = ZERO
                    l2 = wp.max(-w2 / a2, ZERO)
            out[wp.static(first)] = scale[wp.static(first)] * l1 - wp.max(w1 + a1 * l1 + c * l2, ZERO)
            out[wp.static(first + 1)] = scale[wp.static(first + 1)] * l2 - wp.max(w2 + c * l1 + a2 * l2, ZERO)
            return out

        return couple

    frictional = tuple(row.kind == "contact" and row.sign > 0 for row in s.rows)
    couples = tuple(make_couple(i) if frictional[i] else None for i in range(NR))

    @wp.func
    def start(minv: MQ, jac: JR, scale: VR, diag: VR, w0: VR, mask: int, warm: VR):
        # the hard solution of every limit and contact alone; after an impact better than the last step's
        z = VR()
        for i in range(wp.static(NR)):
            z[i] = UNUSED
            if (mask & wp.static(1 << i)) != 0:
                z[i] = -w0[i]
                if w0[i] < ZERO:
                    z[i] = -w0[i] * scale[i] / diag[i]
        for i in range(wp.static(NR)):
            if wp.static(frictional[i]):
                if (mask & wp.static(3 << i)) == wp.static(3 << i):
                    z = wp.static(couples[i])(minv, jac, scale, diag, w0, z)
        # of several contacts together the last step knows more; if it misleads, the second attempt is cold
        if wp.static(len(s.pairs) > 1):
            for i in range(wp.static(NR)):
                if (mask & wp.static(1 << i)) != 0 and wp.abs(warm[i]) < HALF * UNUSED:
                    z[i] = warm[i]
        return z

    @wp.func
    def magnitude(
        params: wp.array2d(dtype=dtype),
        row: int,
        jac: JR,
        vfree: VQ,
        rate: VR,
        sigma: VR,
        w0: VR,
        mask: int,
    ):
        # size of the terms of the residual: what its rounding is relative to
        size = ZERO
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) != 0:
                terms = wp.abs(rate[i]) + wp.abs(w0[i])
                if wp.static(limit[i]):
                    terms += wp.abs(vfree[wp.static(index[i])])
                else:
                    for j in range(wp.static(s.nv)):
                        terms += wp.abs(jac[i, j] * vfree[j])
                if wp.static(not method.hard):
                    terms += wp.static(noise.level[i])(params, row, sigma)
                size = wp.max(size, terms)
        return size

    @wp.struct
    class Point:
        v: VQ
        lam: VR
        res: VR  # r(z)
        slope: VR  # s'(z)
        slack: VR  # s'(-z)
        merit: dtype  # sum r_i^2 / A_ii
        worst: dtype  # max |r_i|

    @wp.func
    def evaluate(
        params: wp.array2d(dtype=dtype),
        row: int,
        minv: MQ,
        vfree: VQ,
        jac: JR,
        rate: VR,
        scale: VR,
        sigma: VR,
        inverse_diag: VR,
        inverse_sigma: VR,
        mask: int,
        z: VR,
    ):
        out = Point()
        f = VQ()
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) != 0:
                if wp.static(method.hard):
                    e = wp.static(sm.kink)(z[i])
                else:
                    level = wp.static(noise.level[i])(params, row, sigma)
                    e = wp.static(sm.smooth)(z[i], level, inverse_sigma[i])
                out.lam[i] = e[0]
                if wp.static(method.inertia_scaling):
                    out.lam[i] = e[0] / scale[i]
                out.res[i] = rate[i] - e[1]
                out.slope[i] = e[2]
                out.slack[i] = e[3]
                f = wp.static(r.adds[i])(f, jac, out.lam[i])
        out.v = vfree + minv * f
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) != 0:
                out.res[i] = out.res[i] + wp.static(r.dots[i])(jac, out.v)
                out.merit += out.res[i] * out.res[i] * inverse_diag[i]
                out.worst = wp.max(out.worst, wp.abs(out.res[i]))
        return out

    @wp.func
    def proves_infeasible(minv: MQ, jac: JR, diag: VR, w0: VR, y: VR, mask: int):
        # Farkas: y >= 0, J'y = 0, y.w0 = y.d/h < 0 proves that no velocity opens the rows
        f = VQ()
        size = ZERO
        work = ZERO
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) != 0:
                size += y[i] * y[i] * diag[i]
                work += y[i] * w0[i]
                f = wp.static(r.adds[i])(f, jac, y[i])
        return work < ZERO and wp.dot(f, minv * f) <= CERTIFICATE * size

    @wp.func
    def direction(minv: MQ, jac: JR, scale: VR, diag: VR, at: Point, mask: int):
        # `factor`, `forward` and `back` of the sweep in one go, without what only derivatives need
        p = minv
        dv = VQ()
        gain = JR()
        innovation = VR()  # divided by T
        weight = VR()  # 1/T
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) != 0:
                g = wp.static(r.applies[i])(p, jac)
                stiffness = wp.max(wp.static(r.dots[i])(jac, g), ZERO) + TAU * diag[i]
                slack = at.slack[i]
                if wp.static(method.inertia_scaling):
                    slack = slack * scale[i]
                inverse = ONE / (slack + at.slope[i] * stiffness)
                innovation[i] = -inverse * (at.res[i] + wp.static(r.dots[i])(jac, dv))
                weight[i] = inverse
                k = at.slope[i] * inverse
                gain[i] = g
                dv += (at.slope[i] * innovation[i]) * g
                p -= k * wp.outer(g, g)
        dz = VR()
        f = VQ()
        for j in range(wp.static(NR)):
            if (mask & wp.static(1 << (NR - 1 - j))) != 0:
                inner = wp.dot(gain[wp.static(NR - 1 - j)], f)
                step = innovation[wp.static(NR - 1 - j)] - weight[wp.static(NR - 1 - j)] * inner
                f = wp.static(r.adds[NR - 1 - j])(f, jac, at.slope[wp.static(NR - 1 - j)] * step)
                if wp.static(method.inertia_scaling):
                    step = step * scale[wp.static(NR - 1 - j)]
                dz[wp.static(NR - 1 - j)] = step
        return dz

    @wp.func
    def remainder(scale: VR, diag: VR, inverse_sigma: VR, dz: VR, mask: int):
        # bound on |r| after a full Newton step: s is quadratic up to s'' dz^2/2, s'' <= steepest/sigma
        bend = ZERO
        largest = ZERO
        smallest = ZERO + HUGE
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) != 0:
                bend += BEND * inverse_sigma[i] * dz[i] * dz[i]
                largest = wp.max(largest, diag[i])
                smallest = wp.min(smallest, scale[i])
        return bend * (ONE + largest / smallest)

    @wp.func
    def follow(minv: MQ, vfree: VQ, jac: JR, scale: VR, at: Point, dz: VR, mask: int):
        # the end of a Newton step that needs no other: lambda and v' to first order in dz
        out = at
        f = VQ()
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) != 0:
                change = at.slope[i] * dz[i]
                if wp.static(method.inertia_scaling):
                    change = change / scale[i]
                out.lam[i] = at.lam[i] + change
                f = wp.static(r.adds[i])(f, jac, out.lam[i])
        out.v = vfree + minv * f
        return out

    @wp.func
    def newton(
        params: wp.array2d(dtype=dtype),
        row: int,
        minv: MQ,
        vfree: VQ,
        jac: JR,
        rate: VR,
        scale: VR,
        sigma: VR,
        diag: VR,
        inverse_diag: VR,
        inverse_sigma: VR,
        mask: int,
        size: dtype,
        z0: VR,
    ):
        # from z0; NOT_CONVERGED where no step length helps or the iterations do not suffice
        z = z0
        best = z0
        dz = VR()
        old = ZERO + HUGE
        best_worst = ZERO + HUGE
        length = dtype(1.0)
        tolerance = TOL * size
        it = int(0)
        last = int(0)
        status = int(wp.static(NOT_CONVERGED))
        at = Point()
        while status == wp.static(NOT_CONVERGED):
            it += 1
            at = evaluate(
                params, row, minv, vfree, jac, rate, scale, sigma, inverse_diag, inverse_sigma, mask, z
            )
            finite = wp.isfinite(at.merit)
            if not finite and it == 1:
                status = wp.static(NONFINITE)
                break
            if finite and at.worst <= tolerance:
                status = wp.static(SOLVED)
                break
            if last == 1:
                break
            if finite and at.merit <= old * (ONE - DECREASE * length):
                best = z
                best_worst = at.worst
                old = at.merit
                length = dtype(1.0)
                dz = direction(minv, jac, scale, diag, at, mask)
                z = best + dz
                if wp.static(not method.hard):
                    if remainder(scale, diag, inverse_sigma, dz, mask) <= TOL * size:
                        at = follow(minv, vfree, jac, scale, at, dz, mask)
                        status = wp.static(SOLVED)
            else:
                length = HALF * length
                z = best + length * dz
            if length < SHORTEST or it >= wp.static(ITERATIONS[method.hard]):
                # rounding may be all that is left: the best point then counts with a wider tolerance
                tolerance = ACCEPT * size
                for i in range(wp.static(NR)):
                    if (mask & wp.static(1 << i)) != 0:
                        tolerance = wp.max(tolerance, ROUNDING * best[i] * diag[i] / scale[i])
                tolerance = wp.min(tolerance, LARGEST * size)
                if best_worst > tolerance:
                    break
                z = best
                last = 1
        return at, z, status

    @wp.func
    def solve(
        params: wp.array2d(dtype=dtype),
        row: int,
        minv: MQ,
        vfree: VQ,
        jac: JR,
        rate: VR,
        scale: VR,
        sigma: VR,
        mask: int,
        warm: VR,
    ):
        diag = VR()
        inverse_diag = VR()
        inverse_sigma = VR()
        w0 = VR()
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) != 0:
                if wp.static(not method.hard):
                    inverse_sigma[i] = ONE / wp.static(noise.level[i])(params, row, sigma)
                diag[i] = wp.max(wp.static(r.dots[i])(jac, wp.static(r.applies[i])(minv, jac)), SMALLEST)
                inverse_diag[i] = ONE / diag[i]
                w0[i] = wp.static(r.dots[i])(jac, vfree) + rate[i]
        size = magnitude(params, row, jac, vfree, rate, sigma, w0, mask)
        z = start(minv, jac, scale, diag, w0, mask, warm)
        at = Point()
        status = int(wp.static(NOT_CONVERGED))
        attempt = int(0)
        while status == wp.static(NOT_CONVERGED) and attempt < 2:
            if attempt == 1:
                z = start(minv, jac, scale, diag, w0, mask, VR(UNUSED))
                z, lam, found = interior(
                    params, row, minv, vfree, jac, rate, scale, sigma, diag, mask, size, z
                )
                if found == 0 and proves_infeasible(minv, jac, diag, w0, lam, mask):
                    status = wp.static(INFEASIBLE)
            if status == wp.static(NOT_CONVERGED):
                at, z, status = newton(
                    params,
                    row,
                    minv,
                    vfree,
                    jac,
                    rate,
                    scale,
                    sigma,
                    diag,
                    inverse_diag,
                    inverse_sigma,
                    mask,
                    size,
                    z,
                )
            attempt += 1
        return at.v, z, at.lam, status

    return solve
