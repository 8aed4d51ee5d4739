"""The motion part of an adjoint step: P.(N (v' - v) - h r) by places, rates and every number of the bodies.

With implicit damping N = M + h C, and P.(N (v' - v) - h r) = P.(M (v' - v) - h r_0 + h C v'), r_0 without
dampers; else the same with C v. Beside it -kappa m'N m of one row, m = N^-1 J_i'. With implicit stiffness
`stiffness.py` adds to both.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...generic.derivatives.tables import Groups
from ...generic.topology import JOINT, Topology
from ...generic.work import Slot
from .room import DUAL, NEW, OLD, ROW, View
from .spans import make_spans
from .stiffness import make_stiffness
from .tendons import make_tendons
from .twists import make_twists, turned, twist


@cached
def make_motion(given: type, graded: bool) -> SimpleNamespace:
    """body(..., i, force, share, whole), a share of its Coriolis forces and one of all else, joints(...),
    spring(..., i) add the parts of the motion; row_part(..., group, kappa) that of a row whose m is in the
    rates ROW.
    """
    move, spans, stiffness_of = (make(given, graded) for make in (make_twists, make_spans, make_stiffness))
    z, tendons = move.solved, make_tendons(given, graded)
    number, two, add, add2, axes = z.number, z.two, z.add, z.add2, z.axes
    H, GRAVITY, MASS, INERTIA, COM, DAMPING, GEAR, STIFFNESS, REST, PULL, DAMP, LENGTH, ARMATURE = (
        z.COLUMN[n]
        for n in ("step_size", "gravity", "mass", "inertia", "com", "damping", "gear", "stiffness", "rest",
                  "spring_stiffness", "spring_damping", "spring_length", "armature")
    )  # fmt: skip
    ONE, TWO, HALF = wp.float64(1.0), wp.float64(2.0), wp.float64(0.5)
    FREE = JOINT["free"]
    SHORT = wp.float64(spans.SHORT)

    @wp.func
    def body(
        t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int,
        force: wp.vec3d, share: wp.float64, whole: wp.float64,
    ):  # fmt: skip
        h = number(t, k, H, 0)
        mass = number(t, k, MASS, i)
        inertia = number(t, k, INERTIA, i)
        rho = turned(axes(k, i), two(t, k, COM, i))
        spin_p = w.twist[wp.static(DUAL) * t.nb + i][0]
        spin_v = w.twist[wp.static(OLD) * t.nb + i][0]
        spin_w = whole * (w.twist[wp.static(NEW) * t.nb + i][0] - spin_v)
        vp = move.point(t, w, wp.static(DUAL), i, rho)
        change = move.point(t, w, wp.static(NEW), i, rho) - move.point(t, w, wp.static(OLD), i, rho)
        free = share * (w.acceleration[i] - spin_v * spin_v * rho) - whole * two(t, k, GRAVITY, 0)
        total = whole * change + h * free
        pushed = wp.vec2d(force[0], force[1])
        add(t, w, MASS, i, wp.dot(vp, total))
        add(t, w, INERTIA, i, spin_p * spin_w)
        add2(t, w, GRAVITY, 0, -h * whole * mass * vp)
        add(t, w, H, 0, mass * wp.dot(vp, free) - wp.dot(pushed, vp) - force[2] * spin_p)
        by_p = mass * total - h * pushed
        by_new = whole * mass * vp
        by_turning = h * share * mass * vp
        by_rho = move.point_back(t, w, wp.static(DUAL), i, rho, by_p)
        by_rho += move.point_back(t, w, wp.static(NEW), i, rho, by_new)
        by_rho += move.point_back(t, w, wp.static(OLD), i, rho, -by_new)
        by_rho -= spin_v * spin_v * by_turning
        zero = wp.vec2d()
        at = wp.static(DUAL) * t.nb + i
        w.by_twist[at] = w.by_twist[at] + twist(inertia * spin_w - h * force[2], zero)
        at = wp.static(NEW) * t.nb + i
        w.by_twist[at] = w.by_twist[at] + twist(whole * inertia * spin_p, zero)
        at = wp.static(OLD) * t.nb + i
        late = -TWO * spin_v * wp.dot(rho, by_turning)
        w.by_twist[at] = w.by_twist[at] + twist(late - whole * inertia * spin_p, zero)
        w.by_acceleration[i] = w.by_acceleration[i] + by_turning
        add2(t, w, COM, i, move.attach(t, k, w, i, rho, zero, by_rho))

    @wp.func
    def joints(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View]):
        """Dampers, springs and inertia of the joints; tendons; of all springs what they add to M."""
        h = number(t, k, H, 0)
        seen = wp.where(t.implicit_damping == 1, wp.static(NEW), wp.static(OLD)) * t.nv
        by_h = wp.float64(0.0)
        for j in range(t.nv):
            p = w.rates[wp.static(DUAL) * t.nv + j]
            c = number(t, k, DAMPING, j)
            add(t, w, DAMPING, j, h * p * w.rates[seen + j])
            by_h += c * p * w.rates[seen + j]
            if t.implicit_damping == 0:
                w.by_v[j] = w.by_v[j] + h * c * p
        for i in range(t.sprung):
            j = t.sprung_dof[i]
            p = w.rates[wp.static(DUAL) * t.nv + j]
            stiffness = number(t, k, STIFFNESS, j)
            stretch = w.q[j] - number(t, k, REST, j)
            add(t, w, STIFFNESS, j, h * p * stretch)
            add(t, w, REST, j, -h * p * stiffness)
            w.by_q[j] = w.by_q[j] + h * p * stiffness
            by_h += stiffness * p * stretch
        for i in range(t.rotors):
            j = t.rotor_dof[i]
            p = w.rates[wp.static(DUAL) * t.nv + j]
            change = w.rates[wp.static(NEW) * t.nv + j] - w.rates[wp.static(OLD) * t.nv + j]
            add(t, w, ARMATURE, j, p * change)
            w.by_v[j] = w.by_v[j] - number(t, k, ARMATURE, j) * p
        add(t, w, H, 0, by_h)
        stiffness_of.motion(t, k, w)
        for i in range(t.tendons):
            tendons.motion(t, k, w, i)

    @wp.func
    def control(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int, u: wp.float64):
        """Adds the columns of actuator i; returns the slope by its control."""
        h = number(t, k, H, 0)
        gear = number(t, k, GEAR, i)
        p = wp.float64(0.0)
        if t.actuator[i] >= 0:
            p = w.rates[wp.static(DUAL) * t.nv + t.actuator[i]]
        else:
            tendon = -1 - t.actuator[i]
            part = tendons.slope(t, k, tendon)
            p = part * tendons.felt(t, k, w, tendon)
            tendons.pulled(t, k, w, tendon, -h * part * gear * u)
        add(t, w, GEAR, i, -h * p * u)
        add(t, w, H, 0, -gear * p * u)
        return -h * gear * p

    @wp.func
    def spring(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int):
        """h G Delta.V(P), G = k (1 - L/l) + c m/l^2, m = Delta.V(v) or, with implicit damping, of v'."""
        h = number(t, k, H, 0)
        seen = wp.where(t.implicit_damping == 1, wp.static(NEW), wp.static(OLD))
        rest = number(t, k, LENGTH, i)
        e = spans.span(t, k, i, rest)
        delta = e.delta
        inv = e.inv
        vp = spans.rate(t, w, wp.static(DUAL), i, e)
        vy = spans.rate(t, w, seen, i, e)
        stiffness = number(t, k, PULL, i)
        c = number(t, k, DAMP, i)
        root = wp.sqrt(inv)
        work = wp.dot(delta, vp)
        m = wp.dot(delta, vy)
        g = stiffness * (ONE - rest * root) + c * m * inv
        by_s = inv * (HALF * stiffness * rest * root - c * m * inv)  # dG/ds
        add(t, w, PULL, i, h * work * (ONE - rest * root))
        add(t, w, DAMP, i, h * work * m * inv)
        add(t, w, LENGTH, i, h * work * (TWO * by_s * e.eps * SHORT - stiffness * root))
        add(t, w, H, 0, g * work)
        place = h * (g * vp + work * (TWO * by_s * delta + c * inv * vy))
        by_p = h * g * delta
        by_y = (h * work * c * inv) * delta
        spans.back(t, k, w, i, e, place, wp.static(DUAL), by_p, seen, by_y)

    @wp.func
    def row_body(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int,
                 kappa: wp.float64):  # fmt: skip
        mass = number(t, k, MASS, i)
        rho = turned(axes(k, i), two(t, k, COM, i))
        spin = w.twist[wp.static(ROW) * t.nb + i][0]
        v = move.point(t, w, wp.static(ROW), i, rho)
        add(t, w, MASS, i, -kappa * wp.dot(v, v))
        add(t, w, INERTIA, i, -kappa * spin * spin)
        by_rho = move.point_back(t, w, wp.static(ROW), i, rho, (-TWO * kappa * mass) * v)
        add2(t, w, COM, i, move.attach(t, k, w, i, rho, wp.vec2d(), by_rho))

    @wp.func
    def row_damper(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], i: int,
                   kappa: wp.float64):  # fmt: skip
        """-kappa h c (Delta.V(m))^2/l^2 of spring i."""
        h = number(t, k, H, 0)
        e = spans.span(t, k, i, number(t, k, LENGTH, i))
        delta = e.delta
        inv = e.inv
        vm = spans.rate(t, w, wp.static(ROW), i, e)
        c = kappa * number(t, k, DAMP, i)
        work = wp.dot(delta, vm)
        add(t, w, DAMP, i, -kappa * h * work * work * inv)
        add(t, w, H, 0, -c * work * work * inv)
        add(t, w, LENGTH, i, TWO * h * c * work * work * inv * inv * e.eps * SHORT)
        place = (TWO * h * c * work * inv) * (work * inv * delta - vm)
        by_m = (-TWO * h * c * work * inv) * delta
        spans.back(t, k, w, i, e, place, wp.static(ROW), by_m, wp.static(ROW), wp.vec2d())

    @wp.func
    def row_part(t: wp.ref[Topology], s: wp.ref[Groups], k: wp.ref[Slot], w: wp.ref[View],
                 group: int, kappa: wp.float64):  # fmt: skip
        """-kappa m'N m of the bodies, joints, dampers, springs and tendons of a group."""
        h = number(t, k, H, 0)
        for at in range(s.group_body_start[group], s.group_body_start[group + 1]):
            i = s.group_body[at]
            row_body(t, k, w, i, kappa)
            if t.implicit_damping == 1:
                last = t.first_dof[i] + wp.where(t.joint[i] == wp.static(FREE), 3, 1)
                for j in range(t.first_dof[i], last):
                    m = w.rates[wp.static(ROW) * t.nv + j]
                    add(t, w, DAMPING, j, -kappa * h * m * m)
                    add(t, w, H, 0, -kappa * number(t, k, DAMPING, j) * m * m)
        for i in range(t.rotors):
            j = t.rotor_dof[i]
            if s.dof_group[j] == group:
                m = w.rates[wp.static(ROW) * t.nv + j]
                add(t, w, ARMATURE, j, -kappa * m * m)
        if t.implicit_damping == 1 or t.implicit_stiffness == 1:
            for i in range(t.springs):
                if s.body_group[wp.max(t.spring_body[2 * i], t.spring_body[2 * i + 1])] == group:
                    if t.implicit_damping == 1:
                        row_damper(t, k, w, i, kappa)
                    if t.implicit_stiffness == 1:
                        stiffness_of.row_spring(t, k, w, i, kappa)
        for i in range(t.tendons):
            if s.dof_group[t.tendon_dof[t.tendon_start[i]]] == group:
                tendons.row_part(t, k, w, i, kappa)
        if t.implicit_stiffness == 1:
            for at in range(t.sprung):
                if s.dof_group[t.sprung_dof[at]] == group:
                    stiffness_of.row_joint(t, k, w, t.sprung_dof[at], kappa)

    return SimpleNamespace(
        twists=move, body=body, joints=joints, control=control, spring=spring, row_part=row_part
    )
