"""How fast the surfaces of a pair can approach each other, to leave out pairs that cannot touch in a step."""

import functools

import warp as wp

from .mechanism import make_mechanism
from .shapes import make_pair
from .structure import Structure, layout


@functools.cache
def make_speed(s: Structure, pair: int, dtype: type) -> wp.Function:
    """Bound on |(J_n +- mu J_t) v| of a pair: speed of the centres plus rate of turning times largest
    radius.
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
    def speed(params: wp.array2d(dtype=dtype), row: int, fr: t.FRAMES, v: t.VQ):
        ca = wp.static(p.pose_a)(params, row, fr)
        cb = wp.static(p.pose_b)(params, row, fr)
        ja = wp.static(jac_a)(params, row, fr, ca[0], ca[1])
        jb = wp.static(jac_b)(params, row, fr, cb[0], cb[1])
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
        ra = wp.max(params[row, wp.static(RADIUS + 2 * a)], params[row, wp.static(RADIUS + 2 * a + 1)])
        rb = wp.max(params[row, wp.static(RADIUS + 2 * b)], params[row, wp.static(RADIUS + 2 * b + 1)])
        mu = params[row, wp.static(FRICTION + pair)]
        return wp.sqrt(ONE + mu * mu) * (wp.sqrt(dx * dx + dy * dy) + wp.abs(wa) * ra + wp.abs(wb) * rb)

    return speed
