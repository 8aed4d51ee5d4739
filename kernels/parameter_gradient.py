"""Gradient of one solved step by the physical parameters, exact and in closed form.

For weights on v' let (P, rho) solve the transposed linear system, so that the weighted dv' is
-(P.dF1 + rho.dF2) with F1 = M w - h r - J' lambda, w = v' - v, and F2 = J v' + d/h - s(-z).
Every length and angle of the mechanism moves a part of it without changing the joints' motion: shifting
what hangs on a frame by e changes the velocity V(y) of its points under joint rates y by perp(e) times the
frame's rate of turning; turning it about a point o changes V(y) by perp(V(y) - V_o(y)). So each column
needs only velocities of points under the few joint rates in P.F1 + rho.F2: P, w, the bias weights, those of
every pair's rows, and M^-1 J_i' where D = diag(A).
"""

import functools

import warp as wp

from .method import Method
from .parameter_contact import make_pair_answer
from .parameter_motion import make_motion_gradient
from .parameter_places import below, make_places
from .parameter_springs import make_spring_gradient
from .sensitivity import make_linearization
from .shapes import oriented_ends, oriented_pair
from .structure import Structure, layout


def offered(method: Method) -> bool:
    """Whether the gradient by parameters exists for a method."""
    return (method.rem or method.hard) and not method.trapezoidal


@functools.cache
def make_parameter_gradient(s: Structure, dtype: type, method: Method) -> wp.Function:
    """gradient(params, row, x, u, external, world, sol, lin, weight, grad): adds to row `world` of `grad`
    the derivative of weight.v' by every column of the parameter table.
    """
    linear = make_linearization(s, dtype, method)
    step = linear.step
    mech, rows, t = step.mech, step.rows, step.types
    part = make_motion_gradient(s, dtype, method)
    places = make_places(s, dtype)
    lay = layout(s)
    V2, VQ, VX, VU, VR, JR = t.V2, t.VQ, t.VX, t.VU, t.VR, t.JR
    NR, NP, NB = s.nr, len(s.pairs), s.nb
    ZERO, HALF, TWO = dtype(0.0), dtype(0.5), dtype(2.0)
    col = {name: lay.offset(name) for name in lay.names}
    pairs = tuple(make_pair_answer(s, k, dtype) for k in range(NP))
    pair_rows = step.pair_rows
    pair_mask = tuple(sum(1 << i for i in pair_rows[k]) for k in range(NP))
    sign = tuple(dtype(float(r.sign)) for r in s.rows)
    subtree = tuple(tuple(b for b in range(NB) if below(s, b, k)) for k in range(NB))
    inertia_of = tuple(part.make_inertia(b) for b in range(NB))
    add, add2, frame_axes = places.add, places.add2, places.frame_axes
    springs = tuple(make_spring_gradient(s, i, dtype) for i in range(len(s.springs)))

    def make_joint(j: int) -> wp.Function:
        """Columns of one body's joint: anchor, angle and, if prismatic, axis."""
        parent = s.bodies[j].parent
        sliding = s.bodies[j].joint == "prismatic"
        dof = s.bodies[j].dofs[0]
        moved = subtree[j]
        shifts = tuple(part.make_shift(b, parent) for b in moved)
        rotations = tuple(part.make_rotation(b, j) for b in moved)
        slides = tuple(part.make_slide(b, dof) if sliding else None for b in moved)

        @wp.func
        def joint(
            params: wp.array2d(dtype=dtype),
            row: int,
            fr: t.FRAMES,
            jb: t.JB,
            q: VQ,
            motion: part.Motion,
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

    def make_side(k: int, b_side: bool) -> wp.Function:
        """Columns of what moves one shape of pair k: its own place and every joint above it."""
        shape, end = (pair[1 if b_side else 0] for pair in (oriented_pair(s, k), oriented_ends(s, k)))
        body, turned_shape = s.shapes[shape].body, s.shapes[shape].turned
        chain = places.make_chain(body)
        pose = step.pairs[k].pose_b if b_side else step.pairs[k].pose_a
        SIDE, END = dtype(1.0 if b_side else -1.0), dtype(float(end))
        ANGLE, HALF_LENGTH = col["shape_angle"] + shape, col["radius"] + 2 * shape + 1

        @wp.func
        def side(
            params: wp.array2d(dtype=dtype),
            row: int,
            fr: t.FRAMES,
            q: VQ,
            g: pairs[k].PairGeometry,
            out: pairs[k].Answer,
            yn: VQ,
            yt: VQ,
            grad: wp.array2d(dtype=dtype),
            world: int,
        ):
            n = wp.static(SIDE) * g.n
            tangent = places.perp(n)
            shift = wp.static(SIDE) * out.shift
            turned = out.turn_a
            jac = g.ja
            if wp.static(b_side):
                turned = out.turn_b
                jac = g.jb
            place = wp.static(pose)(params, row, fr)
            centre = V2(place[0], place[1])
            own = chain(params, row, fr, q, centre, jac, shift, n, yn, tangent, yt, turned, grad, world)
            add2(grad, world, wp.static(col["shape_offset"] + 2 * shape), own)
            if wp.static(end != 0):  # the end of a capsule: its centre is at half the length along the axis
                axis = V2(wp.static(dtype(1.0)), ZERO)
                if wp.static(turned_shape):
                    axis = V2(wp.cos(params[row, wp.static(ANGLE)]), wp.sin(params[row, wp.static(ANGLE)]))
                add(grad, world, wp.static(HALF_LENGTH), END * wp.dot(own, axis))
                turned += END * params[row, wp.static(HALF_LENGTH)] * wp.dot(own, places.perp(axis))
            add(grad, world, wp.static(ANGLE), turned)

        return side

    sides = tuple((make_side(k, False), make_side(k, True)) for k in range(NP))

    def make_contact(k: int) -> wp.Function:
        d = pairs[k]
        side_a, side_b = sides[k]
        frictional = len(pair_rows[k]) == 2

        @wp.func
        def contact(
            params: wp.array2d(dtype=dtype),
            row: int,
            fr: t.FRAMES,
            q: VQ,
            sol: step.Solution,
            lin: linear.Linear,
            motion: part.Motion,
            rho: VR,
            slides: VR,
            grad: wp.array2d(dtype=dtype),
            world: int,
        ):
            """Columns of one pair: its shapes' places and radii, friction."""
            g = wp.static(d.geometry)(params, row, fr, V2(sol.normal[2 * k], sol.normal[2 * k + 1]))
            yn = VQ()
            yt = VQ()
            ymu = VQ()
            gap = ZERO
            for i in range(wp.static(NR)):
                if wp.static(i in pair_rows[k]):
                    if (sol.mask & wp.static(1 << i)) != 0:
                        y = rho[i] * sol.v - sol.lam[i] * motion.p
                        if wp.static(method.scaled):
                            y += (TWO * motion.kappa[i]) * lin.m[i]
                        if wp.static(method.state_noise):
                            y += motion.spread[i]
                        if wp.static(rows.tangent[i]):
                            yt += y
                            # lambda_t = +-mu lambda_n, of the normal row before it
                            ymu -= (slides[i] * sol.lam[wp.static(max(i - 1, 0))]) * motion.p
                        else:
                            yn += y
                            gap += rho[i] / motion.h
                        if wp.static(frictional and not method.coulomb):
                            yt += (wp.static(sign[i]) * params[row, wp.static(col["friction"] + k)]) * y
                            ymu += wp.static(sign[i]) * y
            out = wp.static(d.answer)(g, gap, yn, yt, ymu)
            wp.static(d.radii)(params, row, fr, g, out, grad, world)
            side_a(params, row, fr, q, g, out, yn, yt, grad, world)
            side_b(params, row, fr, q, g, out, yn, yt, grad, world)
            if wp.static(frictional):
                add(grad, world, wp.static(col["friction"] + k), out.by_friction)

        return contact

    contacts = tuple(make_contact(k) for k in range(NP))

    def make_level(i: int) -> wp.Function:
        POSITION, VELOCITY = (col.get(f"{name}_covariance", 0) for name in ("position", "velocity"))

        @wp.func
        def level(
            params: wp.array2d(dtype=dtype),
            row: int,
            sol: step.Solution,
            by_sigma: dtype,
            h: dtype,
            grad: wp.array2d(dtype=dtype),
            world: int,
        ):
            """Columns of the covariances by row i, and their part in that of h; from sigma dG/dsigma, with
            sigma^2 = J_i C J_i', eq. (18). Returns the weight of dJ_i.
            """
            j = wp.static(rows.adds[i])(VQ(), sol.jac, wp.static(dtype(1.0)))
            share = by_sigma / (sol.sigma[wp.static(i)] * sol.sigma[wp.static(i)])
            by_h = ZERO
            for a in range(wp.static(s.nv)):
                for b in range(wp.static(s.nv)):
                    value = HALF * share * j[a] * j[b]
                    add(grad, world, wp.static(VELOCITY) + wp.static(s.nv) * a + b, value)
                    value = value / (h * h)
                    add(grad, world, wp.static(POSITION) + wp.static(s.nv) * a + b, value)
                    by_h -= TWO * value * params[row, wp.static(POSITION) + wp.static(s.nv) * a + b] / h
            add(grad, world, wp.static(col["step_size"]), by_h)
            return share * step.noise.spread(params, row, j)

        return level

    levels = tuple(make_level(i) for i in range(NR))

    @wp.func
    def row_columns(
        params: wp.array2d(dtype=dtype),
        row: int,
        sol: step.Solution,
        lin: linear.Linear,
        motion: part.Motion,
        rho: VR,
        grad: wp.array2d(dtype=dtype),
        world: int,
    ):
        """Columns of limits, sigma and what the rows add to that of the step size; fills motion.spread."""
        for i in range(wp.static(NR)):
            if (sol.mask & wp.static(1 << i)) != 0:
                push = wp.static(rows.dots[i])(sol.jac, motion.p)
                if wp.static(s.rows[i].kind == "limit" and s.rows[i].sign > 0):
                    add(grad, world, wp.static(col["lower"] + s.rows[i].index), -rho[i] / motion.h)
                if wp.static(s.rows[i].kind == "limit" and s.rows[i].sign < 0):
                    add(grad, world, wp.static(col["upper"] + s.rows[i].index), rho[i] / motion.h)
                if wp.static(not method.hard):
                    # s = D lambda, and ds/dsigma = (s - z s')/sigma, the same at z and at -z
                    rise = sol.lam[i] * sol.scale[i] - sol.z[i] * lin.slope[i]
                    by_sigma = -rise * (push / sol.scale[i] + rho[i])
                    if wp.static(method.state_noise):
                        motion.spread[i] = wp.static(levels[i])(
                            params, row, sol, by_sigma, motion.h, grad, world
                        )
                    else:
                        by_sigma = by_sigma / params[row, wp.static(col["sigma"] + i)]
                        add(grad, world, wp.static(col["sigma"] + i), by_sigma)
                by_step = (sol.lam[i] * push - rho[i] * sol.rate[i]) / motion.h
                add(grad, world, wp.static(col["step_size"]), by_step)
        return motion

    @wp.func
    def gradient(
        params: wp.array2d(dtype=dtype),
        row: int,
        x: VX,
        u: VU,
        external: wp.array2d(dtype=dtype),
        world: int,
        sol: step.Solution,
        lin: linear.Linear,
        weight: VQ,
        grad: wp.array2d(dtype=dtype),
    ):
        p, rho, slides = wp.static(linear.transposed)(sol, lin, weight)
        p = -p
        rho = -rho
        q = VQ()
        motion = part.Motion()
        for j in range(wp.static(s.nv)):
            q[j] = x[j]
            motion.v[j] = x[wp.static(s.nv + j)]
        h = params[row, wp.static(col["step_size"])]
        motion.p = p
        motion.w = lin.w
        motion.h = h
        if wp.static(method.scaled):
            for i in range(wp.static(NR)):
                if (sol.mask & wp.static(1 << i)) != 0:
                    motion.kappa[i] = wp.static(rows.dots[i])(sol.jac, p) * sol.lam[i] / sol.scale[i]
        fr = wp.static(mech.frames)(params, row, q)
        pulled = V2()
        for b in range(wp.static(NB)):
            pulled += wp.static(inertia_of[b])(params, row, lin.jb, motion, lin.m, grad, world)
            own = wp.static(part.make_shift(b, b))(params, row, lin.jb, motion, lin.m, external, world)
            add2(grad, world, wp.static(col["com"] + 2 * b), frame_axes(fr, own, b))
            wp.static(joints[b])(params, row, fr, lin.jb, q, motion, lin.m, external, world, grad)
        add2(grad, world, wp.static(col["gravity"]), -h * pulled)
        for j in range(wp.static(s.nv)):
            add(grad, world, wp.static(col["damping"] + j), h * p[j] * motion.v[j])
        for i in range(wp.static(len(s.sprung))):
            stretch = q[wp.static(s.sprung[i])] - params[row, wp.static(col["rest"] + s.sprung[i])]
            add(
                grad,
                world,
                wp.static(col["stiffness"] + s.sprung[i]),
                h * p[wp.static(s.sprung[i])] * stretch,
            )
            pull = h * p[wp.static(s.sprung[i])] * params[row, wp.static(col["stiffness"] + s.sprung[i])]
            add(grad, world, wp.static(col["rest"] + s.sprung[i]), -pull)
        for i in range(wp.static(len(springs))):
            wp.static(springs[i])(params, row, fr, q, motion.v, p, h, grad, world)
        for i in range(wp.static(s.nu)):
            add(grad, world, wp.static(col["gear"] + i), -h * p[wp.static(s.actuators[i])] * u[i])
        mass = wp.static(mech.mass_matrix)(params, row, lin.jb)
        add(grad, world, wp.static(col["step_size"]), -wp.dot(p, mass * lin.w) / h)
        if sol.mask != 0:
            motion = row_columns(params, row, sol, lin, motion, rho, grad, world)
            for k in range(wp.static(NP)):
                if (sol.mask & wp.static(pair_mask[k])) != 0:
                    wp.static(contacts[k])(params, row, fr, q, sol, lin, motion, rho, slides, grad, world)

    return gradient
