"""A contact pair at its solved normal, and how a scalar of its rows answers to all that moves its shapes.

The pair adds G = gap d + J_n.y_n + J_t.y_t, each y a weighted sum of joint rates, see `gradients/contact.py`.
"""

from types import SimpleNamespace

import warp as wp

from ...contact.sided import make_core
from ...factories import cached
from ...generic.contact import make_contact
from ...generic.derivatives.touched import Touch, make_touched
from ...generic.topology import BLOCK, HOLLOW, LONG, PLANE, ROUND, RUNS_A, RUNS_B, Topology
from ...generic.work import Slot
from ...structure import WORLD
from ..contact import make_answer
from .room import View
from .twists import make_twists, perp

V2, V4 = wp.types.vector(2, wp.float64), wp.types.vector(4, wp.float64)


@wp.struct
class Sum:
    """Velocities of both centres and rates of turning under y_n, y_t, and y_t's slope by friction."""

    vn: V2  # of B against A
    vt: V2
    vm: V2
    turn_a: wp.vec3d  # under y_n, y_t, and the slope
    turn_b: wp.vec3d
    run_a: V2  # rates with which A's surface runs, under y_t and its slope by friction; and B's
    run_b: V2
    by_a: V2  # slopes by the levers of the centres
    by_b: V2


@cached
def make_touch(given: type, residual: str, graded: bool) -> SimpleNamespace:
    """touch(..., pair) -> Touch; slip(..., set) -> J_t y; include(..., set, by_normal, by_tangent,
    by_friction, Sum) adds rates to the y; settle(..., gap, Sum) adds the slopes by places, angles and radii,
    and returns that by friction.
    """
    contact = make_contact(given, residual)
    move = make_twists(given, graded)
    z, of = move.solved, make_answer(wp.float64)
    Answer = of.Answer
    number, two, add, add2, origin = z.number, z.two, z.add, z.add2, z.origin
    RADIUS, CORNER, OFFSET, ANGLE, RATIO = (
        z.COLUMN[n] for n in ("radius", "corner_radius", "shape_offset", "shape_angle", "surface_ratio")
    )
    ZERO, ONE = wp.float64(0.0), wp.float64(1.0)
    core = make_core(wp.float64)

    @wp.func
    def lever(k: wp.ref[Slot], body: int, pose: V4):
        """A shape's centre from its body's origin."""
        centre = V2(pose[0], pose[1])
        if body == WORLD:
            return centre
        return centre - origin(k, body)

    @wp.func
    def running(t: wp.ref[Topology], w: wp.ref[View], pair: int, set: int):
        """The rates with which the surfaces of A and B run, in a set of joint rates."""
        out = V2()
        if t.columns[wp.static(RATIO)] >= 0:
            for at in range(t.pair_start[pair], t.pair_start[pair + 1]):
                rate = w.rates[set * t.nv + t.pair_dof[at]]
                if (t.pair_side[at] & RUNS_A) != 0:
                    out[0] = rate
                if (t.pair_side[at] & RUNS_B) != 0:
                    out[1] = rate
        return out

    @wp.func
    def run(t: wp.ref[Topology], k: wp.ref[Slot], pair: int, rate_a: wp.float64, rate_b: wp.float64):
        """What surfaces that run at these rates add to J_t y."""
        out = ZERO + ZERO
        if t.columns[wp.static(RATIO)] >= 0:
            out -= number(t, k, RATIO, t.pair_a[pair]) * rate_a + number(t, k, RATIO, t.pair_b[pair]) * rate_b
        return out

    @wp.func(inline=False)
    def include(
        t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], pair: int, g: Touch, set: int,
        by_normal: wp.float64, by_tangent: wp.float64, by_friction: wp.float64, before: Sum,
    ):  # fmt: skip
        out = before
        tangent = perp(g.n)
        along = by_normal * g.n + by_tangent * tangent
        body = t.shape_body[t.pair_a[pair]]
        v = V2()
        if body != WORLD:
            rho = lever(k, body, g.pa)
            v -= move.point(t, w, set, body, rho)
            turning = w.twist[set * t.nb + body][0]
            out.turn_a += turning * wp.vec3d(by_normal, by_tangent, by_friction)
            out.by_a += move.point_back(t, w, set, body, rho, -along)
            move.spin_back(t, w, set, body, by_normal * g.ha[1] - by_tangent * g.ha[0])
        body = t.shape_body[t.pair_b[pair]]
        if body != WORLD:
            rho = lever(k, body, g.pb)
            v += move.point(t, w, set, body, rho)
            turning = w.twist[set * t.nb + body][0]
            out.turn_b += turning * wp.vec3d(by_normal, by_tangent, by_friction)
            out.by_b += move.point_back(t, w, set, body, rho, along)
            move.spin_back(t, w, set, body, by_normal * g.hb[1] - by_tangent * g.hb[0])
        out.vn += by_normal * v
        out.vt += by_tangent * v
        out.vm += by_friction * v
        rates = running(t, w, pair, set)
        out.run_a += rates[0] * V2(by_tangent, by_friction)
        out.run_b += rates[1] * V2(by_tangent, by_friction)
        return out

    @wp.func
    def slip(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], pair: int, g: Touch, set: int):
        """J_t y of a set of joint rates."""
        v = V2()
        body = t.shape_body[t.pair_a[pair]]
        if body != WORLD:
            v -= move.point(t, w, set, body, lever(k, body, g.pa) + g.ha[0] * g.n)
        body = t.shape_body[t.pair_b[pair]]
        if body != WORLD:
            v += move.point(t, w, set, body, lever(k, body, g.pb) - g.hb[0] * g.n)
        rates = running(t, w, pair, set)
        return wp.dot(perp(g.n), v) + run(t, k, pair, rates[0], rates[1])

    @wp.func
    def shape_back(
        t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], shape: int,
        end: int, pose: V4, place: V2, by_lever: V2, turn: wp.float64,
    ):  # fmt: skip
        """Slopes by a shape's centre, by its lever in velocities, and by its angle."""
        body = t.shape_body[shape]
        own = move.attach(t, k, w, body, lever(k, body, pose), place, by_lever)
        if body != WORLD:
            move.turn_back(w, body, turn)
        add2(t, w, OFFSET, shape, own)
        whole = turn
        axis = V2(ONE, ZERO)
        if end != 0 and t.shape_turned[shape] == 1:
            angle = number(t, k, ANGLE, shape)
            axis = V2(wp.cos(angle), wp.sin(angle))
        if end > 1:  # the centre lies at a corner of the core
            half = core(contact.size(t, k, shape))
            x = wp.where(end == 2 or end == 5, -ONE, ONE)
            y = wp.where(end < 4, -ONE, ONE)
            along = wp.dot(own, axis)
            across = wp.dot(own, perp(axis))
            add2(t, w, RADIUS, shape, V2(x * along, y * across))
            add(t, w, CORNER, shape, -x * along - y * across)
            whole += x * half[0] * across - y * half[1] * along
        elif end != 0:  # the centre lies half the length along the axis
            reach = wp.float64(end)
            add(t, w, RADIUS, 2 * shape + 1, reach * wp.dot(own, axis))
            reach *= number(t, k, RADIUS, 2 * shape + 1)
            whole += reach * wp.dot(own, perp(axis))
        add(t, w, ANGLE, shape, whole)

    @wp.func
    def radii_back(
        t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], shape: int, end: int, disc: int, kind: int,
        flat: int, pose: V4, n: V2, by: V2,
    ):  # fmt: skip
        c = n[0] * pose[2] + n[1] * pose[3]
        across = n[1] * pose[2] - n[0] * pose[3]
        if end > 1:
            add(t, w, CORNER, shape, by[0])
        elif kind == BLOCK:
            b = of.of_rectangle(c, across, by)
            add2(t, w, RADIUS, shape, V2(b[0], b[1]))
            add(t, w, CORNER, shape, b[2])
        elif kind == HOLLOW:
            add(t, w, RADIUS, 2 * shape, -by[0])
        elif disc == 1 or end != 0 or kind == LONG:
            add(t, w, RADIUS, 2 * shape, by[0])
            if kind == LONG and flat == 0:
                add(t, w, RADIUS, 2 * shape + 1, of.of_capsule(c, -across, by))
        else:
            size = two(t, k, RADIUS, shape)
            e = of.of_ellipse(size[0], size[1], c, across)
            add2(t, w, RADIUS, shape, V2(by[0] * e[0] + by[1] * e[1], by[0] * e[2] + by[1] * e[3]))

    @wp.func
    def settle(
        t: wp.ref[Topology], discs: wp.array(dtype=wp.int32), k: wp.ref[Slot], w: wp.ref[View], pair: int,
        g: Touch, gap: wp.float64, y: Sum,
    ):  # fmt: skip
        tangent = perp(g.n)
        alpha = wp.dot(tangent, y.vn) - wp.dot(g.n, y.vt) - y.turn_b[1] * g.hb[1]  # dG/dalpha at fixed places
        out = Answer()
        if g.flat > 0:
            delta = V2(g.pb[0] - g.pa[0], g.pb[1] - g.pa[1])
            out = of.flat(
                g.n, delta, g.ha, g.hb, gap, alpha, y.turn_a[0], y.turn_b[0], y.turn_a[1], y.turn_b[1]
            )
        if g.flat != 1:
            beyond = of.round(
                g.n, g.ha, g.hb, g.curvature, gap, alpha, y.turn_a[0], y.turn_b[0], y.turn_a[1], y.turn_b[1]
            )
            if g.flat == 2:
                beyond = of.mean(out, beyond)
            out = beyond
        a = t.pair_a[pair]
        o = t.pair_b[pair]
        end_a = t.pair_ends[2 * pair]
        end_b = t.pair_ends[2 * pair + 1]
        shape_back(t, k, w, a, end_a, g.pa, -out.shift, y.by_a, out.turn_a)
        shape_back(t, k, w, o, end_b, g.pb, out.shift, y.by_b, out.turn_b)
        kind = t.pair_kind[pair]
        if kind != PLANE:
            radii_back(t, k, w, a, end_a, discs[a], kind, g.flat, g.pa, g.n, out.support_a)
        radii_back(t, k, w, o, end_b, discs[o], ROUND, 0, g.pb, g.n, out.support_b)
        if t.columns[wp.static(RATIO)] >= 0:
            add(t, w, RATIO, a, -y.run_a[0])
            add(t, w, RATIO, o, -y.run_b[0])
        ran = run(t, k, pair, y.run_a[1], y.run_b[1])
        return wp.dot(tangent, y.vm) + ran - g.ha[0] * y.turn_a[2] - g.hb[0] * y.turn_b[2]

    return SimpleNamespace(touch=make_touched(given, residual), slip=slip, include=include, settle=settle)
