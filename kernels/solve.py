"""Newton's method for the smoothed complementarity problem in mixed form.

Unknowns z, one a row: D lambda = s(z), w = s(-z), and v' = v_free + M^-1 J' lambda exactly; what is left is
r(z) = J v' + d/h - s(-z) = 0. A Newton step solves [M, -J'; J, C](dv, dlambda) = (0, -r), C = D s'(-z)/s'(z), by
processing the rows one after the other like measurements of a Kalman filter: g = P J_i', T = D s'(-z) + s'(z) J_i g,
P -= (s'(z)/T) g g'. No division by C or by s'(z) occurs, so rows may be arbitrarily stiff or slack; rows that repeat
others only meet the floor on T. J is small (nv <= ~10), the rows that cannot act are masked.

For REM-logistic, eq. (17), the root is unique (DESIGN 3). `hard` solves (3) with the kink max(z, 0) by semismooth
Newton and falls back to a continuation in kappa (Chen & Mangasarian).
"""

import functools
from types import SimpleNamespace

import warp as wp

from .rows import make_rows
from .smoothing import make_smoothing
from .structure import Structure, layout

SOLVED, NOT_CONVERGED, INFEASIBLE, NONFINITE = 0, 1, 2, 3
COLD = 1.0e30  # a multiplier that stands for "no warm start"
MAX_ITERATIONS = 100
SEMISMOOTH_ITERATIONS = 8


@functools.cache
def make_sweep(s: Structure, dtype: type) -> SimpleNamespace:
    """Sequential elimination of the rows: `eliminate` (factor and forward), `back` (multipliers)."""
    r = make_rows(s, dtype, False)
    t = r.types
    VQ, MQ, VR, JR = t.VQ, t.MQ, t.VR, t.JR
    NR, NV = s.nr, s.nv
    ZERO = dtype(0.0)
    FLOOR = dtype(1e-13 if dtype is wp.float64 else 1e-6)

    @wp.struct
    class Factor:
        cov: MQ  # P after all rows: dv'/d(impulse)
        gain: JR  # g_i
        weight: VR  # 1/T_i

    @wp.func
    def factor(minv: MQ, jac: JR, scale: VR, diag: VR, slope: VR, slack: VR, mask: int):
        """Factor of the saddle matrix; slope = s'(z), slack = s'(-z), diag = diag(A)."""
        out = Factor()
        p = minv
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) != 0:
                g = wp.static(r.applies[i])(p, jac)
                total = scale[i] * slack[i] + slope[i] * wp.max(wp.static(r.dots[i])(jac, g), FLOOR * diag[i])
                inv = dtype(1.0) / total
                out.weight[i] = inv
                k = slope[i] * inv
                for a in range(wp.static(NV)):
                    out.gain[i, a] = g[a]
                    for b in range(wp.static(a + 1)):
                        p[a, b] = p[a, b] - k * g[a] * g[b]
                        if wp.static(a != b):
                            p[b, a] = p[a, b]
        out.cov = p
        return out

    @wp.func
    def forward(fac: Factor, jac: JR, slope: VR, mask: int, dv0: VQ, rhs: VR):
        """dv of [M, -J'; J, C](dv, dlambda) = (M dv0, rhs), and the innovations that `back` needs."""
        dv = dv0
        innovation = VR()
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) != 0:
                innovation[i] = rhs[i] - wp.static(r.dots[i])(jac, dv)
                k = slope[i] * fac.weight[i] * innovation[i]
                for a in range(wp.static(NV)):
                    dv[a] = dv[a] + k * fac.gain[i, a]
        return dv, innovation

    @wp.func
    def back(fac: Factor, jac: JR, scale: VR, slope: VR, mask: int, innovation: VR):
        """dz of the same system (dlambda = s'(z) dz / D)."""
        dz = VR()
        f = VQ()
        for j in range(wp.static(NR)):
            if (mask & wp.static(1 << (NR - 1 - j))) != 0:
                inner = innovation[wp.static(NR - 1 - j)]
                for a in range(wp.static(NV)):
                    inner -= fac.gain[wp.static(NR - 1 - j), a] * f[a]
                inner = inner * fac.weight[wp.static(NR - 1 - j)]
                dz[wp.static(NR - 1 - j)] = scale[wp.static(NR - 1 - j)] * inner
                f = wp.static(r.adds[NR - 1 - j])(f, jac, slope[wp.static(NR - 1 - j)] * inner)
        return dz

    return SimpleNamespace(Factor=Factor, factor=factor, forward=forward, back=back)


@functools.cache
def make_solver(s: Structure, dtype: type, hard: bool) -> wp.Function:
    """solve(params, row, minv, vfree, jac, rate, scale, mask, warm) -> (v', z, lambda, status)."""
    r = make_rows(s, dtype, False)
    t = r.types
    sm = make_smoothing(dtype)
    sweep = make_sweep(s, dtype)
    VQ, MQ, VR, JR = t.VQ, t.MQ, t.VR, t.JR
    NR = s.nr
    SIGMA = layout(s).offset("sigma")
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    UNUSED = dtype(COLD)
    HUGE = dtype(1e300 if dtype is wp.float64 else 1e38)
    TOL = dtype(2e-14 if dtype is wp.float64 else 1e-6)
    ACCEPT = dtype(3e-13 if dtype is wp.float64 else 1e-5)
    KAPPA_END = dtype(1e-11 if dtype is wp.float64 else 1e-5)
    DECREASE = dtype(1e-4)
    SHRINK = dtype(0.1)
    SHORTEST = dtype(1e-3)
    CERTIFICATE = dtype(1e-6)

    @wp.func
    def start(minv: MQ, jac: JR, scale: VR, diag: VR, w0: VR, mask: int, warm: VR):
        # z of the last step where the row acted, else the single-row hard solution
        z = VR()
        for i in range(wp.static(NR)):
            z[i] = UNUSED
            if (mask & wp.static(1 << i)) != 0:
                z[i] = -w0[i]
                if w0[i] < ZERO:
                    z[i] = -w0[i] * scale[i] / diag[i]
                if warm[i] < HALF * UNUSED:
                    z[i] = warm[i]
        return z

    @wp.func
    def failure(minv: MQ, jac: JR, diag: VR, rate: VR, lam: VR, f: VQ, mask: int):
        # Farkas: y >= 0, J'y = 0, y.d/h < 0 proves that no velocity opens the rows
        size = ZERO
        work = ZERO
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) != 0:
                size += lam[i] * lam[i] * diag[i]
                work += lam[i] * rate[i]
        if work < ZERO and wp.dot(f, minv * f) <= CERTIFICATE * size:
            return wp.static(INFEASIBLE)
        return wp.static(NOT_CONVERGED)

    @wp.func
    def solve(
        params: wp.array2d(dtype=dtype),
        row: int,
        minv: MQ,
        vfree: VQ,
        jac: JR,
        rate: VR,
        scale: VR,
        mask: int,
        warm: VR,
    ):
        diag = VR()
        w0 = VR()
        size = ZERO
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) != 0:
                diag[i] = wp.static(r.dots[i])(jac, wp.static(r.applies[i])(minv, jac))
                w0[i] = wp.static(r.dots[i])(jac, vfree) + rate[i]
                size = wp.max(size, wp.max(wp.abs(rate[i]), wp.abs(w0[i])))
                if wp.static(not hard):
                    size = wp.max(size, params[row, wp.static(SIGMA + i)])
        z = start(minv, jac, scale, diag, w0, mask, warm)
        best = z
        dz = VR()
        lam = VR()
        res = VR()
        slope = VR()
        slack = VR()
        v = vfree
        old = ZERO + HUGE
        length = dtype(1.0)
        kappa = dtype(0.0)
        it = int(0)
        last = int(0)
        status = int(wp.static(NOT_CONVERGED))
        while it < wp.static(MAX_ITERATIONS + 2):
            it += 1
            f = VQ()
            for i in range(wp.static(NR)):
                if (mask & wp.static(1 << i)) != 0:
                    if wp.static(hard):
                        e = wp.static(sm.chks)(z[i], kappa)
                    else:
                        e = wp.static(sm.logistic)(z[i], params[row, wp.static(SIGMA + i)])
                    lam[i] = e[0] / scale[i]
                    res[i] = rate[i] - e[1]
                    slope[i] = e[2]
                    slack[i] = e[3]
                    f = wp.static(r.adds[i])(f, jac, lam[i])
            v = vfree + minv * f
            merit = ZERO
            worst = ZERO
            for i in range(wp.static(NR)):
                if (mask & wp.static(1 << i)) != 0:
                    res[i] = res[i] + wp.static(r.dots[i])(jac, v)
                    merit += res[i] * res[i]
                    worst = wp.max(worst, wp.abs(res[i]))
            finite = wp.isfinite(merit)
            if not finite and it == 1:
                return v, z, lam, wp.static(NONFINITE)
            if finite and worst <= TOL * size and kappa == ZERO:
                status = wp.static(SOLVED)
                break
            if last == 1:
                if finite and worst <= ACCEPT * size and kappa == ZERO:
                    status = wp.static(SOLVED)
                else:
                    status = failure(minv, jac, diag, rate, lam, f, mask)
                break
            if wp.static(hard):
                if it == wp.static(SEMISMOOTH_ITERATIONS):  # not finished at the kink: start the continuation
                    kappa = size
                    z = start(minv, jac, scale, diag, w0, mask, VR(UNUSED))
                    best = z
                    old = HUGE
                    length = dtype(1.0)
                    continue
                if kappa > ZERO and finite and worst <= kappa:
                    kappa = wp.where(kappa > KAPPA_END * size, SHRINK * kappa, ZERO)
                    old = HUGE
                    length = dtype(1.0)
                    best = z
                    continue
            if finite and merit <= old * (ONE - DECREASE * length):
                best = z
                old = merit
                length = ONE
                fac = wp.static(sweep.factor)(minv, jac, scale, diag, slope, slack, mask)
                _dv, innovation = wp.static(sweep.forward)(fac, jac, slope, mask, VQ(), -res)
                dz = wp.static(sweep.back)(fac, jac, scale, slope, mask, innovation)
            else:
                length = HALF * length
            if length < SHORTEST or it >= wp.static(MAX_ITERATIONS):
                last = 1
                z = best
                kappa = ZERO
            else:
                z = best + length * dz
        return v, z, lam, status

    return solve
