"""Rows of the complementarity problem: J, d/h and the scale D, with contacts that cannot act left out.

J_n = n.(J_pB - J_pA) and J_t = t.(J_pB - J_pA) at each body's own support point (M6); a frictional contact is
the two rows J_n +- mu J_t with the same gap (Anitescu's relaxation (M7), the paper's [9]). In the vectors N =
(n, h_A', h_B') and E = (t, -h_A, -h_B): J_n = n.Delta_j + h_A' phiA_j + h_B' phiB_j, J_t = t.Delta_j - h_A
phiA_j - h_B phiB_j, where Delta = dc_B/dq - dc_A/dq and phi_j tells whether degree of freedom j turns the
body. One that moves both bodies moves them as one: J_n = 0, and J_t = d where it turns them.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..mechanism.dynamics import make_mechanism
from ..specialisation import Specialisation
from ..structure import Structure, layout
from .shapes import make_pair


@cached
def make_pair_jacobian(s: Structure, pair: int, dtype: type) -> wp.Function:
    """(world, frames, GEO) -> rows (J_n, J_t) of one pair, (2, nv)."""
    mech = make_mechanism(s, dtype)
    t = mech.types
    p = make_pair(s, pair, dtype)
    GEO = wp.types.vector(8, dtype)
    jac_a, jac_b = mech.point_jacobian(p.body_a), mech.point_jacobian(p.body_b)

    @wp.func
    def pair_jacobian(world: t.World, fr: t.FRAMES, g: GEO):
        ca = wp.static(p.pose_a)(world, fr)
        cb = wp.static(p.pose_b)(world, fr)
        ja = wp.static(jac_a)(world, fr, ca[0], ca[1])
        jb = wp.static(jac_b)(world, fr, cb[0], cb[1])
        out = t.J2()
        for j in range(wp.static(s.nv)):
            if wp.static(s.in_chain(p.body_a, j) and s.in_chain(p.body_b, j)):
                # what carries both moves them as one: rounding must not leave it a part of the impulse
                if wp.static(s.turns(p.body_a, j)):
                    out[1, j] = g[2]
            else:
                dx = jb[0, j] - ja[0, j]
                dy = jb[1, j] - ja[1, j]
                normal = g[0] * dx + g[1] * dy
                tangent = g[0] * dy - g[1] * dx
                if wp.static(s.turns(p.body_a, j)):
                    normal += g[4]
                    tangent -= g[3]
                if wp.static(s.turns(p.body_b, j)):
                    normal += g[6]
                    tangent -= g[5]
                out[0, j] = normal
                out[1, j] = tangent
        return out

    return pair_jacobian


@cached
def make_rows(spec: Specialisation) -> SimpleNamespace:
    """Warp functions on the set of rows.

    A row's Jacobian is stored for contacts only: those of limits are unit vectors.
    """
    s, dtype, method = spec
    mech = make_mechanism(s, dtype)
    t = mech.types
    lay = layout(s)
    VQ, MQ, VR, JR = t.VQ, t.MQ, t.VR, t.JR
    ONE = dtype(1.0)
    FLOOR = dtype(1e-30)
    rows = s.rows
    limit = tuple(r.kind == "limit" for r in rows)
    tangent = tuple(method.coulomb and r.kind == "contact" and r.sign < 0 for r in rows)
    index = tuple(r.index for r in rows)
    sign = tuple(dtype(float(r.sign)) for r in rows)
    LOWER, UPPER, H, FRICTION = (lay.offset(n) for n in ("lower", "upper", "step_size", "friction"))
    NR, NV = s.nr, s.nv

    def make_dot(i: int) -> wp.Function:
        @wp.func
        def dot(jac: JR, x: VQ):
            """J_i . x"""
            if wp.static(limit[i]):
                return wp.static(sign[i]) * x[wp.static(index[i] if limit[i] else 0)]
            return wp.dot(jac[wp.static(i)], x)

        return dot

    def make_apply(i: int) -> wp.Function:
        @wp.func
        def apply(p: MQ, jac: JR):
            """P J_i' for a symmetric P"""
            if wp.static(limit[i]):
                return wp.static(sign[i]) * p[wp.static(index[i] if limit[i] else 0)]
            return p * jac[wp.static(i)]

        return apply

    def make_add(i: int) -> wp.Function:
        @wp.func
        def add(f: VQ, jac: JR, scale: dtype):
            """f + J_i' scale"""
            if wp.static(limit[i]):
                out = f
                out[wp.static(index[i] if limit[i] else 0)] = (
                    out[wp.static(index[i] if limit[i] else 0)] + wp.static(sign[i]) * scale
                )
                return out
            return f + scale * jac[wp.static(i)]

        return add

    dots = tuple(make_dot(i) for i in range(NR))
    applies = tuple(make_apply(i) for i in range(NR))
    adds = tuple(make_add(i) for i in range(NR))

    @wp.func
    def limit_rates(world: t.World, q: VQ):
        """d/h of the limit rows (contact rows zero)."""
        out = VR()
        for i in range(wp.static(NR)):
            if wp.static(limit[i] and rows[i].sign > 0):
                out[i] = (
                    q[wp.static(index[i] if limit[i] else 0)] - world.params[wp.static(LOWER + index[i])]
                ) / world.params[wp.static(H)]
            if wp.static(limit[i] and rows[i].sign < 0):
                out[i] = (
                    world.params[wp.static(UPPER + index[i])] - q[wp.static(index[i] if limit[i] else 0)]
                ) / world.params[wp.static(H)]
        return out

    twice = tuple(j for j in range(NV) if sum(limit[i] and index[i] == j for i in range(NR)) == 2)

    @wp.func
    def excluded(world: t.World):
        """Whether a degree of freedom has limits that exclude each other: no velocity opens both, however
        little they cross.
        """
        out = bool(False)
        for j in range(wp.static(NV)):
            if wp.static(j in twice):
                out = out or (world.params[wp.static(LOWER + j)] > world.params[wp.static(UPPER + j)])
        return out

    def make_put_pair(pair: int) -> wp.Function:
        @wp.func
        def put_pair(world: t.World, pj: t.J2, jac: JR):
            """Store the rows of one pair: J_n +- mu J_t, or J_n alone; (J_n, J_t) for Coulomb's friction."""
            out = jac
            for i in range(wp.static(NR)):
                if wp.static(not limit[i] and index[i] == pair):
                    for j in range(wp.static(NV)):
                        if wp.static(rows[i].sign == 0 or (method.coulomb and not tangent[i])):
                            out[i, j] = pj[0, j]
                        elif wp.static(tangent[i]):
                            out[i, j] = pj[1, j]
                        else:
                            out[i, j] = (
                                pj[0, j]
                                + wp.static(sign[i]) * world.params[wp.static(FRICTION + pair)] * pj[1, j]
                            )
            return out

        return put_pair

    @wp.func
    def scale(minv: MQ, jac: JR, mask: int):
        """D of the active rows: diag(A) (2a) with inertia scaling, 1 without."""
        out = VR()
        for i in range(wp.static(NR)):
            out[i] = ONE
            if wp.static(method.inertia_scaling):
                if (mask & wp.static(1 << i)) != 0:
                    out[i] = wp.max(wp.static(dots[i])(jac, wp.static(applies[i])(minv, jac)), FLOOR)
        return out

    return SimpleNamespace(
        types=t,
        dots=dots,
        applies=applies,
        adds=adds,
        limit=limit,
        tangent=tangent,
        limit_rates=limit_rates,
        excluded=excluded if twice else None,
        put_pairs=tuple(make_put_pair(k) for k in range(len(s.pairs))),
        scale=scale,
    )


@cached
def make_speed(s: Structure, pair: int, dtype: type) -> wp.Function:
    """Bound on |(J_n +- mu J_t) v| of a pair.

    It is the speed of the centres plus the rate of turning times the largest radius.
    """
    mech = make_mechanism(s, dtype)
    t = mech.types
    p = make_pair(s, pair, dtype)
    lay = layout(s)
    a, b = s.pairs[pair].shape_a, s.pairs[pair].shape_b
    RADIUS, FRICTION = lay.offset("radius"), lay.offset("friction")
    jac_a, jac_b = mech.point_jacobian(p.body_a), mech.point_jacobian(p.body_b)
    ONE, ZERO = dtype(1.0), dtype(0.0)

    body_a, body_b = s.shapes[a].body, s.shapes[b].body

    @wp.func
    def speed(world: t.World, fr: t.FRAMES, v: t.VQ):
        ca = wp.static(p.pose_a)(world, fr)
        cb = wp.static(p.pose_b)(world, fr)
        ja = wp.static(jac_a)(world, fr, ca[0], ca[1])
        jb = wp.static(jac_b)(world, fr, cb[0], cb[1])
        dx = ZERO
        dy = ZERO
        wa = ZERO
        wb = ZERO
        for j in range(wp.static(s.nv)):
            dx += (jb[0, j] - ja[0, j]) * v[j]
            dy += (jb[1, j] - ja[1, j]) * v[j]
            if wp.static(s.turns(body_a, j)):
                wa += v[j]
            if wp.static(s.turns(body_b, j)):
                wb += v[j]
        ra = wp.max(world.params[wp.static(RADIUS + 2 * a)], world.params[wp.static(RADIUS + 2 * a + 1)])
        rb = wp.max(world.params[wp.static(RADIUS + 2 * b)], world.params[wp.static(RADIUS + 2 * b + 1)])
        mu = world.params[wp.static(FRICTION + pair)]
        return wp.sqrt(ONE + mu * mu) * (wp.sqrt(dx * dx + dy * dy) + wp.abs(wa) * ra + wp.abs(wb) * rb)

    return speed
