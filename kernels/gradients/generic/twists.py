"""Velocities of a tree's bodies under joint rates, from root to leaves, and their slopes back.

A body's origin o moves with V = V_up + omega_up perp(o - o_up) + R_up a, a what the joint shifts, and at
constant rates it accelerates by A = A_up - omega_up^2 (o - o_up) + 2 omega_up perp(R_up a). A scalar of
places, velocities and accelerations of points has its slopes by joint positions, by joint rates and by every
length and angle of the joints when those by the bodies' frames, velocities and accelerations have gone down
to the roots.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...generic.topology import JOINT, Topology
from ...generic.work import Slot
from ...structure import WORLD
from .room import OLD, View
from .solved import make_solved


@wp.func
def perp(a: wp.vec2d):
    """a turned by +90 degrees."""
    return wp.vec2d(-a[1], a[0])


@wp.func
def back(a: wp.vec2d):
    """The transpose of perp: perp(e).a = e.back(a)."""
    return wp.vec2d(a[1], -a[0])


@wp.func
def turned(cs: wp.vec2d, a: wp.vec2d):
    """R a"""
    return wp.vec2d(cs[0] * a[0] - cs[1] * a[1], cs[1] * a[0] + cs[0] * a[1])


@wp.func
def straight(cs: wp.vec2d, a: wp.vec2d):
    """R' a"""
    return wp.vec2d(cs[0] * a[0] + cs[1] * a[1], cs[0] * a[1] - cs[1] * a[0])


@wp.func
def shift(x: wp.vec3d):
    """The velocity in a twist."""
    return wp.vec2d(x[1], x[2])


@wp.func
def twist(turning: wp.float64, v: wp.vec2d):
    """Rate of turning and velocity as one."""
    return wp.vec3d(turning, v[0], v[1])


@cached
def make_twists(given: type, graded: bool) -> SimpleNamespace:
    """advance(t, k, w, set, i): twist of body i under the rates of `set`; accelerate: its
    acceleration under v. pull: slopes by them to those of its parent, frames, rates v and joint. settle: of
    its frame, after all that hangs on it. point and point_back: velocity of a point at rho from the origin,
    and its slope.
    """
    z = make_solved(given, graded)
    origin, axes, two, add, add2 = z.origin, z.axes, z.two, z.add, z.add2
    ANCHOR, ANGLE, AXIS = (z.COLUMN[n] for n in ("anchor", "angle", "axis"))
    PRISMATIC, FREE = JOINT["prismatic"], JOINT["free"]
    ZERO, TWO = wp.float64(0.0), wp.float64(2.0)

    @wp.func
    def joint(t: wp.ref[Topology], k: wp.ref[Slot], i: int, x: wp.array(dtype=wp.float64), at: int):
        """What positions or rates x turn and shift the body of joint i by, in its parent's axes."""
        first = at + t.first_dof[i]
        if t.joint[i] == PRISMATIC:
            return twist(ZERO, x[first] * two(t, k, AXIS, i))
        if t.joint[i] == FREE:
            return wp.vec3d(x[first + 2], x[first], x[first + 1])
        return wp.vec3d(x[first], ZERO, ZERO)

    @wp.func
    def advance(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], set: int, i: int):
        own = joint(t, k, i, w.rates, set * t.nv)
        up = t.parent[i]
        if up != WORLD:
            base = w.twist[set * t.nb + up]
            arm = origin(k, i) - origin(k, up)
            moved = shift(base) + base[0] * perp(arm) + turned(axes(k, up), shift(own))
            own = twist(base[0] + own[0], moved)
        w.twist[set * t.nb + i] = own

    @wp.func
    def accelerate(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int):
        out = wp.vec2d()
        up = t.parent[i]
        if up != WORLD:
            turning = w.twist[wp.static(OLD) * t.nb + up][0]
            own = shift(joint(t, k, i, w.rates, wp.static(OLD) * t.nv))
            arm = origin(k, i) - origin(k, up)
            out = w.acceleration[up] - turning * turning * arm
            out += TWO * turning * perp(turned(axes(k, up), own))
        w.acceleration[i] = out

    @wp.func
    def point(t: wp.ref[Topology], w: wp.ref[View], set: int, body: int, rho: wp.vec2d):
        x = w.twist[set * t.nb + body]
        return shift(x) + x[0] * perp(rho)

    @wp.func
    def point_back(t: wp.ref[Topology], w: wp.ref[View], set: int, body: int, rho: wp.vec2d, by: wp.vec2d):
        """Adds the slope by the point's velocity to the body's; returns that by rho."""
        at = set * t.nb + body
        w.by_twist[at] = w.by_twist[at] + twist(wp.dot(perp(rho), by), by)
        return w.twist[at][0] * back(by)

    @wp.func
    def spin_back(t: wp.ref[Topology], w: wp.ref[View], set: int, body: int, by: wp.float64):
        """Adds a slope by a body's rate of turning."""
        at = set * t.nb + body
        w.by_twist[at] = w.by_twist[at] + wp.vec3d(by, ZERO, ZERO)

    @wp.func
    def turn_back(w: wp.ref[View], body: int, by: wp.float64):
        """Adds a slope by a body's angle."""
        w.by_frame[body] = w.by_frame[body] + wp.vec3d(ZERO, ZERO, by)

    @wp.func
    def rates_back(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], set: int, i: int, by: wp.vec3d):
        """Slopes by what a joint's rates turn and shift: by its axis, and by the rates v."""
        first = t.first_dof[i]
        if t.joint[i] == PRISMATIC:
            add2(t, w, AXIS, i, w.rates[set * t.nv + first] * shift(by))
            if set == wp.static(OLD):
                w.by_v[first] = w.by_v[first] + wp.dot(two(t, k, AXIS, i), shift(by))
        elif set == wp.static(OLD):
            turning = first
            if t.joint[i] == FREE:
                w.by_v[first] = w.by_v[first] + by[1]
                w.by_v[first + 1] = w.by_v[first + 1] + by[2]
                turning = first + 2
            w.by_v[turning] = w.by_v[turning] + by[0]

    @wp.func
    def pull(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], set: int, i: int):
        by = w.by_twist[set * t.nb + i]
        own = shift(by)
        up = t.parent[i]
        if up != WORLD:
            cs = axes(k, up)
            arm = origin(k, i) - origin(k, up)
            turning = w.twist[set * t.nb + up][0]
            slid = turned(cs, shift(joint(t, k, i, w.rates, set * t.nv)))
            by_arm = turning * back(own)
            by_turning = by[0] + wp.dot(perp(arm), own)
            w.by_twist[set * t.nb + up] = w.by_twist[set * t.nb + up] + twist(by_turning, own)
            if set == wp.static(OLD):
                late = w.by_acceleration[i]
                w.by_acceleration[up] = w.by_acceleration[up] + late
                by_arm -= turning * turning * late
                by_turning = TWO * (wp.dot(perp(slid), late) - turning * wp.dot(arm, late))
                at = set * t.nb + up
                w.by_twist[at] = w.by_twist[at] + wp.vec3d(by_turning, ZERO, ZERO)
                own += TWO * turning * back(late)
            w.by_arm[i] = w.by_arm[i] + by_arm
            turn_back(w, up, wp.dot(perp(slid), own))
            own = straight(cs, own)
        rates_back(t, k, w, set, i, twist(by[0], own))

    @wp.func
    def settle(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int):
        by = w.by_frame[i]
        place = wp.vec2d(by[0], by[1])
        up = t.parent[i]
        if up != WORLD:
            arm = origin(k, i) - origin(k, up)
            by_arm = w.by_arm[i] + place
            turn = by[2] + wp.dot(perp(arm), by_arm)
            w.by_frame[up] = w.by_frame[up] + wp.vec3d(place[0], place[1], turn)
            place = straight(axes(k, up), by_arm)
        add2(t, w, ANCHOR, i, place)
        add(t, w, ANGLE, i, by[2])
        first = t.first_dof[i]
        if t.joint[i] == PRISMATIC:
            add2(t, w, AXIS, i, w.q[first] * place)
            w.by_q[first] = w.by_q[first] + wp.dot(two(t, k, AXIS, i), place)
        elif t.joint[i] == FREE:
            w.by_q[first] = w.by_q[first] + place[0]
            w.by_q[first + 1] = w.by_q[first + 1] + place[1]
            w.by_q[first + 2] = w.by_q[first + 2] + by[2]
        else:
            w.by_q[first] = w.by_q[first] + by[2]

    @wp.func
    def attach(
        t: wp.ref[Topology],
        k: wp.ref[Slot],
        w: wp.ref[View],
        body: int,
        rho: wp.vec2d,
        place: wp.vec2d,
        by_rho: wp.vec2d,
    ):
        """Slopes by the place of a point of a body, and by rho beside that: of the frame; returns the slope
        by the point's coordinates in the body.
        """
        if body == WORLD:
            return place
        whole = place + by_rho
        w.by_frame[body] = w.by_frame[body] + wp.vec3d(place[0], place[1], wp.dot(perp(rho), whole))
        return straight(axes(k, body), whole)

    return SimpleNamespace(
        solved=z,
        advance=advance,
        accelerate=accelerate,
        point=point,
        point_back=point_back,
        spin_back=spin_back,
        turn_back=turn_back,
        pull=pull,
        settle=settle,
        attach=attach,
    )
