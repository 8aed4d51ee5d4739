"""The rows' part of the gradient by parameters: limits, noise levels, and all that moves a contact's shapes.

See `solvers/dual.py` for the scalar and `parameters.py` for the rule.
"""

import warp as wp

from ..contact.shapes import make_shape_size, oriented_ends, oriented_pair
from ..contact.sided import make_core
from ..derivatives.sensitivity import make_linearization
from ..factories import cached
from ..solvers.dual import make_dual
from ..specialisation import Specialisation
from ..structure import CORNERS, layout
from .contact import make_pair_answer
from .places import make_places


@cached
def make_row_gradient(spec: Specialisation) -> wp.Function:
    """constraints(world, pose, sol, lin, dual, h, grad): adds a solved problem's."""
    s, dtype, method = spec
    linear = make_linearization(spec)
    step, response, Dual = linear.step, linear.response, make_dual(s, dtype)
    rows, t = step.rows, step.types
    places = make_places(s, dtype)
    lay = layout(s)
    V2, VQ = t.V2, t.VQ
    NR, NP = s.nr, len(s.pairs)
    ZERO, HALF, TWO = dtype(0.0), dtype(0.5), dtype(2.0)
    col = {name: lay.offset(name) for name in lay.names}
    pairs = tuple(make_pair_answer(s, k, dtype) for k in range(NP))
    pair_rows = step.pair_rows
    pair_mask = linear.pair_mask
    sign = tuple(dtype(float(r.sign)) for r in s.rows)
    add, add2 = places.add, places.add2

    def make_side(k: int, b_side: bool) -> wp.Function:
        """Columns of what moves one shape of pair k: its own place and every joint above it."""
        shape, end = (pair[1 if b_side else 0] for pair in (oriented_pair(s, k), oriented_ends(s, k)))
        body, turned_shape = s.shapes[shape].body, s.shapes[shape].turned
        chain = places.make_chain(body)
        shape_pose = step.pairs[k].pose_b if b_side else step.pairs[k].pose_a
        SIDE, END = dtype(1.0 if b_side else -1.0), dtype(float(end))
        ANGLE, HALF_LENGTH = col["shape_angle"] + shape, col["radius"] + 2 * shape + 1
        CORNER = col["corner_radius"] + shape if end in CORNERS else 0
        SIGN_X, SIGN_Y = map(dtype, CORNERS.get(end, (0.0, 0.0)))
        size, core = make_shape_size(s, shape, dtype), make_core(dtype)

        @wp.func
        def side(
            world: t.World,
            pose: t.Pose,
            g: pairs[k].PairGeometry,
            out: pairs[k].Answer,
            yn: VQ,
            yt: VQ,
            grad: wp.array(dtype=dtype),
        ):
            n = wp.static(SIDE) * g.n
            tangent = places.perp(n)
            shift = wp.static(SIDE) * out.shift
            turned = out.turn_a
            jac = g.ja
            if wp.static(b_side):
                turned = out.turn_b
                jac = g.jb
            place = wp.static(shape_pose)(world, pose.frames)
            centre = V2(place[0], place[1])
            own = chain(world, pose, centre, jac, shift, n, yn, tangent, yt, turned, grad)
            add2(grad, wp.static(col["shape_offset"] + 2 * shape), own)
            axis = V2(wp.static(dtype(1.0)), ZERO)
            if wp.static(end != 0 and turned_shape):
                axis = V2(wp.cos(world.params[wp.static(ANGLE)]), wp.sin(world.params[wp.static(ANGLE)]))
            if wp.static(end in CORNERS):  # its centre is at a corner of the core
                half = core(size(world))
                x = SIGN_X * wp.dot(own, axis)
                y = SIGN_Y * wp.dot(own, places.perp(axis))
                add(grad, wp.static(HALF_LENGTH - 1), x)
                add(grad, wp.static(HALF_LENGTH), y)
                add(grad, wp.static(CORNER), -x - y)
                turned += half[0] * SIGN_X * wp.dot(own, places.perp(axis)) - half[1] * SIGN_Y * wp.dot(
                    own, axis
                )
            elif wp.static(end != 0):  # the end of a capsule: its centre is at half the length along the axis
                add(grad, wp.static(HALF_LENGTH), END * wp.dot(own, axis))
                turned += END * world.params[wp.static(HALF_LENGTH)] * wp.dot(own, places.perp(axis))
            add(grad, wp.static(ANGLE), turned)

        return side

    sides = tuple((make_side(k, False), make_side(k, True)) for k in range(NP))

    def make_contact(k: int) -> wp.Function:
        d = pairs[k]
        side_a, side_b = sides[k]
        frictional = len(pair_rows[k]) == 2

        @wp.func
        def contact(
            world: t.World,
            pose: t.Pose,
            sol: step.Solution,
            lin: linear.Linear,
            dual: Dual,
            h: dtype,
            grad: wp.array(dtype=dtype),
        ):
            """Columns of one pair: its shapes' places and radii, friction."""
            g = wp.static(d.geometry)(world, pose.frames, V2(sol.normal[2 * k], sol.normal[2 * k + 1]))
            yn = VQ()
            yt = VQ()
            ymu = VQ()
            gap = ZERO
            for i in range(wp.static(NR)):
                if wp.static(i in pair_rows[k]):
                    if (sol.mask & wp.static(1 << i)) != 0:
                        y = dual.rho[i] * sol.v - sol.lam[i] * dual.p
                        if wp.static(response.scaled):
                            y += (TWO * dual.kappa[i]) * lin.rows.m[i]
                        if wp.static(method.state_noise or response.complete is not None):
                            y += dual.bend[i]
                        if wp.static(rows.tangent[i]):
                            yt += y
                            # lambda_t = +-mu lambda_n, of the normal row before it
                            ymu -= (dual.slides[i] * sol.lam[wp.static(max(i - 1, 0))]) * dual.p
                        else:
                            yn += y
                            gap += dual.rho[i] / h
                        if wp.static(frictional and not rows.tangent[pair_rows[k][-1]]):
                            yt += (wp.static(sign[i]) * world.params[wp.static(col["friction"] + k)]) * y
                            ymu += wp.static(sign[i]) * y
            out = wp.static(d.answer)(g, gap, yn, yt, ymu)
            wp.static(d.radii)(world, pose.frames, g, out, grad)
            side_a(world, pose, g, out, yn, yt, grad)
            side_b(world, pose, g, out, yn, yt, grad)
            if wp.static(frictional):
                add(grad, wp.static(col["friction"] + k), out.by_friction)

        return contact

    contacts = tuple(make_contact(k) for k in range(NP))

    def make_level(i: int) -> wp.Function:
        POSITION, VELOCITY = (col.get(f"{name}_covariance", 0) for name in ("position", "velocity"))

        @wp.func
        def level(world: t.World, sol: step.Solution, by_sigma: dtype, h: dtype, grad: wp.array(dtype=dtype)):
            """Columns of the covariances by row i, and their part in that of h; from sigma dG/dsigma, with
            sigma^2 = J_i C J_i', eq. (18). Returns the weight of dJ_i.
            """
            j = wp.static(rows.adds[i])(VQ(), sol.jac, wp.static(dtype(1.0)))
            share = by_sigma / (sol.sigma[wp.static(i)] * sol.sigma[wp.static(i)])
            by_h = ZERO
            for a in range(wp.static(s.nv)):
                for b in range(wp.static(s.nv)):
                    value = HALF * share * j[a] * j[b]
                    add(grad, wp.static(VELOCITY) + wp.static(s.nv) * a + b, value)
                    value = value / (h * h)
                    add(grad, wp.static(POSITION) + wp.static(s.nv) * a + b, value)
                    by_h -= TWO * value * world.params[wp.static(POSITION) + wp.static(s.nv) * a + b] / h
            add(grad, wp.static(col["step_size"]), by_h)
            return share * step.noise.spread(world, j)

        return level

    levels = tuple(make_level(i) for i in range(NR))

    @wp.func
    def row_columns(world: t.World, sol: step.Solution, start: Dual, h: dtype, grad: wp.array(dtype=dtype)):
        """Columns of limits, sigma, and h through d/h and eq. (18); adds what that does to `bend`."""
        dual = start
        for i in range(wp.static(NR)):
            if (sol.mask & wp.static(1 << i)) != 0:
                rate = dual.rho[i] / h
                if wp.static(s.rows[i].kind == "limit" and s.rows[i].sign > 0):
                    add(grad, wp.static(col["lower"] + s.rows[i].index), -rate)
                if wp.static(s.rows[i].kind == "limit" and s.rows[i].sign < 0):
                    add(grad, wp.static(col["upper"] + s.rows[i].index), rate)
                add(grad, wp.static(col["step_size"]), -rate * sol.rate[i])
                if wp.static(method.state_noise):
                    bent = wp.static(levels[i])(world, sol, dual.sigma[i], h, grad)
                    dual.bend[i] = dual.bend[i] + bent
                elif wp.static(not method.hard):
                    by_sigma = dual.sigma[i] / world.params[wp.static(col["sigma"] + i)]
                    add(grad, wp.static(col["sigma"] + i), by_sigma)
        return dual

    @wp.func
    def constraints(
        world: t.World,
        pose: t.Pose,
        sol: step.Solution,
        lin: linear.Linear,
        start: Dual,
        h: dtype,
        grad: wp.array(dtype=dtype),
    ):
        if sol.mask != 0:
            dual = row_columns(world, sol, start, h, grad)
            for k in range(wp.static(NP)):
                if (sol.mask & wp.static(pair_mask[k])) != 0:
                    wp.static(contacts[k])(world, pose, sol, lin, dual, h, grad)

    return constraints
