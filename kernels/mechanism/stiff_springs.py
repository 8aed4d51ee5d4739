"""The stiffness matrix of springs between points that is met at the end of a step, with its derivatives.

Notation of `springs.py`; D = J_B - J_A, rho = L/l. Of the stiffness d(k (1 - L/l) a)/dq the positive part is

    K = k (G D'D + F a a'),  G = 1 - rho, F = rho/s where l > L;  G = 0, F = 1/s where the spring is shorter

(M50), none for a negative k: k along the line, k (1 - rho) across it where the spring pulls. What is left
out, of a spring that pushes and of points that turn about their joints, is as large as the spring's force
over a length. K is continuous at l = L, its slopes are those of one side there.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..structure import REVOLUTE, Structure, layout
from .kinematics import make_second
from .springs import make_spring

SHARE = 0.5  # of h^2 K that N has beside M, (M50)


@cached
def make_stiff_spring(s: Structure, index: int, dtype: type) -> SimpleNamespace:
    """Warp functions of spring `index`, that add to what they are given: matrix(world, fr, share, total)
    share K; by_q(world, fr, y, share, total) share d(K y)/dq; hessian(world, fr, p, y, share, total) share
    d2(p.K y)/dq dq. shares(e, rest) -> G, F and their slopes by s, first and second.
    """
    spring = make_spring(s, index, dtype)
    t = spring.types
    VQ, MQ, J2, V2 = t.VQ, t.MQ, t.J2, t.V2
    V6 = wp.types.vector(6, dtype)
    NV = s.nv
    ZERO, ONE, TWO, FOUR = dtype(0.0), dtype(1.0), dtype(2.0), dtype(4.0)
    HALF, QUARTER3, THREE_HALVES, QUARTER15 = dtype(0.5), dtype(0.75), dtype(1.5), dtype(3.75)
    lay = layout(s)
    K, L = (lay.offset(f"spring_{n}") + index for n in ("stiffness", "length"))
    a, b = s.springs[index]
    second_a, second_b = make_second(s, a, dtype), make_second(s, b, dtype)
    rev = tuple(kind == REVOLUTE for kind in s.dof_kind)
    chain_a, chain_b = (tuple(s.in_chain(body, j) for j in range(NV)) for body in (a, b))
    apart = spring.apart

    @wp.func
    def shares(e: spring.Span, rest: dtype):
        rho = rest * wp.sqrt(e.inv)
        out = V6()
        if rho < ONE:
            out[0] = ONE - rho
            out[1] = rho * e.inv
            out[2] = HALF * rho * e.inv
            out[3] = -THREE_HALVES * rho * e.inv * e.inv
            out[4] = -QUARTER3 * rho * e.inv * e.inv
            out[5] = QUARTER15 * rho * e.inv * e.inv * e.inv
        else:
            out[1] = e.inv
            out[3] = -e.inv * e.inv
            out[5] = TWO * e.inv * e.inv * e.inv
        return out

    @wp.func
    def turned(ja: J2, jb: J2, x: V2, total: MQ):
        """total + x . the change with q of J_B - J_A, or of what follows from it by the same rule."""
        out = total
        for k in range(wp.static(NV)):
            if wp.static(rev[k]):
                for i in range(wp.static(NV - k)):
                    l = wp.static(k + i)
                    in_a = wp.static(chain_a[k] and chain_a[k + i])
                    in_b = wp.static(chain_b[k] and chain_b[k + i])
                    p = wp.static(spring.across)(ja, jb, l, in_a, in_b)
                    value = x[0] * p[0] + x[1] * p[1]
                    out[k, l] = out[k, l] + value
                    if wp.static(i > 0):
                        out[l, k] = out[l, k] + value
        return out

    @wp.func
    def span(world: t.World, fr: t.FRAMES):
        """Span, G, F and slopes; D; k."""
        e = wp.static(spring.span)(world, fr, VQ(), ZERO)
        k = wp.max(world.params[wp.static(K)], ZERO)
        return e, shares(e, world.params[wp.static(L)]), e.jb - e.ja, k

    @wp.func
    def matrix(world: t.World, fr: t.FRAMES, share: dtype, total: MQ):
        e, g, d, k = span(world, fr)
        return total + (share * k) * (g[0] * (wp.transpose(d) * d) + g[1] * wp.outer(e.a, e.a))

    @wp.func
    def by_q(world: t.World, fr: t.FRAMES, y: VQ, share: dtype, total: MQ):
        e, g, d, k = span(world, fr)
        dy = d * y
        ay = wp.dot(e.a, y)
        sa = wp.static(second_a)(e.ja, y)
        sb = wp.static(second_b)(e.jb, y)
        out = g[0] * (wp.transpose(d) * (sb - sa)) + (g[1] * ay) * wp.static(spring.second)(e)
        out += g[1] * wp.outer(e.a, wp.static(spring.bend)(e, y))
        out += TWO * wp.outer(g[2] * (wp.transpose(d) * dy) + (g[3] * ay) * e.a, e.a)
        out = turned(e.ja, e.jb, g[0] * dy, out)
        for m in range(wp.static(NV)):
            for j in range(wp.static(NV)):
                if wp.static(not apart[m]):
                    out[j, m] = ZERO
        return total + (share * k) * out

    @wp.func
    def hessian(world: t.World, fr: t.FRAMES, p: VQ, y: VQ, share: dtype, total: MQ):
        # of k (G P + F Q), P = D p . D y, Q = (a.p) (a.y)
        e, g, d, k = span(world, fr)
        dp, dy = d * p, d * y
        ap, ay = wp.dot(e.a, p), wp.dot(e.a, y)
        pa, pb = wp.static(second_a)(e.ja, p), wp.static(second_b)(e.jb, p)
        ya, yb = wp.static(second_a)(e.ja, y), wp.static(second_b)(e.jb, y)
        hp, hy = wp.static(spring.bend)(e, p), wp.static(spring.bend)(e, y)
        both = wp.dot(dp, dy)
        cross = wp.transpose(pb - pa) * (yb - ya)
        out = g[0] * turned(pa, pb, dy, turned(ya, yb, dp, cross + wp.transpose(cross)))
        cross = wp.outer(hp, hy)
        bend = cross + wp.transpose(cross)
        bend += ay * wp.static(spring.third)(e, p) + ap * wp.static(spring.third)(e, y)
        out += g[1] * bend
        slope = wp.transpose(pb - pa) * dy + wp.transpose(yb - ya) * dp
        cross = wp.outer(TWO * (g[2] * slope + g[3] * (ay * hp + ap * hy)), e.a)
        out += cross + wp.transpose(cross)
        out += (TWO * (g[2] * both + g[3] * ap * ay)) * wp.static(spring.second)(e)
        out += (FOUR * (g[4] * both + g[5] * ap * ay)) * wp.outer(e.a, e.a)
        for m in range(wp.static(NV)):
            for j in range(wp.static(NV)):
                if wp.static(not (apart[j] and apart[m])):
                    out[j, m] = ZERO
        return total + (share * k) * out

    return SimpleNamespace(types=t, spring=spring, matrix=matrix, by_q=by_q, hessian=hessian, shares=shares)
