"""The motion part of the gradient by parameters: masses, inertias and places of the centres of mass.

See `parameter_gradient.py` for the rule. The scalar is P.(M w - h r) - sum_i kappa_i m_i' M m_i, with
m_i = M^-1 J_i' and the last term only under inertia scaling.
"""

import functools
from types import SimpleNamespace

import warp as wp

from .method import Method
from .parameter_places import make_places
from .sensitivity import make_linearization
from .structure import Structure, layout


@functools.cache
def make_motion_gradient(s: Structure, dtype: type, method: Method) -> SimpleNamespace:
    """Warp functions of the motion part: mass, inertia and displacements of centres of mass."""
    linear = make_linearization(s, dtype, method)
    mech, motion, t = linear.step.mech, linear.motion, linear.step.types
    places = make_places(s, dtype)
    lay = layout(s)
    VQ, VR, JR = t.VQ, t.VR, t.JR
    NR = s.nr
    TWO = dtype(2.0)
    MASS, INERTIA = lay.offset("mass"), lay.offset("inertia")

    @wp.struct
    class Motion:
        p: VQ  # P
        w: VQ  # v' - v
        v: VQ
        h: dtype
        spread: JR  # weight of dJ_i through sigma, eq. (18); zero without state noise
        kappa: VR  # (J_i P) lambda_i/D_i, the weight of dD_i; zero without inertia scaling

    perp, back, turns = places.perp, places.back, places.turns

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
            mass = params[row, wp.static(MASS + body)]
            jac = wp.static(motion.body_jacobians[body])(jb)
            weights = wp.static(mech.bias_weights[body])(m.v)
            acc = wp.static(motion.accelerations[body])(params, row, jac, m.w, weights, m.h, external, world)
            along = jac * m.p
            out = mass * (turn(m.p) * back(acc) + turn(m.w) * back(along) - (m.h * turn(weights)) * along)
            if wp.static(method.scaled):
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
            mass = params[row, wp.static(MASS + body)]
            jac = wp.static(motion.body_jacobians[body])(jb)
            weights = wp.static(mech.bias_weights[body])(m.v)
            acc = wp.static(motion.accelerations[body])(params, row, jac, m.w, weights, m.h, external, world)
            origin = wp.static(point)(params, row, fr, fr[wp.static(joint), 2], fr[wp.static(joint), 3])
            along = jac * m.p
            turned = perp(along - origin * m.p)
            change = perp(jac * m.w - origin * m.w) - m.h * (jac * weights - origin * weights)
            out = mass * (wp.dot(turned, acc) + wp.dot(along, change))
            if wp.static(method.scaled):
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
            mass = params[row, wp.static(MASS + body)]
            jac = wp.static(motion.body_jacobians[body])(jb)
            weights = wp.static(mech.bias_weights[body])(m.v)
            acc = wp.static(motion.accelerations[body])(params, row, jac, m.w, weights, m.h, external, world)
            along = jac * m.p
            out = mass * (m.p[dof] * acc + m.w[dof] * along + (m.h * weights[dof]) * back(along))
            if wp.static(method.scaled):
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
            mass = params[row, wp.static(MASS + body)]
            jac = wp.static(motion.body_jacobians[body])(jb)
            weights = wp.static(mech.bias_weights[body])(m.v)
            acc = wp.static(motion.accelerations[body])(
                params, row, jac, m.w, weights, m.h, params, wp.static(-1)
            )
            along = jac * m.p
            by_mass = wp.dot(along, acc)
            by_inertia = turn(m.p) * turn(m.w)
            if wp.static(method.scaled):
                for i in range(wp.static(NR)):
                    mi = rows[i]
                    velocity = jac * mi
                    by_mass -= m.kappa[i] * wp.dot(velocity, velocity)
                    by_inertia -= m.kappa[i] * turn(mi) * turn(mi)
            grad[world, wp.static(MASS + body)] = grad[world, wp.static(MASS + body)] + by_mass
            grad[world, wp.static(INERTIA + body)] = grad[world, wp.static(INERTIA + body)] + by_inertia
            return mass * along

        return inertial

    return SimpleNamespace(
        Motion=Motion,
        make_shift=functools.cache(make_shift),
        make_rotation=functools.cache(make_rotation),
        make_slide=functools.cache(make_slide),
        make_inertia=make_inertia,
    )
