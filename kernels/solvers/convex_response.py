"""How the solution of the convex law, r(z) = J v' + d/h - s(-z) = 0 with D lambda = s(z), changes.

The implicit function theorem with the factor that Newton uses: (dv', dz) solves
[M, -J' s'(z)/D; J, s'(-z)] (dv', dz) = -(F1, F2). No iteration is differentiated.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.problem import make_problem
from ..contact.rows import make_rows
from ..factories import cached
from ..residual.noise import make_noise
from ..residual.smoothing import make_smoothing
from ..specialisation import Specialisation
from .dual import make_dual
from .elimination import PROXIMAL, make_row_elimination


@cached
def make_convex_response(spec: Specialisation) -> SimpleNamespace:
    """The contract of `law.py`, and for second derivatives `slopes` s'(z) in the factor and `transposed`."""
    s, dtype, method = spec
    r = make_rows(spec)
    t = r.types
    VQ, VR, MQ, JR = t.VQ, t.VR, t.MQ, t.JR
    NR, Problem = s.nr, make_problem(s, dtype)
    Dual, noise = make_dual(s, dtype), make_noise(spec)
    elimination, sm = make_row_elimination(spec), make_smoothing(dtype, method.residual)
    TAU, ONE = dtype(PROXIMAL[dtype]), dtype(1.0)

    @wp.struct
    class Factor:
        saddle: elimination.Factor
        slope: VR  # s'(z)

    @wp.func
    def factor(world: t.World, p: Problem, lam: VR, z: VR, normals: JR):
        out = Factor()
        slack = VR()  # s'(-z)
        diag = VR()
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                if wp.static(method.hard):
                    e = wp.static(sm.kink)(z[i])
                else:
                    sigma = wp.static(noise.level[i])(world, p.sigma)
                    e = wp.static(sm.smooth)(z[i], sigma, ONE / sigma)
                out.slope[i] = e[2]
                slack[i] = e[3]
                diag[i] = wp.static(r.dots[i])(p.jac, normals[i])
        out.saddle = wp.static(elimination.factor)(
            p.minv, p.jac, p.scale, diag, out.slope, slack, p.mask, TAU
        )
        return out

    @wp.func
    def solve(fac: Factor, minv: MQ, jac: JR, scale: VR, mask: int, dv0: VQ, f2: VR, column: int):
        dv, innovation = wp.static(elimination.forward)(fac.saddle, jac, fac.slope, mask, dv0, f2)
        dz = wp.static(elimination.back)(fac.saddle, jac, scale, fac.slope, mask, innovation)
        return dv, dz

    @wp.func
    def transposed(fac: Factor, p: Problem, target: VQ):
        """(P, rho) with target . dv' = -(P . dF1 + rho . dF2)."""
        back = p.minv * target
        rho = VR()
        if p.mask != 0:
            back, dz = solve(fac, p.minv, p.jac, p.scale, p.mask, back, VR(), 0)
            for i in range(wp.static(NR)):
                rho[i] = -fac.slope[i] * dz[i] / p.scale[i]
        return back, rho

    @wp.func
    def dual(fac: Factor, p: Problem, lam: VR, z: VR, target: VQ):
        out = Dual()
        back, rho = transposed(fac, p, target)
        out.p = -back
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                out.rho[i] = -rho[i]
                push = wp.static(r.dots[i])(p.jac, out.p)
                if wp.static(method.inertia_scaling):
                    out.kappa[i] = push * lam[i] / p.scale[i]
                if wp.static(not method.hard):
                    # s = D lambda, and sigma ds/dsigma = s - z s', the same at z and at -z
                    rise = lam[i] * p.scale[i] - z[i] * fac.slope[i]
                    out.sigma[i] = -rise * (push / p.scale[i] + out.rho[i])
        return out

    return SimpleNamespace(
        Factor=Factor, factor=factor, solve=solve, dual=dual, transposed=transposed,
        complete=None, roots=True, scaled=method.inertia_scaling,
    )  # fmt: skip
