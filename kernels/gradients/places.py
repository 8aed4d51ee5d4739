"""How a point that hangs on a chain of joints answers to the chain's lengths and angles, for gradients.

A scalar depends on a point of a body by its place and by velocities V(y) under joint rates y; its derivative
by the place at fixed velocities is `shift`, by V(y_a) and V(y_b) it is `a` and `b`. Shifting by e what hangs
on a frame adds perp(e) times the frame's rate of turning to V(y); turning it about a point o adds
perp(V(y) - V_o(y)).
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..mechanism.dynamics import make_mechanism
from ..structure import WORLD, Structure, layout


def below(s: Structure, body: int, joint: int) -> bool:
    """Whether `body` hangs on the joint of body `joint`."""
    while body != WORLD:
        if body == joint:
            return True
        body = s.bodies[body].parent
    return False


@cached
def make_places(s: Structure, dtype: type) -> SimpleNamespace:
    """Warp functions on places: perp, back, turns[body](y), frame_axes; add and add2 add to a gradient's
    columns; make_chain(body) adds the columns of all joints above a point of the body.
    """
    mech = make_mechanism(s, dtype)
    t = mech.types
    lay = layout(s)
    V2, VQ = t.V2, t.VQ
    ANCHOR, ANGLE, AXIS = (lay.offset(name) for name in ("anchor", "angle", "axis"))

    @wp.func
    def perp(a: V2):
        return V2(-a[1], a[0])

    @wp.func
    def back(a: V2):
        """The transpose of perp: perp(e).a = e.back(a)."""
        return V2(a[1], -a[0])

    @wp.func
    def frame_axes(fr: t.FRAMES, by: V2, body: int):
        """A weight on world directions in the axes of a body's frame."""
        if body < 0:
            return by
        c = fr[body, 0]
        sn = fr[body, 1]
        return V2(c * by[0] + sn * by[1], c * by[1] - sn * by[0])

    @wp.func
    def add(grad: wp.array(dtype=dtype), column: int, value: dtype):
        grad[column] = grad[column] + value

    @wp.func
    def add2(grad: wp.array(dtype=dtype), column: int, value: V2):
        grad[column] = grad[column] + value[0]
        grad[column + 1] = grad[column + 1] + value[1]

    def make_turn(body: int) -> wp.Function:
        TURN = VQ(*(dtype(float(s.turns(body, j))) for j in range(s.nv)))

        @wp.func
        def turn(y: VQ):
            """Rate of turning of a body (zero for the world)."""
            return wp.dot(wp.static(TURN), y)

        return turn

    turns = {body: make_turn(body) for body in range(-1, s.nb)}

    @cached
    def make_chain(body: int) -> wp.Function:
        """Returns the derivative by the point's own place in its body's axes; `turned` is what the scalar
        has beside from a rotation of the body.
        """
        above = tuple(j for j in range(s.nb) if body != WORLD and below(s, body, j))
        parents = tuple(s.bodies[j].parent for j in above)
        parent_turns = tuple(turns[b] for b in parents)
        sliding = tuple(s.bodies[j].joint == "prismatic" for j in above)
        dofs = tuple(s.bodies[j].dofs[0] for j in above)
        points = tuple(mech.point_jacobian(j) for j in above)
        own_turn = turns[body]

        @wp.func
        def chain(
            world: t.World,
            pose: t.Pose,
            place: V2,
            jac: t.J2,
            shift: V2,
            a: V2,
            ya: VQ,
            b: V2,
            yb: VQ,
            turned: dtype,
            grad: wp.array(dtype=dtype),
        ):
            for i in range(wp.static(len(above))):
                moved = shift + wp.static(parent_turns[i])(ya) * back(a)
                moved += wp.static(parent_turns[i])(yb) * back(b)
                moved = frame_axes(pose.frames, moved, wp.static(parents[i]))
                add2(grad, wp.static(ANCHOR + 2 * above[i]), moved)
                if wp.static(sliding[i]):
                    way = ya[wp.static(dofs[i])] * a + yb[wp.static(dofs[i])] * b
                    way = frame_axes(pose.frames, way, wp.static(parents[i]))
                    way += pose.q[wp.static(dofs[i])] * moved
                    add2(grad, wp.static(AXIS + 2 * above[i]), way)
                o = V2(pose.frames[wp.static(above[i]), 2], pose.frames[wp.static(above[i]), 3])
                origin = wp.static(points[i])(world, pose.frames, o[0], o[1])
                value = turned + wp.dot(shift, perp(place - o))
                value += wp.dot(a, perp(jac * ya - origin * ya)) + wp.dot(b, perp(jac * yb - origin * yb))
                add(grad, wp.static(ANGLE + above[i]), value)
            own = shift + own_turn(ya) * back(a) + own_turn(yb) * back(b)
            return frame_axes(pose.frames, own, wp.static(body))

        return chain

    return SimpleNamespace(
        perp=perp,
        back=back,
        turns=turns,
        frame_axes=frame_axes,
        add=add,
        add2=add2,
        make_chain=make_chain,
    )
