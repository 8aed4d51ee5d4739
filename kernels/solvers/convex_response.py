"""How the solution of the convex law, r(z) = J v' + d/h - s(-z) = 0 with D lambda = s(z), changes.

The implicit function theorem with the factor that Newton uses: (dv', dz) solves
[M, -J' s'(z)/D; J, s'(-z)] (dv', dz) = -(F1, F2). No iteration is differentiated. Smoothed rows of which one
repeats others (a foot that stands on both of its ends has four in a plane of three) and which press no harder
than their data suggest yield as generic kernels' do: impulses change places there within 1e-11 of a row's
velocity, and what they ask for beyond that is rounding over nothing.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.problem import make_problem
from ..contact.refinement import GO_ON, LOST, SMALL, make_refinement
from ..contact.rows import make_rows
from ..device.seldom import seldom
from ..factories import cached
from ..residual.noise import make_noise
from ..residual.smoothing import make_smoothing
from ..specialisation import Specialisation
from .dual import make_dual
from .elimination import PROXIMAL, make_row_elimination

YIELDING = {wp.float64: 1e-11, wp.float32: 0.0}  # diag(A) dlambda by which such a row yields
PRESSED = 30.0  # diag(A) lambda, by the velocities of its data, from which it yields as it is


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
    refinement = make_refinement(spec)
    TAU, ONE, SHARE = dtype(PROXIMAL[dtype]), dtype(1.0), dtype(SMALL[dtype])
    YIELDS, MOST = dtype(YIELDING[dtype]), dtype(PRESSED)

    @wp.struct
    class Factor:
        saddle: elimination.Factor
        slope: VR  # s'(z)
        near: int  # 1: rows nearly oppose or repeat each other, solutions are refined
        floor: VR  # s'(-z) is no less, of `yielding`

    @wp.func(inline=False)
    def floors(world: t.World, p: Problem, lam: VR, slope: VR, diag: VR):
        """What s'(-z) of the rows that press no harder than their data suggest is no less than."""
        out = VR()
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                terms = wp.abs(p.rate[i]) + wp.static(noise.level[i])(world, p.sigma)
                terms += wp.abs(wp.static(r.dots[i])(p.jac, p.vfree) + p.rate[i])
                for j in range(wp.static(s.nv)):
                    terms += wp.abs(p.jac[i, j] * p.vfree[j])
                if lam[i] * diag[i] <= MOST * terms:
                    out[i] = YIELDS * slope[i] * diag[i] / p.scale[i]
        return out

    def factor_by(yields: bool) -> wp.Function:
        @wp.func
        def factor(world: t.World, p: Problem, lam: VR, z: VR, normals: JR):
            out = Factor()
            diag = VR()
            slack = VR()
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
            for i in range(wp.static(NR)):
                if (p.mask & wp.static(1 << i)) != 0:
                    if TAU * out.slope[i] * diag[i] * out.saddle.weight[i] > SHARE:
                        out.near = 1
            if wp.static(yields):
                if seldom(out.near == 1):
                    out.floor = floors(world, p, lam, out.slope, diag)
                    for i in range(wp.static(NR)):
                        slack[i] = wp.max(slack[i], out.floor[i])
                    out.saddle = wp.static(elimination.factor)(
                        p.minv, p.jac, p.scale, diag, out.slope, slack, p.mask, TAU
                    )
            return out

        return factor

    factor, yielding = factor_by(False), factor_by(YIELDING[dtype] > 0.0 and not method.hard)

    @wp.func
    def solve(fac: Factor, minv: MQ, jac: JR, scale: VR, mask: int, dv0: VQ, f2: VR, column: int):
        dv, innovation = wp.static(elimination.forward)(fac.saddle, jac, fac.slope, mask, dv0, f2)
        dz = wp.static(elimination.back)(fac.saddle, jac, scale, fac.slope, mask, innovation)
        return dv, dz

    @wp.func
    def correction(
        fac: Factor, minv: MQ, jac: JR, scale: VR, mask: int, dv0: VQ, f2: VR, dv: VQ, dz: VR
    ):  # fmt: skip
        """What the equations without a proximal term, (dv0, f2) of (dv, dz), still ask for."""
        f = VQ()
        rest = VR()
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) != 0:
                f = wp.static(r.adds[i])(f, jac, fac.slope[i] / scale[i] * dz[i])
                rest[i] = f2[i] - wp.static(r.dots[i])(jac, dv)
                rest[i] = rest[i] - wp.max(ONE - fac.slope[i], fac.floor[i]) * dz[i]
        return solve(fac, minv, jac, scale, mask, dv0 - dv + minv * f, rest, 0)

    @wp.func
    def refined(fac: Factor, minv: MQ, jac: JR, scale: VR, mask: int, dv0: VQ, f2: VR, column: int):
        """(dv, dz), refined; not numbers where that does not end."""
        dv, dz = solve(fac, minv, jac, scale, mask, dv0, f2, column)
        before = VQ()
        way = int(wp.static(GO_ON))
        count = int(1)
        while way == wp.static(GO_ON):
            by, more = correction(fac, minv, jac, scale, mask, dv0, f2, dv, dz)
            dv += by
            dz += more
            way = refinement.judge(minv, dv0, dv, by, before, count)
            before = by
            count += 1
        if way == wp.static(LOST):
            dv, dz = refinement.none()
        return dv, dz

    @wp.func
    def carried(fac: Factor, p: Problem, lam: VR, target: VQ, free: VQ):
        """(P, -rho D / s'(z)), refined; not numbers where impulses make much of what is left."""
        back, dz = refined(fac, p.minv, p.jac, p.scale, p.mask, free, VR(), 0)
        by, _dz = correction(fac, p.minv, p.jac, p.scale, p.mask, free, VR(), back, dz)
        if not refinement.carries(p.jac, lam, target, by):
            back, dz = refinement.none()
        return back, dz

    @wp.func
    def transposed(fac: Factor, p: Problem, lam: VR, target: VQ):
        """(P, rho) with target . dv' = -(P . dF1 + rho . dF2)."""
        back = p.minv * target
        rho = VR()
        if p.mask != 0:
            free = back
            back, dz = solve(fac, p.minv, p.jac, p.scale, p.mask, free, VR(), 0)
            if seldom(fac.near == 1):
                back, dz = carried(fac, p, lam, target, free)
            for i in range(wp.static(NR)):
                rho[i] = -fac.slope[i] * dz[i] / p.scale[i]
        return back, rho

    @wp.func
    def dual(fac: Factor, p: Problem, lam: VR, z: VR, target: VQ):
        out = Dual()
        back, rho = transposed(fac, p, lam, target)
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
        Factor=Factor, factor=factor, yielding=yielding, solve=solve, refined=refined, dual=dual,
        transposed=transposed, complete=None, roots=True, scaled=method.inertia_scaling,
    )  # fmt: skip
