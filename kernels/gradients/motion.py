"""The motion part of the gradient by parameters: masses, inertias and places of the centres of mass.

See `parameters.py` for the rule. The scalar is P.(M w - h r) - sum_i kappa_i m_i' M m_i, with m_i of
`normals` and the last term only under inertia scaling; where damping is implicit P.C y instead of h P.C v.
"""

from types import SimpleNamespace

import warp as wp

from ..derivatives.sensitivity import make_linearization
from ..factories import cached
from ..specialisation import Specialisation
from ..structure import layout
from .places import below, make_places
from .springs import make_spring_gradient
from .tendons import make_drive_gradient, make_tendon_gradient


@cached
def make_motion_gradient(spec: Specialisation) -> SimpleNamespace:
    """Warp functions of the motion part: mass, inertia and displacements of centres of mass."""
    s, dtype, method = spec
    linear = make_linearization(spec)
    mech, motion, t = linear.step.mech, linear.motion, linear.step.types
    places = make_places(s, dtype)
    lay = layout(s)
    V2, VQ, VR, JR = t.V2, t.VQ, t.VR, t.JR
    NB, NR = s.nb, s.nr
    ZERO, TWO = dtype(0.0), dtype(2.0)
    col = {name: lay.offset(name) for name in lay.names}
    MASS, INERTIA = col["mass"], col["inertia"]
    subtree = tuple(tuple(b for b in range(NB) if below(s, b, k)) for k in range(NB))
    springs = tuple(make_spring_gradient(s, i, dtype) for i in range(len(s.springs)))
    springs += tuple(make_tendon_gradient(s, i, dtype).pulling for i in range(len(s.tendons)))
    drives = tuple(make_drive_gradient(s, i, dtype) for i in range(s.nu))

    @wp.struct
    class Motion:
        p: VQ  # P
        w: VQ
        v: VQ
        h: dtype
        kappa: VR  # weight of dD_i; zero without inertia scaling

    perp, back, turns = places.perp, places.back, places.turns
    add, add2, frame_axes = places.add, places.add2, places.frame_axes

    def make_move(body: int) -> wp.Function:
        @wp.func
        def move(world: t.World, jb: t.JB, m: Motion):
            # mass, Jacobian of the centre of mass, its bias weights, acceleration, velocity under P
            jac = wp.static(motion.body_jacobians[body])(jb)
            weights = wp.static(mech.bias_weights[body])(m.v)
            acc = wp.static(motion.accelerations[body])(world, jac, m.w, weights, m.h)
            return world.params[wp.static(MASS + body)], jac, weights, acc, jac * m.p

        return move

    moves = tuple(make_move(b) for b in range(NB))

    def make_shift(body: int, frame: int) -> wp.Function:
        """Weight of a shift of the body's centre of mass in the axes of `frame`."""
        turn = turns[frame]

        @wp.func
        def shift(world: t.World, jb: t.JB, m: Motion, rows: JR):
            mass, jac, weights, acc, along = wp.static(moves[body])(world, jb, m)
            out = mass * (turn(m.p) * back(acc) + turn(m.w) * back(along) - (m.h * turn(weights)) * along)
            if wp.static(linear.response.scaled):
                for i in range(wp.static(NR)):
                    mi = rows[i]
                    out -= (TWO * mass * m.kappa[i] * turn(mi)) * back(jac * mi)
            return out

        return shift

    def make_rotation(body: int, joint: int) -> wp.Function:
        """Weight of turning the body about the origin of the frame of body `joint`."""
        point = mech.point_jacobian(joint)

        @wp.func
        def rotation(world: t.World, pose: t.Pose, m: Motion, rows: JR):
            mass, jac, weights, acc, along = wp.static(moves[body])(world, pose.jacobians, m)
            origin = wp.static(point)(
                world, pose.frames, pose.frames[wp.static(joint), 2], pose.frames[wp.static(joint), 3]
            )
            turned = perp(along - origin * m.p)
            change = perp(jac * m.w - origin * m.w) - m.h * (jac * weights - origin * weights)
            out = mass * (wp.dot(turned, acc) + wp.dot(along, change))
            if wp.static(linear.response.scaled):
                for i in range(wp.static(NR)):
                    mi = rows[i]
                    out += TWO * mass * m.kappa[i] * wp.dot(perp(origin * mi), jac * mi)
            return out

        return rotation

    def make_slide(body: int, dof: int) -> wp.Function:
        """Weight of the direction in which prismatic joint `dof` moves the body (world axes)."""

        @wp.func
        def slide(world: t.World, jb: t.JB, m: Motion, rows: JR):
            mass, jac, weights, acc, along = wp.static(moves[body])(world, jb, m)
            out = mass * (m.p[dof] * acc + m.w[dof] * along + (m.h * weights[dof]) * back(along))
            if wp.static(linear.response.scaled):
                for i in range(wp.static(NR)):
                    mi = rows[i]
                    out -= (TWO * mass * m.kappa[i] * mi[dof]) * (jac * mi)
            return out

        return slide

    def make_inertia(body: int) -> wp.Function:
        turn = turns[body]

        @wp.func
        def inertial(world: t.World, jb: t.JB, m: Motion, rows: JR, grad: wp.array(dtype=dtype)):
            """Adds the gradient by mass and inertia; returns the mass-weighted P velocity (for gravity)."""
            mass, jac, _weights, acc, along = wp.static(moves[body])(t.unpushed(world), jb, m)
            by_mass = wp.dot(along, acc)
            by_inertia = turn(m.p) * turn(m.w)
            if wp.static(linear.response.scaled):
                for i in range(wp.static(NR)):
                    mi = rows[i]
                    velocity = jac * mi
                    by_mass -= m.kappa[i] * wp.dot(velocity, velocity)
                    by_inertia -= m.kappa[i] * turn(mi) * turn(mi)
            grad[wp.static(MASS + body)] = grad[wp.static(MASS + body)] + by_mass
            grad[wp.static(INERTIA + body)] = grad[wp.static(INERTIA + body)] + by_inertia
            return mass * along

        return inertial

    make_shift, make_rotation, make_slide = map(cached, (make_shift, make_rotation, make_slide))

    def make_joint(j: int) -> wp.Function:
        """Columns of one body's joint: anchor, angle and, if prismatic, axis."""
        parent = s.bodies[j].parent
        sliding = s.bodies[j].joint == "prismatic"
        dof = s.bodies[j].dofs[0]
        moved = subtree[j]
        shifts = tuple(make_shift(b, parent) for b in moved)
        rotations = tuple(make_rotation(b, j) for b in moved)
        slides = tuple(make_slide(b, dof) if sliding else None for b in moved)

        @wp.func
        def joint(
            world: t.World,
            pose: t.Pose,
            motion: Motion,
            normals: JR,
            grad: wp.array(dtype=dtype),
        ):
            place = V2()
            turned = ZERO
            direction = V2()
            for k in range(wp.static(len(moved))):
                place += wp.static(shifts[k])(world, pose.jacobians, motion, normals)
                turned += wp.static(rotations[k])(world, pose, motion, normals)
                if wp.static(sliding):
                    direction += wp.static(slides[k])(world, pose.jacobians, motion, normals)
            place = frame_axes(pose.frames, place, wp.static(parent))
            add2(grad, wp.static(col["anchor"] + 2 * j), place)
            add(grad, wp.static(col["angle"] + j), turned)
            if wp.static(sliding):
                direction = frame_axes(pose.frames, direction, wp.static(parent))
                add2(grad, wp.static(col["axis"] + 2 * j), direction + pose.q[wp.static(dof)] * place)

        return joint

    joints = tuple(make_joint(j) for j in range(NB))

    @wp.func
    def dampers(world: t.World, pose: t.Pose, p: VQ, y: VQ, share: dtype, grad: wp.array(dtype=dtype)):
        """Adds the derivative of P.C y, and of a share of what springs and tendons pull along P."""
        if wp.static(s.implicit_damping):
            for j in range(wp.static(s.nv)):
                add(grad, wp.static(col["damping"] + j), p[j] * y[j])
        for i in range(wp.static(len(springs))):
            wp.static(springs[i])(world, pose, y, p, share, grad)

    @wp.func
    def rotor(m: Motion, rows: JR, j: int):
        """What an inertia of coordinate j by itself weighs."""
        out = m.p[j] * m.w[j]
        if wp.static(linear.response.scaled):
            for i in range(wp.static(NR)):
                out -= m.kappa[i] * rows[i, j] * rows[i, j]
        return out

    inertia_of = tuple(make_inertia(b) for b in range(NB))
    own_shifts = tuple(make_shift(b, b) for b in range(NB))

    @wp.func
    def moving(
        world: t.World,
        pose: t.Pose,
        u: t.VU,
        m: Motion,
        y: VQ,
        normals: JR,
        grad: wp.array(dtype=dtype),
    ):
        """Adds the derivative of the scalar by every column but h."""
        pulled = V2()
        for b in range(wp.static(NB)):
            pulled += wp.static(inertia_of[b])(world, pose.jacobians, m, normals, grad)
            own = wp.static(own_shifts[b])(world, pose.jacobians, m, normals)
            add2(grad, wp.static(col["com"] + 2 * b), frame_axes(pose.frames, own, b))
            wp.static(joints[b])(world, pose, m, normals, grad)
        add2(grad, wp.static(col["gravity"]), -m.h * pulled)
        for j in range(wp.static(s.nv)):
            if wp.static(j in s.armature):
                add(grad, wp.static(col["armature"] + j), rotor(m, normals, j))
            if wp.static(not s.implicit_damping):
                add(grad, wp.static(col["damping"] + j), m.h * m.p[j] * m.v[j])
            if wp.static(j in s.sprung):
                stretch = pose.q[j] - world.params[wp.static(col["rest"] + j)]
                add(grad, wp.static(col["stiffness"] + j), m.h * m.p[j] * stretch)
                pull = m.h * m.p[j] * world.params[wp.static(col["stiffness"] + j)]
                add(grad, wp.static(col["rest"] + j), -pull)
        if wp.static(s.implicit_damping):
            dampers(world, pose, m.p, y, m.h, grad)
        elif wp.static(len(springs) > 0):
            dampers(world, pose, m.p, m.h * m.v, m.h, grad)
        for i in range(wp.static(s.nu)):
            wp.static(drives[i])(world, m.h, m.p, u[i], grad)

    return SimpleNamespace(Motion=Motion, moving=moving, dampers=dampers, linear=linear)
