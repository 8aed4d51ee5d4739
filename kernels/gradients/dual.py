"""Weights of the equations of a contact problem's solution whose changes sum up to that of target.v'.

With F1 = M w - J' lambda, w = v' - v_free, and w_i = J_i v' + d_i/h of every row:

    target.dv' = P.dF1 + sum_i rho_i dw_i + bend_i.dJ_i + kappa_i dD_i + sigma_i dlog(sigma_i) + L.dM R.

Roots: rho weighs F2 = w - s(-z), and D lambda = s(z) is put into F1. ERM (`erm_response.py`): G = D r_a + J p
= 0 and M p = J' r_w have weights nu and Q, H nu = J M^-1 target, Q = -M^-1 J' nu; L = Q, R = p. As r is of
the second degree in (a, w, sigma) together, sigma r_(a sigma) = r_a - a r_aa - w r_aw, and so for r_w.
"""

from types import SimpleNamespace

import warp as wp

from ..derivatives.sensitivity import make_linearization
from ..factories import cached
from ..solvers.erm import make_erm
from ..specialisation import Specialisation


@cached
def make_dual(spec: Specialisation) -> SimpleNamespace:
    """dual(sol, lin, target) -> Dual, at the factors in `lin`."""
    s, dtype, method = spec
    linear = make_linearization(spec)
    step = linear.step
    rows, t = step.rows, step.types
    VQ, VR, JR = t.VQ, t.VR, t.JR
    NR = s.nr
    coulomb, erm = method.coulomb and NR > 0, method.erm and NR > 0
    substitute = make_erm(NR, dtype, method.residual).substitute if erm else None

    @wp.struct
    class Dual:
        p: VQ  # P
        rho: VR
        slides: VR  # lambda_t/(mu lambda_n) of sliding contacts (Coulomb's friction), in the friction row
        kappa: VR  # zero without inertia scaling
        sigma: VR  # zero if hard
        bend: JR  # zero but for ERM
        left: VQ  # zero but for ERM
        right: VQ

    @wp.func
    def expected(sol: step.Solution, lin: linear.Linear, p0: VQ):
        # M p0 = -target
        out = Dual()
        rhs = VR()
        for i in range(wp.static(NR)):
            rhs[i] = wp.static(rows.dots[i])(sol.jac, p0)
        nu = wp.static(substitute)(lin.factor.root, rhs)
        f = VQ()
        for i in range(wp.static(NR)):
            f = wp.static(rows.adds[i])(f, sol.jac, nu[i])
        out.left = -(sol.minv * f)
        out.right = lin.factor.p
        f = VQ()
        for i in range(wp.static(NR)):
            scale = sol.scale[i]
            a = scale * sol.lam[i]
            w = a - sol.z[i]
            moved = -wp.static(rows.dots[i])(sol.jac, out.left)  # (A nu)_i
            r_a = lin.factor.r_a[i]
            r_w = lin.factor.r_w[i]
            r_aa = lin.factor.r_aa[i]
            r_aw = lin.factor.r_aw[i]
            r_ww = lin.factor.r_ww[i]
            out.rho[i] = moved * r_ww + scale * r_aw * nu[i]
            if wp.static(method.scaled):
                out.kappa[i] = moved * r_aw * sol.lam[i] + nu[i] * (r_a + a * r_aa)
            out.sigma[i] = moved * (r_w - a * r_aw - w * r_ww) + nu[i] * scale * (r_a - a * r_aa - w * r_aw)
            for j in range(wp.static(s.nv)):
                out.bend[i, j] = nu[i] * out.right[j] - r_w * out.left[j]
            f = wp.static(rows.adds[i])(f, sol.jac, out.rho[i])
        out.p = p0 - sol.minv * f
        return out

    @wp.func
    def dual(sol: step.Solution, lin: linear.Linear, target: VQ):
        out = Dual()
        if wp.static(erm):
            out.p = -(sol.minv * target)
            if sol.mask != 0:
                out = expected(sol, lin, out.p)
        elif wp.static(coulomb):
            out.p = -(sol.minv * target)
            if sol.mask != 0:
                p, rho, slides = linear.response.transposed(lin.factor, sol.jac, out.p)
                out.p = p
                out.rho = rho
                out.slides = slides
        else:
            p, rho = wp.static(linear.transposed)(sol, lin, target)
            out.p = -p
            for i in range(wp.static(NR)):
                if (sol.mask & wp.static(1 << i)) != 0:
                    out.rho[i] = -rho[i]
                    push = wp.static(rows.dots[i])(sol.jac, out.p)
                    if wp.static(method.scaled):
                        out.kappa[i] = push * sol.lam[i] / sol.scale[i]
                    if wp.static(not method.hard):
                        # s = D lambda, and sigma ds/dsigma = s - z s', the same at z and at -z
                        rise = sol.lam[i] * sol.scale[i] - sol.z[i] * lin.slope[i]
                        out.sigma[i] = -rise * (push / sol.scale[i] + out.rho[i])
        return out

    return SimpleNamespace(Dual=Dual, dual=dual, linear=linear)
