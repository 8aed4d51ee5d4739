"""How a contact pair's rows answer to displacements and radii of its shapes, for gradients by parameters.

A pair adds G = gap d + J_n.y_n + J_t.y_t to the scalar whose derivative is wanted. With V(y) the velocity of
B's centre against A's under joint rates y and Omega(y) a body's rate of turning,
J_n.y = n.V + h_A' Omega_A + h_B' Omega_B and J_t.y = t.V - h_A Omega_A - h_B Omega_B (`rows.py`). With R as
in `kernels/contact/derivatives.py` the normal turns by R delta(alpha) = t.delta(Delta) + h_A'' delta(psi_A)
+ h_B'' delta(psi_B) - delta(h_A' + h_B'), the last at a fixed direction; that of a half-plane, or of a
shape touched beside one of its sides, turns with it. The end of a capsule, or the corner of a rectangle, is a
disc that its size moves.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.derivatives import make_pair_derivatives
from ..contact.shapes import make_pair, oriented_ends, oriented_pair
from ..factories import cached
from ..mechanism.dynamics import make_mechanism
from ..structure import CAPSULE, CORNERS, DISC, ELLIPSE, RECTANGLE, RING, Structure, layout


@cached
def make_answer(dtype: type) -> SimpleNamespace:
    """Answer: derivatives of a pair's G by what its shapes may do. flat and round give it at a normal n, with
    Delta, supports (h, h', h''), y's velocities and dG/dalpha at fixed places; of a half-plane or what is
    touched beside a side, and of round shapes; mean that of two, by an end. by_radii gives a shape's.
    """
    V2, V3, V4 = (wp.types.vector(n, dtype) for n in (2, 3, 4))
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)

    @wp.struct
    class Answer:
        shift: V2  # by delta(Delta), the centre of B against that of A
        turn_a: dtype  # by an angle psi of A, of B
        turn_b: dtype
        support_a: V2  # by the support function and its derivative, (h, h')
        support_b: V2
        by_friction: dtype  # J_t.(change of y_t by the friction coefficient)

    @wp.func
    def flat(
        n: V2, delta: V2, ha: V4, hb: V4, gap: dtype, alpha: dtype, an: dtype, bn: dtype, at: dtype, bt: dtype
    ):
        # the normal turns with A, whose h_A is constant and h_A' the lever of the touched point
        out = Answer()
        lever = bn - an  # weight of h_B'
        turning = alpha + lever * hb[2] - an * wp.dot(n, delta)
        out.shift = gap * n + an * V2(-n[1], n[0])
        out.turn_a = gap * ha[1] + turning
        out.turn_b = gap * hb[1] - lever * hb[2] + bt * hb[1]
        out.support_a = V2(-gap - at, ZERO)
        out.support_b = V2(-gap - bt, lever)
        return out

    @wp.func
    def round(
        n: V2,
        ha: V4,
        hb: V4,
        radius: dtype,
        gap: dtype,
        alpha: dtype,
        an: dtype,
        bn: dtype,
        at: dtype,
        bt: dtype,
    ):
        out = Answer()
        share = (alpha + an * ha[2] + bn * hb[2] - at * ha[1]) / radius
        out.shift = gap * n + share * V2(-n[1], n[0])
        out.turn_a = gap * ha[1] + share * ha[2] - an * ha[2] + at * ha[1]
        out.turn_b = gap * hb[1] + share * hb[2] - bn * hb[2] + bt * hb[1]
        out.support_a = V2(-gap - at, an - share)
        out.support_b = V2(-gap - bt, bn - share)
        return out

    @wp.func
    def mean(one: Answer, two: Answer):
        out = Answer()
        out.shift = HALF * (one.shift + two.shift)
        out.turn_a = HALF * (one.turn_a + two.turn_a)
        out.turn_b = HALF * (one.turn_b + two.turn_b)
        out.support_a = HALF * (one.support_a + two.support_a)
        out.support_b = HALF * (one.support_b + two.support_b)
        return out

    @wp.func
    def of_capsule(c: dtype, slope: dtype, by: V2):
        # by the half length, h = r + L |c|
        return wp.where(c < ZERO, -by[0] * c - by[1] * slope, by[0] * c + by[1] * slope)

    @wp.func
    def of_rectangle(c: dtype, sn: dtype, by: V2):
        # by the half sizes and the corner radius, h = r + (A - r) |c| + (B - r) |s|
        sx = wp.where(c < ZERO, -ONE, ONE)
        sy = wp.where(sn < ZERO, -ONE, ONE)
        width = sx * (by[0] * c - by[1] * sn)
        height = sy * (by[0] * sn + by[1] * c)
        return V3(width, height, by[0] - width - height)

    @wp.func
    def of_ellipse(a: dtype, b: dtype, c: dtype, sn: dtype):
        # h and h' by a, then by b: h = sqrt(a^2 c^2 + b^2 s^2), h' = (b^2 - a^2) c s/h at c e1 + s e2
        inverse = ONE / wp.sqrt(a * a * c * c + b * b * sn * sn)
        slope = (b * b - a * a) * c * sn * inverse
        ha = a * c * c * inverse
        hb = b * sn * sn * inverse
        da = -(a + a) * c * sn * inverse - slope * ha * inverse
        db = (b + b) * c * sn * inverse - slope * hb * inverse
        return V4(ha, da, hb, db)

    return SimpleNamespace(
        Answer=Answer,
        flat=flat,
        round=round,
        mean=mean,
        of_capsule=of_capsule,
        of_ellipse=of_ellipse,
        of_rectangle=of_rectangle,
    )


@cached
def make_pair_answer(s: Structure, pair: int, dtype: type) -> SimpleNamespace:
    """answer(g, gap, y_n, y_t, y_mu) -> Answer at the geometry g of `make_pair_derivatives`;
    radii(world, fr, g, answer, grad) adds the gradient by the radii.
    """
    mech = make_mechanism(s, dtype)
    t = mech.types
    p = make_pair(s, pair, dtype)
    d = make_pair_derivatives(s, pair, dtype)
    of = make_answer(dtype)
    Answer = of.Answer
    lay = layout(s)
    V2, V4, VQ = t.V2, wp.types.vector(4, dtype), t.VQ
    (shape_a, shape_b), (end_a, end_b) = oriented_pair(s, pair), oriented_ends(s, pair)
    plane = p.plane
    RADIUS = lay.offset("radius")
    TURN_A, TURN_B = (
        VQ(*(dtype(float(s.turns(body, j))) for j in range(s.nv))) for body in (p.body_a, p.body_b)
    )

    @wp.func
    def flat_answer(g: d.PairGeometry, gap: dtype, alpha: dtype, an: dtype, bn: dtype, at: dtype, bt: dtype):
        return of.flat(g.n, g.delta, g.ha, g.hb, gap, alpha, an, bn, at, bt)

    @wp.func
    def round_answer(g: d.PairGeometry, gap: dtype, alpha: dtype, an: dtype, bn: dtype, at: dtype, bt: dtype):
        return of.round(g.n, g.ha, g.hb, g.radius, gap, alpha, an, bn, at, bt)

    @wp.func
    def answer(g: d.PairGeometry, gap: dtype, yn: VQ, yt: VQ, ymu: VQ):
        out = Answer()
        n = g.n
        tangent = V2(-n[1], n[0])
        vn = g.jb * yn - g.ja * yn
        vt = g.jb * yt - g.ja * yt
        an = wp.dot(wp.static(TURN_A), yn)
        bn = wp.dot(wp.static(TURN_B), yn)
        at = wp.dot(wp.static(TURN_A), yt)
        bt = wp.dot(wp.static(TURN_B), yt)
        alpha = wp.dot(tangent, vn) - wp.dot(n, vt) - bt * g.hb[1]  # dG/dalpha at fixed places
        if wp.static(plane):
            out = flat_answer(g, gap, alpha, an, bn, at, bt)
        elif wp.static(p.sided):
            if g.flat != 1:
                out = round_answer(g, gap, alpha, an, bn, at, bt)
            if g.flat == 1:
                out = flat_answer(g, gap, alpha, an, bn, at, bt)
            if g.flat == 2:
                out = of.mean(out, flat_answer(g, gap, alpha, an, bn, at, bt))
        else:
            out = round_answer(g, gap, alpha, an, bn, at, bt)
        vm = g.jb * ymu - g.ja * ymu
        out.by_friction = wp.dot(tangent, vm)
        out.by_friction -= g.ha[0] * wp.dot(wp.static(TURN_A), ymu)
        out.by_friction -= g.hb[0] * wp.dot(wp.static(TURN_B), ymu)
        return out

    def make_radius(shape: int, end: int) -> wp.Function:
        FIRST = RADIUS + 2 * shape
        kind = DISC if end else s.shapes[shape].kind
        CORNER = lay.offset("corner_radius") + shape if RECTANGLE in (kind, s.shapes[shape].kind) else FIRST
        DISC_RADIUS = CORNER if end in CORNERS else FIRST
        disc, capsule = kind == DISC, kind == CAPSULE

        @wp.func
        def radius(world: t.World, pose: V4, n: V2, by: V2, flat: int, grad: wp.array(dtype=dtype)):
            c = n[0] * pose[2] + n[1] * pose[3]
            if wp.static(disc or capsule):
                grad[wp.static(DISC_RADIUS)] = grad[wp.static(DISC_RADIUS)] + by[0]
            if wp.static(kind == RING):
                grad[wp.static(FIRST)] = grad[wp.static(FIRST)] - by[0]
            if wp.static(kind == RECTANGLE):
                size = of.of_rectangle(c, n[1] * pose[2] - n[0] * pose[3], by)
                grad[wp.static(FIRST)] = grad[wp.static(FIRST)] + size[0]
                grad[wp.static(FIRST + 1)] = grad[wp.static(FIRST + 1)] + size[1]
                grad[wp.static(CORNER)] = grad[wp.static(CORNER)] + size[2]
            if wp.static(capsule):
                if flat == 0:
                    value = of.of_capsule(c, n[0] * pose[3] - n[1] * pose[2], by)
                    grad[wp.static(FIRST + 1)] = grad[wp.static(FIRST + 1)] + value
            elif wp.static(kind == ELLIPSE):
                a = world.params[wp.static(FIRST)]
                b = world.params[wp.static(FIRST + 1)]
                e = of.of_ellipse(a, b, c, n[1] * pose[2] - n[0] * pose[3])
                grad[wp.static(FIRST)] = grad[wp.static(FIRST)] + by[0] * e[0] + by[1] * e[1]
                grad[wp.static(FIRST + 1)] = grad[wp.static(FIRST + 1)] + by[0] * e[2] + by[1] * e[3]

        return radius

    radius_a, radius_b = make_radius(shape_a, end_a), make_radius(shape_b, end_b)

    @wp.func
    def radii(world: t.World, fr: t.FRAMES, g: d.PairGeometry, out: Answer, grad: wp.array(dtype=dtype)):
        """Adds the derivatives of G by the radii of both shapes to their columns."""
        radius_a(world, wp.static(p.pose_a)(world, fr), g.n, out.support_a, g.flat, grad)
        radius_b(world, wp.static(p.pose_b)(world, fr), g.n, out.support_b, 0, grad)

    return SimpleNamespace(
        Answer=Answer, geometry=d.geometry, PairGeometry=d.PairGeometry, answer=answer, radii=radii
    )
