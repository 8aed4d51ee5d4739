"""Sequential elimination of the rows of the saddle matrix of a Newton step.

[M, -J'; J, C](dv, dlambda) = (f, r), C = D s'(-z)/s'(z), is solved by processing the rows one after the
other, like measurements of a Kalman filter (M20): g = P J_i', T = D s'(-z) + s'(z) J_i g, P -= (s'(z)/T) g
g'. No division by C or by s'(z) occurs, so rows may be arbitrarily stiff or slack. Rows that repeat others
are met by a proximal term, C + tau diag(A), of the size of rounding. Rows that cannot act are masked.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.rows import make_rows
from ..factories import cached
from ..specialisation import Specialisation

PROXIMAL = {wp.float64: 1e-13, wp.float32: 1e-6}  # tau


@cached
def make_row_elimination(spec: Specialisation) -> SimpleNamespace:
    """Sequential elimination of the rows: `eliminate` (factor and forward), `back` (multipliers)."""
    s, dtype, _ = spec
    r = make_rows(spec)
    t = r.types
    VQ, MQ, VR, JR = t.VQ, t.MQ, t.VR, t.JR
    NR = s.nr
    ZERO = dtype(0.0)

    @wp.struct
    class Factor:
        cov: MQ  # P after all rows: dv'/d(impulse)
        gain: JR  # g_i
        weight: VR  # 1/T_i

    @wp.func
    def factor(minv: MQ, jac: JR, scale: VR, diag: VR, slope: VR, slack: VR, mask: int, tau: dtype):
        """Factor of the saddle matrix with C + tau diag(A); slope = s'(z), slack = s'(-z), diag = diag(A)."""
        out = Factor()
        p = minv
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) != 0:
                g = wp.static(r.applies[i])(p, jac)
                stiffness = wp.max(wp.static(r.dots[i])(jac, g), ZERO) + tau * diag[i]
                total = scale[i] * slack[i] + slope[i] * stiffness
                inv = dtype(1.0) / total
                out.weight[i] = inv
                k = slope[i] * inv
                out.gain[i] = g
                p -= k * wp.outer(g, g)
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
                dv += k * fac.gain[i]
        return dv, innovation

    @wp.func
    def back(fac: Factor, jac: JR, scale: VR, slope: VR, mask: int, innovation: VR):
        """dz of the same system (dlambda = s'(z) dz / D)."""
        dz = VR()
        f = VQ()
        for j in range(wp.static(NR)):
            if (mask & wp.static(1 << (NR - 1 - j))) != 0:
                inner = innovation[wp.static(NR - 1 - j)] - wp.dot(fac.gain[wp.static(NR - 1 - j)], f)
                inner = inner * fac.weight[wp.static(NR - 1 - j)]
                dz[wp.static(NR - 1 - j)] = scale[wp.static(NR - 1 - j)] * inner
                f = wp.static(r.adds[NR - 1 - j])(f, jac, slope[wp.static(NR - 1 - j)] * inner)
        return dz

    return SimpleNamespace(Factor=Factor, factor=factor, forward=forward, back=back)
