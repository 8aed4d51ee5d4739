"""Newton's method for the smoothed complementarity problem in mixed form.

Unknowns z, one a row: D lambda = s(z), w = s(-z), and v' = v_free + M^-1 J' lambda exactly; what is left is
r(z) = J v' + d/h - s(-z) = 0. A Newton step solves [M, -J'; J, C](dv, dlambda) = (0, -r), C = D
s'(-z)/s'(z), shortened until sum r_i^2/A_ii falls (newton.py). Where it does not, or the
semismooth Newton of the `hard` problem (3) cycles, an interior-point method (interior.py) finds a better z
to go on from, or a proof that no velocity opens the rows. For REM-logistic, eq. (17), the root is unique
(DESIGN 3).
"""

import functools

import warp as wp

from .few_rows import make_few_rows
from .interior import make_interior
from .method import Method
from .newton import INFEASIBLE, NOT_CONVERGED, make_newton
from .newton import JAMMED as JAMMED
from .newton import NONFINITE as NONFINITE
from .newton import SOLVED as SOLVED
from .noise import make_noise
from .rows import make_rows
from .structure import Structure

COLD = 1.0e30  # a multiplier that stands for "no warm start"


@functools.cache
def make_solver(s: Structure, dtype: type, method: Method) -> wp.Function:
    """solve(params, row, minv, vfree, jac, rate, scale, sigma, mask, warm) -> v', z, lambda, status, it."""
    r = make_rows(s, dtype, method)
    t = r.types
    interior = make_interior(s, dtype, method)
    n = make_newton(s, dtype, method)
    solve_few = make_few_rows(s, dtype, method)
    VQ, MQ, VR, JR = t.VQ, t.MQ, t.VR, t.JR
    NR = s.nr
    noise = make_noise(s, dtype, method)
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    UNUSED = dtype(COLD)
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
        v, z_few, lam_few, status, iterations = solve_few(
            params, row, minv, vfree, jac, scale, sigma, inverse_sigma, w0, mask, size, z
        )
        if status == wp.static(SOLVED):
            return v, z_few, lam_few, status, iterations
        at = n.Point()
        attempt = int(0)
        while status == wp.static(NOT_CONVERGED) and attempt < 2:
            if attempt == 1:
                z = start(minv, jac, scale, diag, w0, mask, VR(UNUSED))
                z, lam, found, count = interior(
                    params, row, minv, vfree, jac, rate, scale, sigma, diag, mask, size, z
                )
                iterations += count
                if found == 0 and proves_infeasible(minv, jac, diag, w0, lam, mask):
                    status = wp.static(INFEASIBLE)
            if status == wp.static(NOT_CONVERGED):
                at, z, status, count = wp.static(n.newton)(
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
                iterations += count
            attempt += 1
        return at.v, z, at.lam, status, iterations

    return solve
