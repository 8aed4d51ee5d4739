"""Derivatives of a contact pair's rows J_n, J_t with respect to q.

The normal's angle alpha follows q by the implicit function theorem (M28): with R = n.Delta + h_A'' + h_B''
(minus the curvature of the distance), alpha_k = (t.Delta_k + h_A'' phiA_k + h_B'' phiB_k)/R. For a half-plane
A the normal turns with its body, alpha_k = phiA_k, and h_A' is the lever of the touched point; so it is for a
capsule or a rectangle A that is touched beside a side. By an end, where the curvature jumps as for a box on
another with the same sides, derivatives are the mean of both: that of what goes on to one side for each that
goes to the other.
"""

from types import SimpleNamespace
from typing import Any

import warp as wp

from ..factories import cached
from ..mechanism.dynamics import make_mechanism
from ..mechanism.kinematics import make_second
from ..structure import REVOLUTE, Structure
from .distance import CENTRE
from .shapes import make_pair


@cached
def make_pair_geometry(s: Structure, dtype: type) -> Any:
    """Struct of one pair's geometry, the same type for all pairs."""
    t = make_mechanism(s, dtype).types
    VQ, J2, V2 = t.VQ, t.J2, t.V2
    V4 = wp.types.vector(4, dtype)

    @wp.struct
    class PairGeometry:
        n: V2
        delta: V2  # c_B - c_A
        ja: J2  # Jacobians of the centres
        jb: J2
        ha: V4  # h_A and its derivatives by the angle
        hb: V4
        radius: dtype  # R, kept away from zero
        flat: int  # 1: A is a half-plane, or touched beside one of its sides; 2: by an end of one
        alpha: VQ  # d alpha/dq
        da: VQ  # d h_A'/dq
        db: VQ  # d h_B'/dq

    return PairGeometry


@cached
def make_pair_derivatives(s: Structure, pair: int, dtype: type) -> SimpleNamespace:
    """Warp functions of one pair; `geometry` gathers what the others need at a normal n."""
    mech = make_mechanism(s, dtype)
    t = mech.types
    p = make_pair(s, pair, dtype)
    VQ, MQ, J2, V2 = t.VQ, t.MQ, t.J2, t.V2
    V3, V4 = wp.types.vector(3, dtype), wp.types.vector(4, dtype)
    NV = s.nv
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    EPS, NOWHERE = dtype(1e-12 if dtype is wp.float64 else 1e-6), dtype(CENTRE)
    a, b, plane = p.body_a, p.body_b, p.plane
    jac_a, jac_b = mech.point_jacobian(a), mech.point_jacobian(b)
    second_a, second_b = make_second(s, a, dtype), make_second(s, b, dtype)
    turn_a = tuple(dtype(float(s.turns(a, j))) for j in range(NV))
    turn_b = tuple(dtype(float(s.turns(b, j))) for j in range(NV))
    TURN_A, TURN_B = VQ(*turn_a), VQ(*turn_b)
    rev = tuple(kind == REVOLUTE for kind in s.dof_kind)
    chain_a = tuple(s.in_chain(a, j) for j in range(NV))
    chain_b = tuple(s.in_chain(b, j) for j in range(NV))

    PairGeometry = make_pair_geometry(s, dtype)

    @wp.func
    def flat_normal(g: PairGeometry, along: dtype, turn_a: dtype, turn_b: dtype):
        # d/dq_k of alpha, h_A', h_B'
        db = g.hb[2] * (turn_a - turn_b)
        return V3(turn_a, along - wp.dot(g.n, g.delta) * turn_a - db, db)

    @wp.func
    def round_normal(g: PairGeometry, along: dtype, turn_a: dtype, turn_b: dtype):
        alpha = (along + g.ha[2] * turn_a + g.hb[2] * turn_b) / g.radius
        return V3(alpha, g.ha[2] * (alpha - turn_a), g.hb[2] * (alpha - turn_b))

    @wp.func
    def normal_by_q(g: PairGeometry, along: dtype, turn_a: dtype, turn_b: dtype):
        if wp.static(plane):
            return flat_normal(g, along, turn_a, turn_b)
        if wp.static(p.sided):
            if g.flat == 2:
                beside = flat_normal(g, along, turn_a, turn_b)
                return HALF * (beside + round_normal(g, along, turn_a, turn_b))
            if g.flat == 1:
                return flat_normal(g, along, turn_a, turn_b)
        return round_normal(g, along, turn_a, turn_b)

    @wp.func
    def geometry(world: t.World, fr: t.FRAMES, n: V2):
        """What the derivatives need, at the solved normal."""
        g = PairGeometry()
        pa = wp.static(p.pose_a)(world, fr)
        pb = wp.static(p.pose_b)(world, fr)
        g.n = n
        g.delta = V2(pb[0] - pa[0], pb[1] - pa[1])
        g.ja = wp.static(jac_a)(world, fr, pa[0], pa[1])
        g.jb = wp.static(jac_b)(world, fr, pb[0], pb[1])
        g.hb = wp.static(p.support_b)(world, pb, n)
        g.radius = ONE
        if wp.static(plane):
            g.flat = 1
        else:
            g.ha = wp.static(p.support_a)(world, pa, n)
            if wp.static(p.sided):
                g.flat = wp.static(p.flat)(world, pa, pb)
            reach = wp.dot(n, g.delta)
            radius = reach + g.ha[2] + g.hb[2]
            floor = EPS * (wp.abs(g.ha[0]) + wp.abs(g.hb[0]) + wp.abs(reach)) + EPS
            if wp.static(p.hollow):
                floor = wp.where(wp.abs(radius) > floor, floor, NOWHERE)
            g.radius = wp.where(wp.abs(radius) > floor, radius, floor)
        if wp.static(plane or p.sided):
            if g.flat > 0:
                g.ha[1] = n[0] * g.delta[1] - n[1] * g.delta[0] - g.hb[1]
            if g.flat == 1:
                g.ha = V4(g.ha[0], g.ha[1], ZERO, ZERO)
        for k in range(wp.static(NV)):
            along = n[0] * (g.jb[1, k] - g.ja[1, k]) - n[1] * (g.jb[0, k] - g.ja[0, k])
            change = normal_by_q(g, along, wp.static(turn_a[k]), wp.static(turn_b[k]))
            g.alpha[k] = change[0]
            g.da[k] = change[1]
            g.db[k] = change[2]
        return g

    @wp.func
    def contract(g: PairGeometry, y: VQ):
        """d/dq_k of J_n.y (row 0) and J_t.y (row 1) at constant y."""
        out = J2()
        dy = g.jb * y - g.ja * y
        sa = wp.static(second_a)(g.ja, y)
        sb = wp.static(second_b)(g.jb, y)
        ta = wp.dot(wp.static(TURN_A), y)
        tb = wp.dot(wp.static(TURN_B), y)
        normal = g.n[0] * dy[0] + g.n[1] * dy[1]
        tangent = g.n[0] * dy[1] - g.n[1] * dy[0]
        for k in range(wp.static(NV)):
            x = sb[0, k] - sa[0, k]
            z = sb[1, k] - sa[1, k]
            ua = g.alpha[k] - wp.static(turn_a[k])
            ub = g.alpha[k] - wp.static(turn_b[k])
            out[0, k] = g.n[0] * x + g.n[1] * z + tangent * g.alpha[k] + g.da[k] * ta + g.db[k] * tb
            out[1, k] = g.n[0] * z - g.n[1] * x - normal * g.alpha[k] - g.ha[1] * ua * ta - g.hb[1] * ub * tb
        return out

    @wp.func
    def force_by_q(g: PairGeometry, fn: dtype, ft: dtype):
        """d/dq_k of (fn J_n + ft J_t)_j, (j, k)."""
        out = MQ()
        for k in range(wp.static(NV)):
            ua = g.alpha[k] - wp.static(turn_a[k])
            ub = g.alpha[k] - wp.static(turn_b[k])
            for j in range(wp.static(NV)):
                dx = g.jb[0, j] - g.ja[0, j]
                dy = g.jb[1, j] - g.ja[1, j]
                normal = (g.n[0] * dy - g.n[1] * dx) * g.alpha[k]
                tangent = -(g.n[0] * dx + g.n[1] * dy) * g.alpha[k]
                normal += g.da[k] * wp.static(turn_a[j]) + g.db[k] * wp.static(turn_b[j])
                tangent -= g.ha[1] * ua * wp.static(turn_a[j]) + g.hb[1] * ub * wp.static(turn_b[j])
                if wp.static(rev[min(j, k)] and chain_a[j] and chain_a[k]):
                    normal -= g.n[1] * g.ja[0, wp.static(max(j, k))] - g.n[0] * g.ja[1, wp.static(max(j, k))]
                    tangent -= g.n[0] * g.ja[0, wp.static(max(j, k))] + g.n[1] * g.ja[1, wp.static(max(j, k))]
                if wp.static(rev[min(j, k)] and chain_b[j] and chain_b[k]):
                    normal += g.n[1] * g.jb[0, wp.static(max(j, k))] - g.n[0] * g.jb[1, wp.static(max(j, k))]
                    tangent += g.n[0] * g.jb[0, wp.static(max(j, k))] + g.n[1] * g.jb[1, wp.static(max(j, k))]
                out[j, k] = fn * normal + ft * tangent
        return out

    @wp.func
    def normal_by_qq(g: PairGeometry, rest: dtype, turning: dtype):
        # second derivatives of alpha and h_A'
        akl = (rest - g.ha[3] * turning) / g.radius
        hakl = g.ha[3] * turning + g.ha[2] * akl
        if wp.static(plane or p.sided):
            if g.flat == 2:
                akl = HALF * akl
                hakl = HALF * (hakl + rest)
            if g.flat == 1:
                akl = ZERO
                hakl = rest
        return akl, hakl

    @wp.func
    def hessian(g: PairGeometry, y: VQ, fn: dtype, ft: dtype):
        """d2/dq_k dq_l of fn J_n.y + ft J_t.y at constant y."""
        out = MQ()
        dy = g.jb * y - g.ja * y
        sa = wp.static(second_a)(g.ja, y)
        sb = wp.static(second_b)(g.jb, y)
        ta = wp.dot(wp.static(TURN_A), y)
        tb = wp.dot(wp.static(TURN_B), y)
        n = g.n
        lever = n[0] * g.delta[1] - n[1] * g.delta[0]
        normal = n[0] * dy[0] + n[1] * dy[1]
        tangent = n[0] * dy[1] - n[1] * dy[0]
        for k in range(wp.static(NV)):
            for i in range(wp.static(NV - k)):
                l = wp.static(k + i)
                ak = g.alpha[k]
                al = g.alpha[l]
                uak = ak - wp.static(turn_a[k])
                ual = al - wp.static(turn_a[k + i])
                ubk = ak - wp.static(turn_b[k])
                ubl = al - wp.static(turn_b[k + i])
                # second and third derivatives of Delta: one more shallow index turns by 90 degrees
                px = ZERO
                py = ZERO
                qx = ZERO
                qy = ZERO
                if wp.static(rev[k] and chain_a[k] and chain_a[k + i]):
                    px += g.ja[1, l]
                    py -= g.ja[0, l]
                    qx += sa[1, l]
                    qy -= sa[0, l]
                if wp.static(rev[k] and chain_b[k] and chain_b[k + i]):
                    px -= g.jb[1, l]
                    py += g.jb[0, l]
                    qx -= sb[1, l]
                    qy += sb[0, l]
                dkx = g.jb[0, k] - g.ja[0, k]
                dky = g.jb[1, k] - g.ja[1, k]
                dlx = g.jb[0, l] - g.ja[0, l]
                dly = g.jb[1, l] - g.ja[1, l]
                cross = n[0] * (dlx * ak + dkx * al) + n[1] * (dly * ak + dky * al)
                along = n[0] * py - n[1] * px
                akl, hakl = normal_by_qq(g, along - cross - lever * ak * al - g.hb[3] * ubk * ubl, uak * ual)
                hbkl = g.hb[3] * ubk * ubl + g.hb[2] * akl
                # Delta_y differentiated by k and by l
                ykx = sb[0, k] - sa[0, k]
                yky = sb[1, k] - sa[1, k]
                ylx = sb[0, l] - sa[0, l]
                yly = sb[1, l] - sa[1, l]
                tk = n[0] * yky - n[1] * ykx
                tl = n[0] * yly - n[1] * ylx
                nk = n[0] * ykx + n[1] * yky
                nl = n[0] * ylx + n[1] * yly
                d2n = n[0] * qx + n[1] * qy + tk * al + tl * ak + tangent * akl - normal * ak * al
                d2n += hakl * ta + hbkl * tb
                d2t = n[0] * qy - n[1] * qx - nk * al - nl * ak - normal * akl - tangent * ak * al
                d2t -= (g.ha[2] * uak * ual + g.ha[1] * akl) * ta + (g.hb[2] * ubk * ubl + g.hb[1] * akl) * tb
                out[k, l] = fn * d2n + ft * d2t
                out[l, k] = out[k, l]
        return out

    return SimpleNamespace(
        PairGeometry=PairGeometry,
        geometry=geometry,
        contract=contract,
        force_by_q=force_by_q,
        hessian=hessian,
    )
