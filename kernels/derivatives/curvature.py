"""Second derivatives of the solved step, for full second-order DDP (the V_x . f_xx terms of III.C.2).

For an output c . v' (M29) let (P, rho) solve the transposed linear system and Lambda = P.F1 + rho.F2. Then
d2(c . v') = - Z' H Z, with H the Hessian of Lambda in (q, v, v', z) at fixed (P, rho) and Z = d(q, v, v',
z)/d(q, v, u).
Controls enter linearly. The step itself adds q' = q + h v', so that V_x . f_xx needs only these nv tensors.
"""

import warp as wp

from ..factories import cached
from ..method import Method
from ..residual.noise import make_noise
from ..residual.smoothing import make_smoothing
from ..solvers.law import law_of
from ..specialisation import Specialisation
from ..structure import layout
from .sensitivity import make_linearization


def in_closed_form(method: Method) -> bool:
    """Whether second derivatives are had in closed form; else differences give them."""
    return law_of(method).second and not (method.trapezoidal or method.state_noise)


@cached
def make_curvature(spec: Specialisation) -> wp.Function:
    """curvature(world, x, sol, lin, output): second derivatives (nz, nz) of v'[output] by (q, v, u)."""
    s, dtype, method = spec
    linear = make_linearization(spec)
    step, motion, pairs, pair_mask = linear.step, linear.motion, linear.pairs, linear.pair_mask
    mech, rows, t = step.mech, step.rows, step.types
    noise = make_noise(spec)
    sm = make_smoothing(dtype, method.residual)
    lay = layout(s)
    NV, NR, NZ = s.nv, s.nr, linear.NZ
    NS = 3 * NV + NR  # (q, v, v', z)
    VQ, VX, VR, MQ, V2 = t.VQ, t.VX, t.VR, t.MQ, t.V2
    HESSIAN, MAP = wp.types.matrix((NS, NS), dtype), wp.types.matrix((NS, NZ), dtype)
    SECOND = wp.types.matrix((NZ, NZ), dtype)
    ZERO, ONE, TWO = dtype(0.0), dtype(1.0), dtype(2.0)
    H, FRICTION = (lay.offset(n) for n in ("step_size", "friction"))
    sign = tuple(dtype(float(r.sign)) for r in s.rows)
    pair_rows = step.pair_rows

    def make_pair_curvature(k: int) -> wp.Function:
        d = pairs[k]

        @wp.func
        def row_gradient(world: t.World, g: d.PairGeometry, y: VQ, sgn: dtype):
            """d/dq of J_i.y for the row with tangent sign `sgn`."""
            c = wp.static(d.contract)(g, y)
            out = VQ()
            for j in range(wp.static(NV)):
                out[j] = c[0, j] + sgn * world.params[wp.static(FRICTION + k)] * c[1, j]
            return out

        @wp.func
        def scaling(
            world: t.World, sol: step.Solution, lin: linear.Linear, g: d.PairGeometry, i: int, sgn: dtype
        ):
            """d2 D_i / dq dq for a contact row: explicit part and the part through m = M^-1 J_i'."""
            mu = sgn * world.params[wp.static(FRICTION + k)]
            m = VQ()
            for j in range(wp.static(NV)):
                m[j] = lin.rows.m[i, j]
            dm = wp.static(step.mass.by_q)(world, lin.pose, m)
            y = wp.static(d.force_by_q)(g, dtype(1.0), mu) - dm  # (j, k): d/dq_k of J_i' - M m
            out = TWO * (wp.transpose(y) * (sol.minv * y))
            out += TWO * wp.static(d.hessian)(g, m, dtype(1.0), mu)
            out -= wp.static(step.mass.hessian)(world, lin.pose, m, m)
            return out

        @wp.func
        def add(
            world: t.World,
            fr: t.FRAMES,
            sol: step.Solution,
            lin: linear.Linear,
            p: VQ,
            rho: VR,
            hess: HESSIAN,
        ):
            """The pair's part of H."""
            out = hess
            n = V2(sol.normal[wp.static(2 * k)], sol.normal[wp.static(2 * k + 1)])
            g = wp.static(d.geometry)(world, fr, n)
            h = world.params[wp.static(H)]
            qq = MQ()
            fn = ZERO
            ft = ZERO
            rn = ZERO
            rt = ZERO
            for i in range(wp.static(NR)):
                if wp.static(i in pair_rows[k]):
                    if (sol.mask & wp.static(1 << i)) != 0:
                        mu = wp.static(sign[i]) * world.params[wp.static(FRICTION + k)]
                        fn += sol.lam[i]
                        ft += mu * sol.lam[i]
                        rn += rho[i]
                        rt += mu * rho[i]
                        push = row_gradient(world, g, p, wp.static(sign[i]))
                        for a in range(wp.static(NV)):
                            value = -lin.factor.slope[i] / sol.scale[i] * push[a]
                            out[a, wp.static(3 * NV + i)] = out[a, wp.static(3 * NV + i)] + value
            qq -= wp.static(d.hessian)(g, p, fn, ft)
            qq += wp.static(d.hessian)(g, sol.v, rn, rt)
            qq += wp.static(d.force_by_q)(g, rn / h, ZERO)
            by = wp.static(d.force_by_q)(g, rn, rt)  # (j, k): d/dq_k of the rows times rho
            for a in range(wp.static(NV)):
                for b in range(wp.static(NV)):
                    out[a, b] = out[a, b] + qq[a, b]
                    out[a, wp.static(2 * NV + b)] = out[a, wp.static(2 * NV + b)] + by[b, a]
            if wp.static(method.inertia_scaling):
                for i in range(wp.static(NR)):
                    if wp.static(i in pair_rows[k]):
                        if (sol.mask & wp.static(1 << i)) != 0:
                            push = row_gradient(world, g, p, wp.static(sign[i]))
                            second = scaling(world, sol, lin, g, i, wp.static(sign[i]))
                            out = add_scaling(
                                sol, lin, i, wp.static(rows.dots[i])(sol.jac, p), push, second, out
                            )
            return out

        return add

    @wp.func
    def add_scaling(
        sol: step.Solution, lin: linear.Linear, i: int, pi: dtype, push: VQ, second: MQ, hess: HESSIAN
    ):
        # Lambda contains -(J_i P) s(z_i)/D_i(q): what D's dependence on q adds
        out = hess
        lam = sol.lam[i]
        scale = sol.scale[i]
        for a in range(wp.static(NV)):
            da = lin.rows.scale_by_q[i, a]
            for b in range(wp.static(NV)):
                db = lin.rows.scale_by_q[i, b]
                value = (push[a] * db + push[b] * da + pi * second[a, b]) - TWO * pi * da * db / scale
                out[a, b] = out[a, b] + lam / scale * value
            c = 3 * wp.static(NV) + i
            out[a, c] = out[a, c] + lin.factor.slope[i] * pi * da / (scale * scale)
        return out

    pair_curvatures = tuple(make_pair_curvature(k) for k in range(len(s.pairs)))

    @wp.func
    def limit_scaling(world: t.World, sol: step.Solution, lin: linear.Linear, p: VQ, hess: HESSIAN):
        out = hess
        for i in range(wp.static(NR)):
            if wp.static(rows.limit[i]):
                if (sol.mask & wp.static(1 << i)) != 0:
                    m = VQ()
                    for j in range(wp.static(NV)):
                        m[j] = lin.rows.m[i, j]
                    dm = wp.static(step.mass.by_q)(world, lin.pose, m)
                    second = TWO * (wp.transpose(dm) * (sol.minv * dm))
                    second -= wp.static(step.mass.hessian)(world, lin.pose, m, m)
                    out = add_scaling(sol, lin, i, wp.static(rows.dots[i])(sol.jac, p), VQ(), second, out)
        return out

    @wp.func
    def motion_hessian(world: t.World, lin: linear.Linear, p: VQ, v: VQ, hess: HESSIAN):
        # P.(N (v' - v) - h r)
        out = hess
        h = world.params[wp.static(H)]
        qq = wp.static(motion.hessian_qq)(world, lin.pose, p, lin.w, v, h)
        qq = wp.static(step.mass.stiff_hessian)(world, lin.pose.frames, p, lin.w, qq)
        qv = wp.static(motion.hessian_qv)(world, lin.pose, p, v, h)
        vv = wp.static(motion.hessian_vv)(world, lin.pose.jacobians, p, h)
        # mass_p (m, k): d(M P)_m/dq_k
        mass_p = wp.static(step.mass.by_q)(world, lin.pose, p)
        for a in range(wp.static(NV)):
            for b in range(wp.static(NV)):
                out[a, b] = out[a, b] + qq[a, b]
                out[a, wp.static(NV + b)] = out[a, wp.static(NV + b)] + qv[a, b] - mass_p[b, a]
                out[a, wp.static(2 * NV + b)] = out[a, wp.static(2 * NV + b)] + mass_p[b, a]
                out[wp.static(NV + a), wp.static(NV + b)] = vv[a, b]
        return out

    @wp.func
    def whole(lin: linear.Linear, filled: HESSIAN):
        """Z' H Z of whole matrices; a GPU would index them in memory."""
        hess = filled
        for a in range(wp.static(NV)):  # blocks were filled above the diagonal only
            for b in range(wp.static(2 * NV + NR)):
                hess[wp.static(NV + b), a] = hess[a, wp.static(NV + b)]
        chain = MAP()
        for c in range(wp.static(NZ)):
            if wp.static(c < 2 * NV):
                chain[c, c] = dtype(1.0)
            for j in range(wp.static(NV)):
                chain[wp.static(2 * NV + j), c] = lin.dv[j, c]
            for i in range(wp.static(NR)):
                chain[wp.static(3 * NV + i), c] = lin.dz[i, c]
        return wp.transpose(chain) * (hess * chain)

    @wp.func
    def by_blocks(lin: linear.Linear, hess: HESSIAN):
        """The same sums without what is zero or one in H and Z."""
        out = SECOND()
        for c in range(wp.static(NZ)):
            # column c of H Z: its rows of q, v, v' and z
            by_q = VQ()
            by_v = VQ()
            by_w = VQ()
            by_z = VR()
            for a in range(wp.static(NV)):
                if wp.static(c < 2 * NV):
                    by_q[a] = hess[a, c]
                if wp.static(c < NV):
                    by_v[a] = hess[c, wp.static(NV + a)]
                    by_w[a] = hess[c, wp.static(2 * NV + a)]
                elif wp.static(c < 2 * NV):
                    by_v[a] = hess[wp.static(NV + a), c]
                for j in range(wp.static(NV)):
                    by_q[a] = by_q[a] + hess[a, wp.static(2 * NV + j)] * lin.dv[j, c]
                for i in range(wp.static(NR)):
                    by_q[a] = by_q[a] + hess[a, wp.static(3 * NV + i)] * lin.dz[i, c]
            for i in range(wp.static(NR)):
                if wp.static(c < NV):
                    by_z[i] = hess[c, wp.static(3 * NV + i)]
                by_z[i] = by_z[i] + hess[wp.static(3 * NV + i), wp.static(3 * NV + i)] * lin.dz[i, c]
            for b in range(wp.static(NZ)):
                value = ZERO
                if wp.static(b < NV):
                    value = by_q[b]
                elif wp.static(b < 2 * NV):
                    value = by_v[wp.static(b - NV)]
                for j in range(wp.static(NV)):
                    value += lin.dv[j, b] * by_w[j]
                for i in range(wp.static(NR)):
                    value += lin.dz[i, b] * by_z[i]
                out[b, c] = value
        return out

    @wp.func
    def curvature(world: t.World, x: VX, sol: step.Solution, lin: linear.Linear, output: int):
        """Second derivatives of v'[output], symmetric."""
        q, v = step.split(x)
        target = VQ()
        target[output] = dtype(1.0)
        fr = wp.static(mech.frames)(world, q)
        p, rho = linear.response.transposed(lin.factor, step.posed(sol), sol.lam, target)
        hess = motion_hessian(world, lin, p, v, HESSIAN())
        for k in range(wp.static(len(s.pairs))):
            if (sol.mask & wp.static(pair_mask[k])) != 0:
                hess = wp.static(pair_curvatures[k])(world, fr, sol, lin, p, rho, hess)
        if wp.static(method.inertia_scaling):
            hess = limit_scaling(world, sol, lin, p, hess)
        for i in range(wp.static(NR)):
            if wp.static(not method.hard):
                if (sol.mask & wp.static(1 << i)) != 0:
                    sigma = wp.static(noise.level[i])(world, sol.sigma)
                    bend = wp.static(sm.bend)(sol.z[i], ONE / sigma)  # s''(z)
                    force = wp.static(rows.dots[i])(sol.jac, p) / sol.scale[i] + rho[i]
                    hess[wp.static(3 * NV + i), wp.static(3 * NV + i)] = -bend * force
        if wp.static(method.part == "whole"):
            return -whole(lin, hess)
        return -by_blocks(lin, hess)

    return curvature
