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
        def move(
            params: wp.array2d(dtype=dtype),
            row: int,
            jb: t.JB,
            m: Motion,
            external: wp.array2d(dtype=dtype),
            world: int,
        ):
            # mass, Jacobian of the centre of mass, its bias weights, acceleration, velocity under P
            jac = wp.static(motion.body_jacobians[body])(jb)
            weights = wp.static(mech.bias_weights[body])(m.v)
            acc = wp.static(motion.accelerations[body])(params, row, jac, m.w, weights, m.h, external, world)
            return params[row, wp.static(MASS + body)], jac, weights, acc, jac * m.p

        return move

    moves = tuple(make_move(b) for b in range(NB))

    def make_shift(body: int, frame: int) -> wp.Function:
        """Weight of a shift of the body's centre of mass in the axes of `frame`."""
        turn = turns[frame]

        @wp.func
        def shift(
            params: wp.array2d(dtype=dtype),
            row: int,
            jb: t.JB,
            m: Motion,
            rows: JR,
            external: wp.array2d(dtype=dtype),
            world: int,
        ):
            mass, jac, weights, acc, along = wp.static(moves[body])(params, row, jb, m, external, world)
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
        def rotation(
            params: wp.array2d(dtype=dtype),
            row: int,
            fr: t.FRAMES,
            jb: t.JB,
            m: Motion,
            rows: JR,
            external: wp.array2d(dtype=dtype),
            world: int,
        ):
            mass, jac, weights, acc, along = wp.static(moves[body])(params, row, jb, m, external, world)
            origin = wp.static(point)(params, row, fr, fr[wp.static(joint), 2], fr[wp.static(joint), 3])
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
        def slide(
            params: wp.array2d(dtype=dtype),
            row: int,
            jb: t.JB,
            m: Motion,
            rows: JR,
            external: wp.array2d(dtype=dtype),
            world: int,
        ):
            mass, jac, weights, acc, along = wp.static(moves[body])(params, row, jb, m, external, world)
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
        def inertial(
            params: wp.array2d(dtype=dtype),
            row: int,
            jb: t.JB,
            m: Motion,
            rows: JR,
            grad: wp.array2d(dtype=dtype),
            world: int,
        ):
            """Adds the gradient by mass and inertia; returns the mass-weighted P velocity (for gravity)."""
            mass, jac, _weights, acc, along = wp.static(moves[body])(
                params, row, jb, m, params, wp.static(-1)
            )
            by_mass = wp.dot(along, acc)
            by_inertia = turn(m.p) * turn(m.w)
            if wp.static(linear.response.scaled):
                for i in range(wp.static(NR)):
                    mi = rows[i]
                    velocity = jac * mi
                    by_mass -= m.kappa[i] * wp.dot(velocity, velocity)
                    by_inertia -= m.kappa[i] * turn(mi) * turn(mi)
            grad[world, wp.static(MASS + body)] = grad[world, wp.static(MASS + body)] + by_mass
            grad[world, wp.static(INERTIA + body)] = grad[world, wp.static(INERTIA + body)] + by_inertia
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
            params: wp.array2d(dtype=dtype),
            row: int,
            fr: t.FRAMES,
            jb: t.JB,
            q: VQ,
            motion: Motion,
            normals: JR,
            external: wp.array2d(dtype=dtype),
            world: int,
            grad: wp.array2d(dtype=dtype),
        ):
            place = V2()
            turned = ZERO
            direction = V2()
            for k in range(wp.static(len(moved))):
                place += wp.static(shifts[k])(params, row, jb, motion, normals, external, world)
                turned += wp.static(rotations[k])(params, row, fr, jb, motion, normals, external, world)
                if wp.static(sliding):
                    direction += wp.static(slides[k])(params, row, jb, motion, normals, external, world)
            place = frame_axes(fr, place, wp.static(parent))
            add2(grad, world, wp.static(col["anchor"] + 2 * j), place)
            add(grad, world, wp.static(col["angle"] + j), turned)
            if wp.static(sliding):
                direction = frame_axes(fr, direction, wp.static(parent))
                add2(grad, world, wp.static(col["axis"] + 2 * j), direction + q[wp.static(dof)] * place)

        return joint

    joints = tuple(make_joint(j) for j in range(NB))

    @wp.func
    def dampers(
        params: wp.array2d(dtype=dtype),
        row: int,
        fr: t.FRAMES,
        q: VQ,
        p: VQ,
        y: VQ,
        share: dtype,
        grad: wp.array2d(dtype=dtype),
        world: int,
    ):
        """Adds the derivative of P.C y, and of a share of what springs between points pull along P."""
        if wp.static(s.implicit_damping):
            for j in range(wp.static(s.nv)):
                add(grad, world, wp.static(col["damping"] + j), p[j] * y[j])
        for i in range(wp.static(len(springs))):
            wp.static(springs[i])(params, row, fr, q, y, p, share, grad, world)

    inertia_of = tuple(make_inertia(b) for b in range(NB))
    own_shifts = tuple(make_shift(b, b) for b in range(NB))

    @wp.func
    def moving(
        params: wp.array2d(dtype=dtype),
        row: int,
        fr: t.FRAMES,
        jb: t.JB,
        q: VQ,
        u: t.VU,
        m: Motion,
        y: VQ,
        normals: JR,
        external: wp.array2d(dtype=dtype),
        world: int,
        grad: wp.array2d(dtype=dtype),
    ):
        """Adds the derivative of the scalar by every column but h."""
        pulled = V2()
        for b in range(wp.static(NB)):
            pulled += wp.static(inertia_of[b])(params, row, jb, m, normals, grad, world)
            own = wp.static(own_shifts[b])(params, row, jb, m, normals, external, world)
            add2(grad, world, wp.static(col["com"] + 2 * b), frame_axes(fr, own, b))
            wp.static(joints[b])(params, row, fr, jb, q, m, normals, external, world, grad)
        add2(grad, world, wp.static(col["gravity"]), -m.h * pulled)
        for j in range(wp.static(s.nv)):
            if wp.static(not s.implicit_damping):
                add(grad, world, wp.static(col["damping"] + j), m.h * m.p[j] * m.v[j])
            if wp.static(j in s.sprung):
                stretch = q[j] - params[row, wp.static(col["rest"] + j)]
                add(grad, world, wp.static(col["stiffness"] + j), m.h * m.p[j] * stretch)
                pull = m.h * m.p[j] * params[row, wp.static(col["stiffness"] + j)]
                add(grad, world, wp.static(col["rest"] + j), -pull)
        if wp.static(s.implicit_damping):
            dampers(params, row, fr, q, m.p, y, m.h, grad, world)
        elif wp.static(len(springs) > 0):
            dampers(params, row, fr, q, m.p, m.h * m.v, m.h, grad, world)
        for i in range(wp.static(s.nu)):
            add(grad, world, wp.static(col["gear"] + i), -m.h * m.p[wp.static(s.actuators[i])] * u[i])

    return SimpleNamespace(Motion=Motion, moving=moving, dampers=dampers, linear=linear)
