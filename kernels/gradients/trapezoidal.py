"""Gradient of one solved step of the trapezoidal integrator by the physical parameters.

From x' back: the contact problems of v' and of v* (`step/trapezoidal.py`) weigh v_free = reached - push;
`reached` is the free motion under the predicted contact forces; push = v_1 - v_0 comes from the predictor's
contact problem, whose v_0 is the free motion without them. Free motion (`free_motion.py`) with D = reached -
v and c = N push:

    G = N D + h/2 K_v D + h^2/4 K_q (D + 2 v) - h (r + u) - c = 0,  N a = r + u + c/h.

Of L.G the part K_v y_v + K_q y_q is the slope of L.(M a - r) along (y_q, y_v), and so is its gradient that of
the gradient that `motion.py` has: taken as a central difference of sixth order, exact to rounding.
"""

import warp as wp

from ..derivatives.sensitivity import make_linearization
from ..factories import cached
from ..mechanism.free_motion import make_elimination
from ..specialisation import Specialisation
from ..structure import layout
from .damping import make_damped_gradient
from .rows import make_row_gradient

STEP = {wp.float64: 1e-3, wp.float32: 3e-2}  # [m, rad] of the difference
POINTS = 6


@cached
def make_trapezoidal_gradient(spec: Specialisation) -> wp.Function:
    """As `make_parameter_gradient`."""
    s, dtype, method = spec
    linear = make_linearization(spec)
    response = linear.response
    step, motion = linear.step, linear.motion
    mech, t = step.mech, step.types
    part_of = make_damped_gradient(spec)
    constraints = make_row_gradient(spec)
    lu = make_elimination(s.nv, dtype)
    VQ, VX, VU, VR, MQ, JR = t.VQ, t.VX, t.VU, t.VR, t.MQ, t.JR
    H = layout(s).offset("step_size")
    NV = s.nv
    ZERO, ONE, HALF, TWO = dtype(0.0), dtype(1.0), dtype(0.5), dtype(2.0)
    WIDTH, TINY = dtype(STEP[dtype]), dtype(1e-30)
    WEIGHTS = wp.types.vector(3, dtype)(dtype(0.75), dtype(-0.15), dtype(1.0 / 60.0))
    FORMS = 1 if response.complete is None else 2

    @wp.func
    def by_acceleration(world: t.World, start: linear.Linear, l: VQ, yq: VQ):
        """The gradient by a of l . (K_q yq)."""
        h = world.params[wp.static(H)]
        out = VQ()
        for j in range(wp.static(NV)):
            unit = VQ()
            unit[j] = ONE
            moved = wp.static(motion.motion_by_q)(t.unpushed(world), start.pose, unit, VQ(), ZERO)
            if wp.static(step.mass.damped_springs):
                moved = wp.static(step.mass.drag_by_q)(world, start.pose.frames, h * unit, moved)
            out[j] = wp.dot(l, moved * yq)
        return out

    @wp.func
    def length(yq: VQ, yv: VQ, h: dtype):
        """The largest component of a direction, rates over a step."""
        out = TINY
        for j in range(wp.static(NV)):
            out = wp.max(out, wp.max(wp.abs(yq[j]), h * wp.abs(yv[j])))
        return out

    @wp.func
    def by_step_size(
        world: t.World, start: linear.Linear, kq: MQ, kv: MQ, v: VQ, d: VQ, a: VQ, force: VQ, yq: VQ
    ):
        """dG/dh."""
        out = HALF * (kv * d) + world.params[wp.static(H)] * (kq * (HALF * d + v)) - force
        if wp.static(step.mass.damped_springs):
            out += wp.static(step.mass.drag_by_q)(world, start.pose.frames, a, MQ()) * yq
        return out

    @wp.func
    def part(
        world: t.World,
        pose: t.Pose,
        u: VU,
        form: part_of.Motion,
        later: VQ,
        of_stiffness: bool,
        grad: wp.array(dtype=dtype),
    ):
        """The form's gradient; K_q has dampers at the velocity `later`, K_v has none."""
        if wp.static(step.mass.implicit):
            if of_stiffness:
                part_of.stiffness(world, pose, u, form, later, grad)
            else:
                part_of.moving(world, pose, u, form, JR(), grad)
        else:
            part_of.moving(world, pose, u, form, JR(), grad)

    @wp.func
    def swing(
        world: t.World,
        start: linear.Linear,
        v: VQ,
        u: VU,
        minv: MQ,
        d: VQ,
        a: VQ,
        push: VQ,
        target: VQ,
        grad: wp.array(dtype=dtype),
    ):
        """Adds the gradient of target . reached at fixed c; returns the weight of c."""
        h = world.params[wp.static(H)]
        kq = wp.static(motion.motion_by_q)(world, start.pose, a, v, ONE)
        kv = wp.static(motion.motion_by_v)(world, start.pose, v, ONE)
        mass = wp.static(step.mass.matrix)(world, start.pose)
        e = mass + HALF * h * (kv + HALF * h * kq)
        turned = wp.transpose(e)
        factor = wp.static(lu.factor)(turned)
        l = -wp.static(lu.refined)(turned, factor, target, wp.static(lu.solves)(turned, factor))
        yv = HALF * h * d
        yq = HALF * HALF * h * h * (d + TWO * v)
        b = minv * by_acceleration(world, start, l, yq)
        width = WIDTH / length(yq, yv, h)
        form = part_of.Motion()
        i = int(0)
        while i < wp.static(POINTS + 2):
            pose = start.pose
            form.v = v
            form.p = l
            form.w = d
            form.h = h
            if i == wp.static(POINTS):
                form.p = -b
                form.w = a
                form.h = ONE
            if i < wp.static(POINTS):
                shift = dtype(i // 2 + 1)
                weight = WEIGHTS[i // 2] / width
                if i % 2 == 1:
                    shift = -shift
                    weight = -weight
                form.v = v + (shift * width) * yv
                form.p = weight * l
                form.w = a
                form.h = ONE
                pose = wp.static(mech.pose)(world, start.pose.q + (shift * width) * yq)
            part(world, pose, u, form, v + h * a, i < wp.static(POINTS), grad)
            i += 1
        force = mass * (a - push / h)  # r + u
        by_h = by_step_size(world, start, kq, kv, v, d, a, force, yq)
        slope = wp.dot(l, by_h) - wp.dot(b, mass * push) / (h * h)
        grad[wp.static(H)] = grad[wp.static(H)] + slope
        return b / h - l

    @wp.func
    def halves(x: VX):
        first, second = VQ(), VQ()
        for j in range(wp.static(NV)):
            first[j] = x[j]
            second[j] = x[wp.static(NV + j)]
        return first, second

    @wp.func
    def free_motion(sol: step.Solution, v: VQ, h: dtype, pushed: bool):
        """Change of velocity, acceleration and push of the motion under the predicted forces, or without."""
        if pushed:
            return sol.vfree + sol.push - v, sol.acceleration, sol.push
        return sol.unpushed - v, sol.acceleration - sol.push / h, VQ()

    @wp.func
    def gradient(
        world: t.World,
        x: VX,
        u: VU,
        sol: step.Solution,
        lin: linear.Linear,
        weight: VX,
        grad: wp.array(dtype=dtype),
    ):
        h = world.params[wp.static(H)]
        _q, v = halves(x)
        by_position, target = halves(weight)
        by_drift = h * by_position
        grad[wp.static(H)] = grad[wp.static(H)] + wp.dot(by_drift, sol.drift) / h
        start = linear.Linear()
        start.pose = lin.pose
        mass = wp.static(step.mass.matrix)(world, start.pose)
        first, drifting = step.parts(world, start.pose, v, sol)
        now = sol
        onto = VQ()  # weight of v_free, then of v_0
        problem = int(0)
        while problem < 3:
            here = linear.factored(world, now, start)
            normals = here.rows.m
            dual = response.dual(here.factor, step.posed(now), now.lam, now.z, target)
            form = part_of.Motion()
            form.v = v
            form.p = dual.p
            form.w = now.v - now.vfree
            form.kappa = dual.kappa
            term = int(0)
            while term < wp.static(FORMS):
                part_of.moving(world, start.pose, u, form, normals, grad)
                if wp.static(FORMS > 1):
                    form.p = dual.left
                    form.w = dual.right
                    form.kappa = VR()
                term += 1
            wp.static(constraints)(world, start.pose, now, here, dual, h, grad)
            if problem == 0:
                onto = -(mass * dual.p)
                target = by_drift
                now = drifting
            else:
                onto -= wp.where(problem == 1, HALF, ONE) * (mass * dual.p)
                d, a, push = free_motion(sol, v, h, problem == 1)
                pushed = swing(world, start, v, u, sol.minv, d, a, push, onto, grad)
                form.p = pushed
                form.w = push
                form.kappa = VR()
                part_of.moving(world, start.pose, u, form, normals, grad)
                target = mass * pushed - onto
                onto = -target
                now = first
            problem += 1

    return gradient
