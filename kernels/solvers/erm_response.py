"""First derivatives of a step with ERM, dlambda = -H^-1 dG at the minimum of the objective (`erm.py`).

G = D r_a + J p = 0, where M p = J' y and y = r_w. At fixed lambda a change of state moves v' by dv0 and w by
dw = J dv0 + dJ v' + d(d/h), and with it
dG = dD (r_a + D r_aa lambda) + D r_aw dw + dJ p + J M^-1 (dJ' y - dM p + J' (r_aw lambda dD + r_ww dw)).
"""

from types import SimpleNamespace

import warp as wp

from ..contact.rows import make_rows
from ..factories import cached
from ..residual.noise import make_noise
from ..specialisation import Specialisation
from .erm import PROXIMAL, make_erm, make_gather


@cached
def make_erm_response(spec: Specialisation) -> SimpleNamespace:
    """prepare(params, row, minv, jac, scale, sigma, lam, z) -> Factor, with y and p; complete(Factor, minv,
    jac, lam, force, motion, scale_by_q) adds what depends on q; solve(Factor, minv, jac, dv0, f2, c) -> dv'.
    """
    s, dtype, method = spec
    erm = make_erm(s.nr, dtype, method.residual)
    gather = make_gather(spec)
    r = make_rows(spec)
    t = r.types
    VQ, VR, MQ, JR, MR = t.VQ, t.VR, t.MQ, t.JR, erm.MR
    noise = make_noise(spec)
    NR, NV = s.nr, s.nv
    TAU = dtype(PROXIMAL[dtype])

    @wp.struct
    class Factor:
        root: MR  # Cholesky factor of H
        scale: VR
        r_a: VR
        r_w: VR  # y
        r_aa: VR
        r_aw: VR
        r_ww: VR
        p: VQ
        by_q: JR  # dG/dq at fixed lambda and v'

    @wp.func
    def prepare(
        params: wp.array2d(dtype=dtype), row: int, minv: MQ, jac: JR, scale: VR, sigma: VR, lam: VR, z: VR
    ):
        out = Factor()
        out.scale = scale
        level = VR()
        a = VR()
        w = VR()
        f = VQ()
        for i in range(wp.static(NR)):
            level[i] = wp.static(noise.level[i])(params, row, sigma)
            a[i] = scale[i] * lam[i]
            w[i] = a[i] - z[i]
            e = wp.static(erm.terms)(a[i], w[i], level[i])
            out.r_a[i] = e[0]
            out.r_w[i] = e[1]
            out.r_aa[i] = e[2]
            out.r_aw[i] = e[3]
            out.r_ww[i] = e[4]
            f = wp.static(r.adds[i])(f, jac, e[1])
        out.p = minv * f
        A = gather(minv, jac)
        h = wp.static(erm.hessian)(A, scale, level, a, w)
        root, _ok = wp.static(erm.factor)(h, wp.static(erm.sizes)(A, scale), TAU)
        out.root = root
        return out

    @wp.func
    def complete(fac: Factor, minv: MQ, jac: JR, lam: VR, force: MQ, motion: JR, scale_by_q: JR):
        # force (j, k): d/dq_k of J' y - M p; motion (i, k): d/dq_k of J_i p
        out = fac
        for k in range(wp.static(NV)):
            f = VQ()
            for j in range(wp.static(NV)):
                f[j] = force[j, k]
            for i in range(wp.static(NR)):
                f = wp.static(r.adds[i])(f, jac, fac.r_aw[i] * lam[i] * scale_by_q[i, k])
            dp = minv * f
            for i in range(wp.static(NR)):
                value = motion[i, k] + wp.static(r.dots[i])(jac, dp)
                value += scale_by_q[i, k] * (fac.r_a[i] + fac.scale[i] * fac.r_aa[i] * lam[i])
                out.by_q[i, k] = value
        return out

    @wp.func
    def solve(fac: Factor, minv: MQ, jac: JR, dv0: VQ, f2: VR, c: int):
        """dv' of column c, from dv0 and -f2 = dJ v' + d(d/h)."""
        rhs = VR()
        f = VQ()
        for i in range(wp.static(NR)):
            dw = wp.static(r.dots[i])(jac, dv0) - f2[i]
            rhs[i] = fac.scale[i] * fac.r_aw[i] * dw
            f = wp.static(r.adds[i])(f, jac, fac.r_ww[i] * dw)
        dp = minv * f
        for i in range(wp.static(NR)):
            rhs[i] = rhs[i] + wp.static(r.dots[i])(jac, dp)
            if c < wp.static(NV):
                rhs[i] = rhs[i] + fac.by_q[i, c]
        dlam = -wp.static(erm.substitute)(fac.root, rhs)
        f = VQ()
        for i in range(wp.static(NR)):
            f = wp.static(r.adds[i])(f, jac, dlam[i])
        return dv0 + minv * f

    return SimpleNamespace(Factor=Factor, prepare=prepare, complete=complete, solve=solve)
