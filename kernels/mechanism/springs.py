"""Springs and dampers between two points on bodies, with first and second derivatives.

With Delta = p_B - p_A the length is l = sqrt(s), s = |Delta|^2 + eps^2: eps = rest length / 1000 + 1e-5 keeps
all derivatives finite at zero length. With a = d(s/2)/dq and m = a.v the generalised force (M26) of a
stiffness k, a damping c and a rest length L is r = -(k (l - L) + c dl/dt) dl/dq = -G a, G = k (1 - L/l) + c m
/ s. Here a_j = Delta.Delta_j, H = da/dq has H_jk = Delta_j.Delta_k + Delta.Delta_jk, and contractions of
dH/dq follow from the rule of `kinematics.py`.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..structure import REVOLUTE, WORLD, Structure, layout
from .kinematics import make_kinematics, make_second


@cached
def make_spring(s: Structure, index: int, dtype: type) -> SimpleNamespace:
    """Warp functions of spring `index`; the derivatives add to what they are given. They are of -r with a
    share of the stiffness, and the damper seeing y: of -h r with share = h, y = h v.

    span(world, frames, y, share) -> Span: what all are made of; rounding(L) = eps, of slope SHORT. apart: of
    which coordinates l is a function; those that move both ends as one would only leave roundings of k.
    """
    kin = make_kinematics(s, dtype)
    t = kin.types
    lay = layout(s)
    VQ, MQ, J2, V2 = t.VQ, t.MQ, t.J2, t.V2
    V6 = wp.types.vector(6, dtype)
    NV = s.nv
    ZERO, ONE, TWO, HALF = dtype(0.0), dtype(1.0), dtype(2.0), dtype(0.5)
    SHORT, TINY, QUARTER3 = dtype(1e-3), dtype(1e-5), dtype(0.75)
    a, b = s.springs[index]
    K, C, L = (lay.offset(f"spring_{n}") + index for n in ("stiffness", "damping", "length"))
    POINT = lay.offset("spring_point") + 4 * index
    jac_a, jac_b = kin.point_jacobian(a), kin.point_jacobian(b)
    second_a, second_b = make_second(s, a, dtype), make_second(s, b, dtype)
    rev = tuple(kind == REVOLUTE for kind in s.dof_kind)
    chain_a = tuple(s.in_chain(a, j) for j in range(NV))
    chain_b = tuple(s.in_chain(b, j) for j in range(NV))
    apart = tuple(one != two for one, two in zip(chain_a, chain_b))

    def make_point(body: int, column: int) -> wp.Function:
        @wp.func
        def point(world: t.World, fr: t.FRAMES):
            x = world.params[wp.static(column)]
            y = world.params[wp.static(column + 1)]
            if wp.static(body == WORLD):
                return V2(x, y)
            c = fr[wp.static(max(body, 0)), 0]
            sn = fr[wp.static(max(body, 0)), 1]
            return V2(
                fr[wp.static(max(body, 0)), 2] + c * x - sn * y,
                fr[wp.static(max(body, 0)), 3] + sn * x + c * y,
            )

        return point

    point_a, point_b = make_point(a, POINT), make_point(b, POINT + 2)

    @wp.struct
    class Span:
        pa: V2
        pb: V2
        delta: V2
        ja: J2
        jb: J2
        a: VQ  # d(s/2)/dq
        inv: dtype  # 1/s
        g: V6  # G, G_s, G_m, G_ss, G_sm

    @wp.func
    def rounding(rest: dtype):
        """eps"""
        return SHORT * rest + TINY

    @wp.func
    def span(world: t.World, fr: t.FRAMES, y: VQ, share: dtype):
        out = Span()
        pa = wp.static(point_a)(world, fr)
        pb = wp.static(point_b)(world, fr)
        out.pa = pa
        out.pb = pb
        out.delta = pb - pa
        out.ja = wp.static(jac_a)(world, fr, pa[0], pa[1])
        out.jb = wp.static(jac_b)(world, fr, pb[0], pb[1])
        m = ZERO
        for j in range(wp.static(NV)):
            if wp.static(apart[j]):
                slope = out.delta[0] * (out.jb[0, j] - out.ja[0, j])
                slope += out.delta[1] * (out.jb[1, j] - out.ja[1, j])
                out.a[j] = slope
                m += slope * y[j]
        k = share * world.params[wp.static(K)]
        c = world.params[wp.static(C)]
        rest = world.params[wp.static(L)]
        eps = rounding(rest)
        inv = ONE / (wp.dot(out.delta, out.delta) + eps * eps)
        out.inv = inv
        pull = k * rest * wp.sqrt(inv)
        out.g[0] = k - pull + c * m * inv
        out.g[1] = inv * (HALF * pull - c * m * inv)
        out.g[2] = c * inv
        out.g[3] = inv * inv * (TWO * c * m * inv - QUARTER3 * pull)
        out.g[4] = -c * inv * inv
        return out

    @wp.func
    def bend(e: Span, y: VQ):
        """H y, the derivative of a.y by q at constant y."""
        out = VQ()
        sa = wp.static(second_a)(e.ja, y)
        sb = wp.static(second_b)(e.jb, y)
        dy = e.jb * y - e.ja * y
        for k in range(wp.static(NV)):
            if wp.static(apart[k]):
                out[k] = (
                    dy[0] * (e.jb[0, k] - e.ja[0, k])
                    + dy[1] * (e.jb[1, k] - e.ja[1, k])
                    + e.delta[0] * (sb[0, k] - sa[0, k])
                    + e.delta[1] * (sb[1, k] - sa[1, k])
                )
        return out

    @wp.func
    def across(ja: J2, jb: J2, l: int, turns_a: bool, turns_b: bool):
        """perp of the columns l of J_B - J_A, of the bodies that the shallower index turns."""
        x = ZERO
        y = ZERO
        if turns_a:
            x += ja[1, l]
            y -= ja[0, l]
        if turns_b:
            x -= jb[1, l]
            y += jb[0, l]
        return V2(x, y)

    @wp.func
    def second(e: Span):
        """H."""
        out = MQ()
        for k in range(wp.static(NV)):
            for i in range(wp.static(NV - k)):
                l = wp.static(k + i)
                if wp.static(apart[k] and apart[k + i]):
                    value = (e.jb[0, k] - e.ja[0, k]) * (e.jb[0, l] - e.ja[0, l])
                    value += (e.jb[1, k] - e.ja[1, k]) * (e.jb[1, l] - e.ja[1, l])
                    if wp.static(rev[k]):
                        in_a = wp.static(chain_a[k] and chain_a[k + i])
                        in_b = wp.static(chain_b[k] and chain_b[k + i])
                        p = across(e.ja, e.jb, l, in_a, in_b)
                        value += e.delta[0] * p[0] + e.delta[1] * p[1]
                    out[k, l] = value
                    out[l, k] = value
        return out

    @wp.func
    def third(e: Span, y: VQ):
        """d2/dq dq of a.y at constant y."""
        out = MQ()
        sa = wp.static(second_a)(e.ja, y)
        sb = wp.static(second_b)(e.jb, y)
        dy = e.jb * y - e.ja * y
        for k in range(wp.static(NV)):
            for i in range(wp.static(NV - k)):
                l = wp.static(k + i)
                if wp.static(apart[k] and apart[k + i]):
                    value = (sb[0, k] - sa[0, k]) * (e.jb[0, l] - e.ja[0, l])
                    value += (sb[1, k] - sa[1, k]) * (e.jb[1, l] - e.ja[1, l])
                    value += (sb[0, l] - sa[0, l]) * (e.jb[0, k] - e.ja[0, k])
                    value += (sb[1, l] - sa[1, l]) * (e.jb[1, k] - e.ja[1, k])
                    if wp.static(rev[k]):
                        in_a = wp.static(chain_a[k] and chain_a[k + i])
                        in_b = wp.static(chain_b[k] and chain_b[k + i])
                        p = across(e.ja, e.jb, l, in_a, in_b)
                        r = across(sa, sb, l, in_a, in_b)
                        value += dy[0] * p[0] + dy[1] * p[1] + e.delta[0] * r[0] + e.delta[1] * r[1]
                    out[k, l] = value
                    out[l, k] = value
        return out

    @wp.func
    def force(world: t.World, fr: t.FRAMES, v: VQ, total: VQ):
        """total + r"""
        e = span(world, fr, v, ONE)
        return total - e.g[0] * e.a

    @wp.func
    def by_q(world: t.World, fr: t.FRAMES, y: VQ, share: dtype, total: MQ):
        e = span(world, fr, y, share)
        slope = TWO * e.g[1] * e.a + e.g[2] * bend(e, y)
        return total + e.g[0] * second(e) + wp.outer(e.a, slope)

    @wp.func
    def by_v(world: t.World, fr: t.FRAMES, h: dtype, total: MQ):
        """total + h C"""
        e = span(world, fr, VQ(), ZERO)
        return total + (h * e.g[2]) * wp.outer(e.a, e.a)

    @wp.func
    def hessian_qq(world: t.World, fr: t.FRAMES, p: VQ, y: VQ, share: dtype, total: MQ):
        e = span(world, fr, y, share)
        along = wp.dot(p, e.a)
        hy = bend(e, y)
        hp = bend(e, p)
        slope = TWO * e.g[1] * e.a + e.g[2] * hy
        cross = (TWO * e.g[4] * along) * wp.outer(e.a, hy) + wp.outer(slope, hp)
        out = (dtype(4.0) * e.g[3] * along) * wp.outer(e.a, e.a) + (TWO * e.g[1] * along) * second(e)
        out += cross + wp.transpose(cross) + (e.g[2] * along) * third(e, y) + e.g[0] * third(e, p)
        return total + out

    @wp.func
    def hessian_qv(world: t.World, fr: t.FRAMES, p: VQ, h: dtype, total: MQ):
        e = span(world, fr, VQ(), ZERO)
        along = wp.dot(p, e.a)
        slope = e.g[2] * bend(e, p) + (TWO * e.g[4] * along) * e.a
        return total + h * (wp.outer(slope, e.a) + (e.g[2] * along) * second(e))

    return SimpleNamespace(
        types=t,
        force=force,
        by_q=by_q,
        by_v=by_v,
        hessian_qq=hessian_qq,
        hessian_qv=hessian_qv,
        Span=Span,
        bend=bend,
        second=second,
        third=third,
        across=across,
        span=span,
        rounding=rounding,
        SHORT=SHORT,
        apart=apart,
    )
