"""What one contact pair adds to the linearised step of `rows_by_q.py`."""

from types import SimpleNamespace

import warp as wp

from ..residual.noise import make_noise
from ..specialisation import Specialisation
from ..structure import layout


def make_pair_terms(
    spec: Specialisation, linear: SimpleNamespace, d: SimpleNamespace, k: int
) -> SimpleNamespace:
    """Of pair k with the derivatives d: rows(...) adds to F1_q and F2_q and fills gap gradients, scale(...)
    gives dD/dq at fixed M, noise(...) adds what sigma's dependence on q does.
    """
    s, dtype, method = spec
    step = linear.step
    t, rows = step.types, step.rows
    noise = make_noise(spec)
    own = step.pair_rows[k]
    first, last = own[0], own[-1]
    frictional = len(own) == 2
    apart = rows.tangent[last]  # rows are (n, t), not n +- mu t
    lay = layout(s)
    NV, NR = s.nv, s.nr
    VQ, MQ, JR = t.VQ, t.MQ, t.JR
    ZERO, ONE, HALF, TWO = dtype(0.0), dtype(1.0), dtype(0.5), dtype(2.0)
    H, FRICTION = lay.offset("step_size"), lay.offset("friction")
    sign = tuple(dtype(float(r.sign)) for r in s.rows)

    @wp.func
    def pair_terms(world: t.World, sol: step.Solution, g: d.PairGeometry, gaps: JR, f1: MQ, f2: JR):
        out1 = f1
        out2 = f2
        out3 = gaps
        lam = sol.lam[wp.static(first)]
        normal = lam
        tangent = ZERO
        mu = ZERO
        if wp.static(frictional):
            mu = world.params[wp.static(FRICTION + k)]
            other = sol.lam[wp.static(last)]
            normal = lam
            tangent = other
            if wp.static(not apart):
                normal = lam + other
                tangent = mu * (lam - other)
        out1 -= wp.static(d.force_by_q)(g, normal, tangent)
        by_q = wp.static(d.contract)(g, sol.v)
        h = world.params[wp.static(H)]
        for i in range(wp.static(NR)):
            if wp.static(i in own):
                for j in range(wp.static(NV)):
                    gap = sol.jac[wp.static(first), j]
                    if wp.static(frictional and not apart):
                        gap = HALF * (sol.jac[wp.static(first), j] + sol.jac[wp.static(last), j])
                    out3[i, j] = gap
                    value = by_q[0, j] + gap / h
                    if wp.static(rows.tangent[i]):
                        value = by_q[1, j]
                    elif wp.static(frictional and not apart):
                        value += wp.static(sign[i]) * mu * by_q[1, j]
                    out2[i, j] = value
        return out1, out2, out3

    @wp.func
    def scale_terms(world: t.World, g: d.PairGeometry, m_of: JR, scale_by_q: JR):
        """2 (dJ_i/dq) . m_i of the pair's rows, m_i = M^-1 J_i'."""
        out = scale_by_q
        for i in range(wp.static(NR)):
            if wp.static(i in own):
                m = VQ()
                for j in range(wp.static(NV)):
                    m[j] = m_of[i, j]
                c = wp.static(d.contract)(g, m)
                for j in range(wp.static(NV)):
                    value = c[0, j]
                    if wp.static(frictional):
                        value += wp.static(sign[i]) * world.params[wp.static(FRICTION + k)] * c[1, j]
                    out[i, j] = TWO * value
        return out

    @wp.func
    def noise_terms(
        world: t.World, sol: step.Solution, g: d.PairGeometry, fac: linear.response.Factor, f1: MQ, f2: JR
    ):
        """d sigma_i/dq = (dJ_i/dq) . (C J_i') / sigma_i, eq. (18), and what it adds to F1_q and F2_q."""
        out1 = f1
        out2 = f2
        for i in range(wp.static(NR)):
            if wp.static(i in own):
                if (sol.mask & wp.static(1 << i)) != 0:
                    y = noise.spread(world, wp.static(rows.adds[i])(VQ(), sol.jac, ONE))
                    c = wp.static(d.contract)(g, y)
                    # ds/dlevel at fixed z, the same at z and at -z, times dlevel/dsigma; over sigma
                    rise = (sol.lam[i] * sol.scale[i] - sol.z[i] * fac.slope[i]) / (
                        sol.sigma[i] * sol.sigma[i]
                    )
                    for j in range(wp.static(NV)):
                        value = c[0, j]
                        if wp.static(frictional):
                            value += wp.static(sign[i]) * world.params[wp.static(FRICTION + k)] * c[1, j]
                        out2[i, j] = out2[i, j] - rise * value
                        column = wp.static(rows.adds[i])(VQ(), sol.jac, rise * value / sol.scale[i])
                        for a in range(wp.static(NV)):
                            out1[a, j] = out1[a, j] - column[a]
        return out1, out2

    return SimpleNamespace(rows=pair_terms, scale=scale_terms, noise=noise_terms)
