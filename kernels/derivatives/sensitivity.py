"""Derivatives of the solved step by the implicit function theorem: v'(q, v, u) to first order.

At the solution F1 = M (v' - v) - h (r + u) - J' lambda = 0 and F2 = J v' + d/h - s(-z) = 0 with lambda =
s(z)/D, so (dv', dz) solves [M, -J' s'(z)/D; J, s'(-z)] (dv', dz) = -(F1, F2)_x, with the factor that Newton
uses. No iteration is differentiated. With the trapezoidal integrator F1 = M (v' - v_free) - J' lambda, where
v_free(q, v, u) has derivatives of its own, and so for the velocity v* that positions move with.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.derivatives import make_pair_derivatives
from ..factories import cached
from ..mechanism.dynamics_derivatives import make_mechanism_derivatives
from ..residual.noise import make_noise
from ..residual.smoothing import make_smoothing
from ..solvers.coulomb_response import make_coulomb_response
from ..solvers.elimination import PROXIMAL, make_row_elimination
from ..solvers.erm_response import make_erm_response
from ..specialisation import Specialisation
from ..step.step import make_step
from ..structure import layout
from .pair_terms import make_pair_terms


@cached
def make_linearization(spec: Specialisation) -> SimpleNamespace:
    """Warp functions and the struct `Linear` of a step's first-order expansion (also what `curvature.py`
    starts from).
    """
    s, dtype, method = spec
    step = make_step(spec, False)
    mech, rows, t, Solution = step.mech, step.rows, step.types, step.Solution
    motion = make_mechanism_derivatives(s, dtype, method.trapezoidal)
    pairs = tuple(make_pair_derivatives(s, k, dtype) for k in range(len(s.pairs)))
    elimination = make_row_elimination(spec)
    coulomb = method.coulomb and s.nr > 0
    erm = method.erm and s.nr > 0
    response = make_coulomb_response(spec) if coulomb else None
    least = make_erm_response(spec) if erm else None
    sm = make_smoothing(dtype, method.residual)
    noise = make_noise(spec)
    lay = layout(s)
    NV, NR = s.nv, s.nr
    NZ = 2 * NV + s.nu
    VQ, VX, VR, MQ, JR, V2 = t.VQ, t.VX, t.VR, t.MQ, t.JR, t.V2
    DZ = wp.types.matrix((max(NR, 1), NZ), dtype)
    DV = step.free.DV
    TAU = dtype(PROXIMAL[dtype])
    ONE, HALF = dtype(1.0), dtype(0.5)
    H = lay.offset("step_size")
    index = tuple(r.index for r in s.rows)
    sign = tuple(dtype(float(r.sign)) for r in s.rows)
    contact = tuple(r.kind == "contact" for r in s.rows)
    pair_rows = step.pair_rows

    @wp.struct
    class Linear:
        fr: t.FRAMES
        jb: t.JB
        w: VQ  # v' - v
        slope: VR  # s'(z)
        slack: VR  # s'(-z)
        factor: response.Factor if coulomb else least.Factor if erm else elimination.Factor
        gap_row: JR  # dd/dq of every active row
        m: JR  # M^-1 J_i'
        scale_by_q: JR  # dD_i/dq
        dv: DV  # dv'/d(q, v, u)
        dz: DZ  # dz/d(q, v, u)

    @wp.func
    def slopes(params: wp.array2d(dtype=dtype), row: int, sol: step.Solution, lin: Linear):
        out = lin
        for i in range(wp.static(NR)):
            if (sol.mask & wp.static(1 << i)) != 0:
                if wp.static(method.hard):
                    e = wp.static(sm.kink)(sol.z[i])
                else:
                    sigma = wp.static(noise.level[i])(params, row, sol.sigma)
                    e = wp.static(sm.smooth)(sol.z[i], sigma, ONE / sigma)
                out.slope[i] = e[2]
                out.slack[i] = e[3]
        return out

    pair_terms = tuple(make_pair_terms(spec, step, pairs[k], Linear, k) for k in range(len(s.pairs)))
    pair_mask = tuple(sum(1 << i for i in pair_rows[k]) for k in range(len(s.pairs)))

    @wp.func
    def scaling_terms(
        params: wp.array2d(dtype=dtype), row: int, sol: step.Solution, lin: Linear, f1: MQ, v: VQ
    ):
        # D(q) = J M^-1 J' on the diagonal: dD = 2 dJ.m - m'(dM)m, and F1 gains J'(lambda/D) dD
        out = f1
        for i in range(wp.static(NR)):
            if (sol.mask & wp.static(1 << i)) != 0:
                m = VQ()
                for j in range(wp.static(NV)):
                    m[j] = lin.m[i, j]
                by_q = wp.static(step.mass.by_q)(params, row, lin.fr, lin.jb, m)
                share = sol.lam[i] / sol.scale[i]
                for k in range(wp.static(NV)):
                    value = lin.scale_by_q[i, k]
                    for j in range(wp.static(NV)):
                        value -= m[j] * by_q[j, k]
                    lin.scale_by_q[i, k] = value
                    column = wp.static(rows.adds[i])(VQ(), sol.jac, share * value)
                    for j in range(wp.static(NV)):
                        out[j, k] = out[j, k] + column[j]
        return out, lin

    @wp.func
    def linearize(
        params: wp.array2d(dtype=dtype),
        row: int,
        x: VX,
        sol: step.Solution,
        external: wp.array2d(dtype=dtype),
        world: int,
    ):
        """First-order expansion of v' (and z) at a step's solution, and of what positions move with."""
        lin = Linear()
        q = VQ()
        v = VQ()
        for j in range(wp.static(NV)):
            q[j] = x[j]
            v[j] = x[wp.static(NV + j)]
        fr = wp.static(mech.frames)(params, row, q)
        lin.fr = fr
        lin.jb = wp.static(mech.com_jacobians)(params, row, fr)
        lin.w = sol.v - v
        if wp.static(method.trapezoidal):
            return trapezoidal(params, row, q, v, sol, lin, external, world)
        source = wp.static(step.free.source)(params, row, lin.fr, lin.jb, lin.w, v, external, world)
        lin = respond(params, row, fr, v, sol, lin, source)
        return lin, lin.dv

    @wp.func
    def trapezoidal(
        params: wp.array2d(dtype=dtype),
        row: int,
        q: VQ,
        v: VQ,
        sol: step.Solution,
        start: Linear,
        external: wp.array2d(dtype=dtype),
        world: int,
    ):
        # predictor, drift, v' in turn, as the step solves them
        h = params[row, wp.static(H)]
        first, moving = step.parts(params, row, start.fr, q, v, sol)
        now = first
        reached = sol.unpushed
        acceleration = sol.acceleration - sol.push / h
        dforce = DV()  # of the predicted contact forces
        dpush = DV()
        free = DV()
        drift = DV()
        lin = start
        part = int(0)
        while part < 3:
            if part < 2:
                free = wp.static(step.free.by_state)(
                    params,
                    row,
                    start.fr,
                    start.jb,
                    sol.minv,
                    v,
                    reached,
                    acceleration,
                    dforce,
                    external,
                    world,
                )
                free = free - dpush
            given = free
            if part == 1:
                given = HALF * free
                for j in range(wp.static(NV)):
                    given[j, wp.static(NV + j)] = given[j, wp.static(NV + j)] + HALF
            source = wp.static(step.free.held)(params, row, start.fr, start.jb, now.v - now.vfree, given)
            lin = respond(params, row, start.fr, v, now, start, source)
            if part == 0:
                dpush = lin.dv - free
                dforce = wp.static(step.free.held)(params, row, start.fr, start.jb, -sol.push, dpush) / h
                reached = sol.vfree + sol.push
                acceleration = sol.acceleration
                now = moving
            elif part == 1:
                drift = lin.dv
                now = sol
            part += 1
        return lin, drift

    @wp.func
    def factored(params: wp.array2d(dtype=dtype), row: int, sol: step.Solution, start: Linear):
        """`start` with what does not depend on what the step is differentiated by."""
        lin = start
        diag = VR()
        if wp.static(not coulomb):
            lin = slopes(params, row, sol, lin)
        for i in range(wp.static(NR)):
            if (sol.mask & wp.static(1 << i)) != 0:
                m = wp.static(rows.applies[i])(sol.minv, sol.jac)
                diag[i] = wp.static(rows.dots[i])(sol.jac, m)
                for j in range(wp.static(NV)):
                    lin.m[i, j] = m[j]
        if wp.static(erm):
            if sol.mask != 0:
                lin.factor = least.prepare(
                    params, row, sol.minv, sol.jac, sol.scale, sol.sigma, sol.lam, sol.z
                )
        elif wp.static(coulomb):
            lin.factor = response.factor(params, row, step.posed(sol), sol.z)
        elif wp.static(NR > 0):
            lin.factor = wp.static(elimination.factor)(
                sol.minv, sol.jac, sol.scale, diag, lin.slope, lin.slack, sol.mask, TAU
            )
        else:
            lin.factor.cov = sol.minv
        return lin

    @wp.func
    def respond(
        params: wp.array2d(dtype=dtype),
        row: int,
        fr: t.FRAMES,
        v: VQ,
        sol: step.Solution,
        start: Linear,
        source: DV,
    ):
        # response of the contact problem to (q, v, u): `source` is -F1_(q, v, u) without the contact's part
        lin = factored(params, row, sol, start)
        h = params[row, wp.static(H)]
        f1q = MQ()
        f2q = JR()
        for i in range(wp.static(NR)):
            if wp.static(not contact[i]):
                if (sol.mask & wp.static(1 << i)) != 0:
                    lin.gap_row[i, wp.static(index[i])] = wp.static(sign[i])
                    f2q[i, wp.static(index[i])] = wp.static(sign[i]) / h
        for k in range(wp.static(len(s.pairs))):
            if (sol.mask & wp.static(pair_mask[k])) != 0:
                n = V2(sol.normal[wp.static(2 * k)], sol.normal[wp.static(2 * k + 1)])
                g = wp.static(pairs[k].geometry)(params, row, fr, n)
                f1q, f2q, lin = wp.static(pair_terms[k].rows)(params, row, sol, g, lin, f1q, f2q)
                if wp.static(method.scaled):
                    lin = wp.static(pair_terms[k].scale)(params, row, g, lin)
                if wp.static(method.state_noise):
                    f1q, f2q = wp.static(pair_terms[k].noise)(params, row, sol, g, lin, f1q, f2q)
        if wp.static(method.scaled):
            moved, lin = scaling_terms(params, row, sol, lin, f1q, v)
            if wp.static(not erm):  # there lambda is the unknown, not z
                f1q = moved
        if wp.static(erm):
            if sol.mask != 0:
                lin.factor = expected(params, row, fr, v, sol, lin)
        return fill(sol, lin, source, f1q, f2q)

    @wp.func
    def expected(
        params: wp.array2d(dtype=dtype), row: int, fr: t.FRAMES, v: VQ, sol: step.Solution, lin: Linear
    ):
        # ERM: the rows' derivatives once more, with y and p in place of lambda and v'
        fac = lin.factor
        twin = Solution()
        twin.jac = sol.jac
        twin.lam = fac.r_w
        twin.v = fac.p
        force = MQ()
        motion_p = JR()
        other = lin
        for k in range(wp.static(len(s.pairs))):
            if (sol.mask & wp.static(pair_mask[k])) != 0:
                n = V2(sol.normal[wp.static(2 * k)], sol.normal[wp.static(2 * k + 1)])
                g = wp.static(pairs[k].geometry)(params, row, fr, n)
                force, motion_p, other = wp.static(pair_terms[k].rows)(
                    params, row, twin, g, other, force, motion_p
                )
                for i in range(wp.static(NR)):
                    if wp.static(i in pair_rows[k]):
                        for j in range(wp.static(NV)):
                            motion_p[i, j] = motion_p[i, j] - lin.gap_row[i, j] / params[row, wp.static(H)]
        force += wp.static(step.mass.by_q)(params, row, lin.fr, lin.jb, fac.p)
        return least.complete(fac, sol.minv, sol.jac, sol.lam, -force, motion_p, lin.scale_by_q)

    @wp.func
    def column(sol: step.Solution, lin: Linear, f1: VQ, f2: VR, c: int):
        # one column of (dv', dz) for the right-hand side (f1, f2)
        dv = sol.minv * f1
        if sol.mask != 0:
            if wp.static(coulomb):
                dv = response.solve(lin.factor, sol.jac, dv, f2)
            elif wp.static(erm):
                dv = least.solve(lin.factor, sol.minv, sol.jac, dv, f2, c)
            else:
                dv, innovation = wp.static(elimination.forward)(
                    lin.factor, sol.jac, lin.slope, sol.mask, dv, f2
                )
                dz = wp.static(elimination.back)(
                    lin.factor, sol.jac, sol.scale, lin.slope, sol.mask, innovation
                )
                for i in range(wp.static(NR)):
                    lin.dz[i, c] = dz[i]
        for j in range(wp.static(NV)):
            lin.dv[j, c] = dv[j]
        return lin

    @wp.func
    def fill(sol: step.Solution, lin: Linear, source: DV, f1q: MQ, f2q: JR):
        out = lin
        for c in range(wp.static(NZ)):
            f1 = VQ()
            f2 = VR()
            for j in range(wp.static(NV)):
                f1[j] = source[j, c]
                if wp.static(c < NV):
                    f1[j] = f1[j] - f1q[j, c]
            if wp.static(c < NV):
                for i in range(wp.static(NR)):
                    f2[i] = -f2q[i, c]
            out = column(sol, out, f1, f2, c)
        return out

    @wp.func
    def transposed(sol: step.Solution, lin: Linear, target: VQ):
        """(P, rho) with target . dv' = -(P . dF1 + rho . dF2)."""
        p = sol.minv * target
        rho = VR()
        if sol.mask != 0:
            p, innovation = wp.static(elimination.forward)(lin.factor, sol.jac, lin.slope, sol.mask, p, VR())
            dz = wp.static(elimination.back)(lin.factor, sol.jac, sol.scale, lin.slope, sol.mask, innovation)
            for i in range(wp.static(NR)):
                rho[i] = -lin.slope[i] * dz[i] / sol.scale[i]
        return p, rho

    return SimpleNamespace(
        step=step,
        motion=motion,
        pairs=pairs,
        Linear=Linear,
        linearize=linearize,
        transposed=transposed,
        factored=factored,
        response=response,
        NZ=NZ,
        DV=DV,
        DZ=DZ,
    )
