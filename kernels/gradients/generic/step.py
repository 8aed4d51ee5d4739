"""The adjoint of one solved step of any scene: from slopes by the state after it to all that it came from.

Nothing is differentiated through iterations: one system with the transposed matrix of the solution, then a
pass over bodies, joints, springs and rows, and one from the leaves to the roots. No factor of more than these
items occurs.
"""

from types import SimpleNamespace

import warp as wp

from ...factories import cached
from ...generic.derivatives.tables import Groups
from ...generic.step import make_step
from ...generic.topology import Topology
from ...generic.work import V3, WORK, Slot
from ...status import SOLVED
from .dual import make_dual
from .motion import make_motion
from .room import OLD, ROW, Room, View
from .rows import make_rows
from .solved import make_solved


@cached
def make_step_adjoint(given: type, residual: str, graded: bool) -> SimpleNamespace:
    """solve(..., x, u): the step anew, 1 if it is solved. pull(...): from w.weight, of the state after it,
    slopes by q and v (w.by_q, w.by_v) and, if `graded`, by the parameters (added to w.grad), 1 if these hold:
    `aim`, P and rho, then `slopes`; turning(...): slopes by v (w.by_v) of the bodies' part. control(...,
    i, u): that by a control.
    """
    step, z = make_step(given, residual), make_solved(given, graded)
    contact = residual != "none"
    rows = make_rows(given, residual, graded) if contact else None
    dual, motion = make_dual(given, residual), make_motion(given, graded)
    move = motion.twists
    number, add = z.number, z.add
    H = z.COLUMN["step_size"]
    ZERO = WORK(0.0)

    @wp.func
    def solve(
        t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View],
        external: wp.array2d(dtype=given), world: int, x: wp.array(dtype=given), u: wp.array(dtype=given),
    ):  # fmt: skip
        for j in range(t.nv):
            w.q[j] = WORK(x[j])
            w.rates[wp.static(OLD) * t.nv + j] = WORK(x[t.nv + j])
            k.q[j] = w.q[j]
            k.v0[j] = WORK(x[t.nv + j])
        step.begin(t, k, external, world)
        for i in range(t.nu):
            step.control_force(t, k, i, WORK(u[i]))
        code = step.solve_step(t, k)
        return wp.where(code == wp.static(SOLVED), 1, 0)

    @wp.func(inline=False)
    def rise(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View]):
        """Twists from the roots; no slopes yet."""
        sets = int(wp.static(ROW))  # a number that is not unrolled
        for i in range(t.nb):
            for set in range(sets):
                move.advance(t, k, w, set, i)
                w.by_twist[set * t.nb + i] = wp.vec3d()
            move.accelerate(t, k, w, i)
            w.by_acceleration[i] = wp.vec2d()
            w.by_frame[i] = wp.vec3d()
            w.by_arm[i] = wp.vec2d()

    @wp.func(inline=False)
    def fall(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View]):
        """Slopes to the roots."""
        sets = int(wp.static(ROW))
        for back in range(t.nb):
            i = t.nb - 1 - back
            for set in range(sets):
                move.pull(t, k, w, set, i)
            move.settle(t, k, w, i)

    @wp.func
    def aim(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View]):
        """w.target: what w.weight, of the state after the step, weighs v' by."""
        h = number(t, k, H, 0)
        for i in range(t.blocks):
            w.target[i] = V3()
        for j in range(t.nv):
            b = t.dof_block[j]
            w.target[b][t.dof_part[j]] = w.weight[t.nv + j] + h * w.weight[j]

    @wp.func(inline=False)
    def slopes(
        t: wp.ref[Topology], s: wp.ref[Groups], k: wp.ref[Slot], room: wp.ref[Room], w: wp.ref[View],
        external: wp.array2d(dtype=given), world: int,
    ):  # fmt: skip
        """By q, v and the parameters at these P and rho."""
        by_h = WORK(0.0)
        for j in range(t.nv):
            by_h += w.weight[j] * k.v[t.dof_block[j]][t.dof_part[j]]
            w.by_q[j] = w.weight[j]
            w.by_v[j] = ZERO
        add(t, w, H, 0, by_h)
        z.rates(t, k, w)
        rise(t, k, w)
        for i in range(t.nb):
            force = wp.vec3d()
            if external.shape[0] > 0:
                for n in range(3):
                    force[n] = WORK(external[world, 3 * i + n])
            motion.body(t, k, w, i, force)
        motion.joints(t, k, w)
        for i in range(t.springs):
            motion.spring(t, k, w, i)
        if wp.static(contact):
            rows.constraints(t, s, k, room, w)
        fall(t, k, w)

    @wp.func
    def turning(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View]):
        """At the rates that are there."""
        for j in range(t.nv):
            w.by_v[j] = ZERO
        rise(t, k, w)
        for i in range(t.nb):
            motion.body(t, k, w, i, wp.vec3d())
        fall(t, k, w)

    @wp.func
    def pull(
        t: wp.ref[Topology], s: wp.ref[Groups], k: wp.ref[Slot], room: wp.ref[Room], w: wp.ref[View],
        slot: int, external: wp.array2d(dtype=given), world: int,
    ):  # fmt: skip
        aim(t, k, w)
        if dual.weights(t, k, room, w, slot) == 0:
            return int(0)
        slopes(t, s, k, room, w, external, world)
        return int(1)

    return SimpleNamespace(
        prepare=step.prepare,
        solve=solve,
        aim=aim,
        slopes=slopes,
        pull=pull,
        turning=turning,
        control=motion.control,
        dual=dual,
        rates=z.rates,
        at_edge=rows.at_edge if contact else None,
    )
