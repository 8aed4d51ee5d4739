"""Expected residual minimisation (15), (M10): lambda minimises sum_i r(D_i lambda_i, w_i), w = w0 + A lambda.

With x = a - w, p = s'(x), q = 1 - p, k = s''(x) of the smoothing s of the REM twin, r(a, w) = E[min(a, w +
noise)^2] has r_a = 2 a q, r_w = 2 (a p - s(x)) and the second derivatives 2 (q - a k), 2 a k, 2 (p - a k). r
is not convex (erm_descent.py). No row is far enough to be left out: where one row cannot close its residual,
any row that moves with it takes part of it, D_i 2 a_i = -(A r_w)_i, at any distance. Only where no row can
act are all impulses zero.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.rows import make_rows
from ..factories import cached
from ..residual.smoothing import make_smoothing
from ..specialisation import Specialisation

PROXIMAL = {wp.float64: 1e-13, wp.float32: 1e-6}  # of the Hessian's diagonal, for rows that repeat others


@cached
def make_erm(n: int, dtype: type, residual: str) -> SimpleNamespace:
    """Warp functions for n rows: `terms`, `hessian`, `factor`, `substitute` and `sizes`."""
    VR, MR = wp.types.vector(n, dtype), wp.types.matrix((n, n), dtype)
    TERMS = wp.types.vector(5, dtype)
    sm = make_smoothing(dtype, residual)
    ZERO, ONE, TWO = dtype(0.0), dtype(1.0), dtype(2.0)
    ROUND = dtype(1e-15 if dtype is wp.float64 else 3e-7)

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

    @wp.func
    def assemble(A: MR, scale: VR, raa: VR, raw: VR, rww: VR):
        """D R_aa D + D R_aw A + A R_aw D + A R_ww A."""
        out = MR()
        for k in range(n):
            out[k, k] = out[k, k] + scale[k] * scale[k] * raa[k]
            for i in range(n):
                cross = A[i, k] * scale[k] * raw[k]
                out[i, k] = out[i, k] + cross
                out[k, i] = out[k, i] + cross
                for j in range(n):
                    out[i, j] = out[i, j] + A[i, k] * A[k, j] * rww[k]
        return out

    @wp.func
    def hessian(A: MR, scale: VR, sigma: VR, a: VR, w: VR):
        raa = VR()
        raw = VR()
        rww = VR()
        for k in range(n):
            t = terms(a[k], w[k], sigma[k])
            raa[k] = t[2]
            raw[k] = t[3]
            rww[k] = t[4]
        return assemble(A, scale, raa, raw, rww)

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

    return SimpleNamespace(
        VR=VR, MR=MR, terms=terms, assemble=assemble, hessian=hessian, factor=factor, substitute=substitute,
        sizes=sizes,
    )  # fmt: skip


@cached
def make_gather(spec: Specialisation) -> wp.Function:
    """gather(minv, jac) -> A = J M^-1 J' (2a)."""
    s, dtype, method = spec
    r = make_rows(spec)
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
