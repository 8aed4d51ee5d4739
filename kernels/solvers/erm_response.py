"""How the minimum of ERM's objective (`erm.py`) changes, dlambda = -H^-1 dG.

G = D r_a + J p = 0, where M p = J' y and y = r_w. At fixed lambda a change of state moves v' by dv0 and w by
dw = J dv0 + dJ v' + d(d/h), and with it
dG = dD (r_a + D r_aa lambda) + D r_aw dw + dJ p + J M^-1 (dJ' y - dM p + J' (r_aw lambda dD + r_ww dw)).

Weights (`dual.py`): nu of G = 0 and Q of M p = J' r_w, with H nu = J M^-1 target, Q = -M^-1 J' nu; L = Q and
R = p. As r is of the second degree in (a, w, sigma) together, sigma r_(a sigma) = r_a - a r_aa - w r_aw, and
so for r_w.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.problem import make_problem
from ..contact.refinement import GO_ON, LOST, make_refinement
from ..contact.rows import make_rows
from ..device.seldom import seldom
from ..factories import cached
from ..residual.noise import make_noise
from ..specialisation import Specialisation
from .dual import make_dual
from .erm import PROXIMAL, make_erm, make_gather

REFINEMENTS = 2  # of what H^-1 is applied to
SMALL = {wp.float64: 1e-9, wp.float32: 1e-4}  # pivots of H, beside its diagonal: H itself has lost its digits


@cached
def make_erm_response(spec: Specialisation) -> SimpleNamespace:
    """The contract of `law.py`; G has a second form in the rows, at (y, p), which `complete` takes."""
    s, dtype, method = spec
    erm = make_erm(s.nr, dtype, method.residual)
    gather = make_gather(spec)
    r = make_rows(spec)
    t = r.types
    VQ, VR, MQ, JR, MR = t.VQ, t.VR, t.MQ, t.JR, erm.MR
    Problem, Dual = make_problem(s, dtype), make_dual(s, dtype)
    noise = make_noise(spec)
    NR, NV = s.nr, s.nv
    TAU, LEAST = dtype(PROXIMAL[dtype]), dtype(SMALL[dtype])
    refinement = make_refinement(spec)

    @wp.struct
    class Factor:
        h: MR  # H
        root: MR  # Cholesky factor of H and a proximal term
        scale: VR
        r_a: VR
        y: VR  # r_w
        r_aa: VR
        r_aw: VR
        r_ww: VR
        p: VQ
        by_q: JR  # dG/dq at fixed lambda and v'
        near: int  # 1: rows nearly oppose or repeat each other

    @wp.func
    def factor(world: t.World, problem: Problem, lam: VR, z: VR, normals: JR):
        out = Factor()
        level = VR()
        a = VR()
        w = VR()
        f = VQ()
        if problem.mask != 0:
            out.scale = problem.scale
            for i in range(wp.static(NR)):
                level[i] = wp.static(noise.level[i])(world, problem.sigma)
                a[i] = problem.scale[i] * lam[i]
                w[i] = a[i] - z[i]
                e = wp.static(erm.terms)(a[i], w[i], level[i])
                out.r_a[i] = e[0]
                out.y[i] = e[1]
                out.r_aa[i] = e[2]
                out.r_aw[i] = e[3]
                out.r_ww[i] = e[4]
                f = wp.static(r.adds[i])(f, problem.jac, e[1])
            out.p = problem.minv * f
            A = gather(problem.minv, problem.jac)
            h = wp.static(erm.hessian)(A, problem.scale, level, a, w)
            size = wp.static(erm.sizes)(A, problem.scale)
            root, ok = wp.static(erm.factor)(h, size, TAU)
            out.near = wp.where(ok == 0, 1, 0)
            for i in range(wp.static(NR)):
                if not (root[i, i] * root[i, i] > LEAST * size[i]):
                    out.near = 1
            out.h = h
            out.root = root
        return out

    @wp.func
    def pushed(minv: MQ, jac: JR, x: VR):
        f = VQ()
        for i in range(wp.static(NR)):
            f = wp.static(r.adds[i])(f, jac, x[i])
        return minv * f

    @wp.func
    def correction(fac: Factor, minv: MQ, jac: JR, rhs: VR, x: VR):
        """Of x, by what H leaves of rhs. H's entries have lost the digits of A's small ones, squared: J and
        M^-1 have them.
        """
        moves = pushed(minv, jac, x)
        a = VR()
        second = VR()
        for i in range(wp.static(NR)):
            a[i] = wp.static(r.dots[i])(jac, moves)
            second[i] = fac.r_aw[i] * fac.scale[i] * x[i] + fac.r_ww[i] * a[i]
        moves = pushed(minv, jac, second)
        left = rhs
        for i in range(wp.static(NR)):
            own = fac.scale[i] * (fac.r_aa[i] * fac.scale[i] * x[i] + fac.r_aw[i] * a[i])
            left[i] = left[i] - own - wp.static(r.dots[i])(jac, moves)
        return wp.static(erm.substitute)(fac.root, left)

    @wp.func(inline=False)
    def inverse_refined(fac: Factor, minv: MQ, jac: JR, dv0: VQ, rhs: VR):
        """H^-1 rhs, refined until dv0 - M^-1 J' of it stays; not numbers where it does not."""
        x = wp.static(erm.substitute)(fac.root, rhs)
        before = VQ()
        way = int(wp.static(GO_ON))
        count = int(1)
        while way == wp.static(GO_ON):
            by = correction(fac, minv, jac, rhs, x)
            x += by
            change = pushed(minv, jac, by)
            way = refinement.judge(minv, dv0, dv0 - pushed(minv, jac, x), change, before, count)
            before = change
            count += 1
        if way == wp.static(LOST):
            _dv, x = refinement.none()
        return x

    @wp.func
    def inverse(fac: Factor, minv: MQ, jac: JR, dv0: VQ, rhs: VR):
        """H^-1 rhs: of flat directions the proximal term would leave little right."""
        x = wp.static(erm.substitute)(fac.root, rhs)
        for _ in range(wp.static(REFINEMENTS)):
            x += wp.static(erm.substitute)(fac.root, rhs - fac.h * x)
        return x

    @wp.func
    def complete(fac: Factor, problem: Problem, lam: VR, force: MQ, motion: JR, scale_by_q: JR):
        # force (j, k): d/dq_k of J' y - M p; motion (i, k): d/dq_k of J_i p
        out = fac
        for k in range(wp.static(NV)):
            f = VQ()
            for j in range(wp.static(NV)):
                f[j] = force[j, k]
            for i in range(wp.static(NR)):
                f = wp.static(r.adds[i])(f, problem.jac, fac.r_aw[i] * lam[i] * scale_by_q[i, k])
            dp = problem.minv * f
            for i in range(wp.static(NR)):
                value = motion[i, k] + wp.static(r.dots[i])(problem.jac, dp)
                value += scale_by_q[i, k] * (fac.r_a[i] + fac.scale[i] * fac.r_aa[i] * lam[i])
                out.by_q[i, k] = value
        return out

    def column_by(applied: wp.Function) -> wp.Function:
        @wp.func
        def solve(fac: Factor, minv: MQ, jac: JR, scale: VR, mask: int, dv0: VQ, f2: VR, column: int):
            """dv' of a column, from dv0 and -f2 = dJ v' + d(d/h)."""
            rhs = VR()
            f = VQ()
            for i in range(wp.static(NR)):
                dw = wp.static(r.dots[i])(jac, dv0) - f2[i]
                rhs[i] = fac.scale[i] * fac.r_aw[i] * dw
                f = wp.static(r.adds[i])(f, jac, fac.r_ww[i] * dw)
            dp = minv * f
            for i in range(wp.static(NR)):
                rhs[i] = rhs[i] + wp.static(r.dots[i])(jac, dp)
                if column < wp.static(NV):
                    rhs[i] = rhs[i] + fac.by_q[i, column]
            dlam = -applied(fac, minv, jac, dv0, rhs)
            f = VQ()
            for i in range(wp.static(NR)):
                f = wp.static(r.adds[i])(f, jac, dlam[i])
            return dv0 + minv * f, VR()

        return solve

    solve, refined = column_by(inverse), column_by(inverse_refined)

    @wp.func
    def dual(fac: Factor, problem: Problem, lam: VR, z: VR, target: VQ):
        out = Dual()
        out.p = -(problem.minv * target)
        if problem.mask != 0:
            rhs = VR()
            for i in range(wp.static(NR)):
                rhs[i] = wp.static(r.dots[i])(problem.jac, out.p)
            nu = inverse(fac, problem.minv, problem.jac, out.p, rhs)
            if seldom(fac.near == 1):
                nu = inverse_refined(fac, problem.minv, problem.jac, out.p, rhs)
                by = correction(fac, problem.minv, problem.jac, rhs, nu)
                by_p = pushed(problem.minv, problem.jac, by)
                if not refinement.carries(problem.jac, lam, target, by_p):
                    _dv, nu = refinement.none()
            f = VQ()
            for i in range(wp.static(NR)):
                f = wp.static(r.adds[i])(f, problem.jac, nu[i])
            out.left = -(problem.minv * f)
            out.right = fac.p
            f = VQ()
            for i in range(wp.static(NR)):
                scale = problem.scale[i]
                a = scale * lam[i]
                w = a - z[i]
                moved = -wp.static(r.dots[i])(problem.jac, out.left)  # (A nu)_i
                r_a = fac.r_a[i]
                r_w = fac.y[i]
                r_aa = fac.r_aa[i]
                r_aw = fac.r_aw[i]
                r_ww = fac.r_ww[i]
                out.rho[i] = moved * r_ww + scale * r_aw * nu[i]
                if wp.static(method.inertia_scaling):
                    out.kappa[i] = moved * r_aw * lam[i] + nu[i] * (r_a + a * r_aa)
                by_a = r_a - a * r_aa - w * r_aw
                out.sigma[i] = moved * (r_w - a * r_aw - w * r_ww) + nu[i] * scale * by_a
                for j in range(wp.static(NV)):
                    out.bend[i, j] = nu[i] * out.right[j] - r_w * out.left[j]
                f = wp.static(r.adds[i])(f, problem.jac, out.rho[i])
            out.p = out.p - problem.minv * f
        return out

    return SimpleNamespace(
        Factor=Factor,
        factor=factor,
        yielding=factor,
        solve=solve,
        refined=refined,
        dual=dual,
        complete=complete,
        roots=False,
        scaled=method.inertia_scaling,
    )
