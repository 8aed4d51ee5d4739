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
from .leap import make_leap
from .passes import make_passes
from .room import OLD, Room, View
from .rows import make_rows
from .solved import make_solved


@cached
def make_step_adjoint(given: type, residual: str, graded: bool) -> SimpleNamespace:
    """solve(..., x, u): the step anew, 1 if it is solved. pull(...): from w.weight, of the state after it,
    slopes by q and v (w.by_q, w.by_v) and, if `graded`, by the parameters (added to w.grad), 1 if these hold:
    `aim`, P and rho, then `slopes`; coriolis(..., share): slopes by v (w.by_v) of Coriolis
    forces. control(..., i, u): that by a control.
    """
    step, z = make_step(given, residual), make_solved(given, graded)
    contact = residual != "none"
    rows = make_rows(given, residual, graded) if contact else None
    dual, passes = make_dual(given, residual), make_passes(given, graded)
    motion, leap = passes.motion, make_leap(given, graded)
    number, add = z.number, z.add
    H = z.COLUMN["step_size"]
    ZERO, ONE, HALF = WORK(0.0), WORK(1.0), WORK(0.5)

    @wp.func
    def begin(
        t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View],
        external: wp.array2d(dtype=given), world: int, u: wp.array(dtype=given),
    ):  # fmt: skip
        for j in range(t.nv):
            k.q[j] = w.q[j]
            k.v0[j] = w.rates[wp.static(OLD) * t.nv + j]
        step.begin(t, k, external, world)
        for i in range(t.nu):
            step.control_force(t, k, i, WORK(u[i]))

    @wp.func
    def solve(
        t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View],
        external: wp.array2d(dtype=given), world: int, x: wp.array(dtype=given), u: wp.array(dtype=given),
    ):  # fmt: skip
        for j in range(t.nv):
            w.q[j] = WORK(x[j])
            w.rates[wp.static(OLD) * t.nv + j] = WORK(x[t.nv + j])
        begin(t, k, w, external, world, u)
        code = step.solve_step(t, k)
        return wp.where(code == wp.static(SOLVED), 1, 0)

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
        external: wp.array2d(dtype=given), world: int, leaps: int,
    ):  # fmt: skip
        """By q, v and the parameters at these P and rho; if it `leaps`, by p (`leap.py`)."""
        by_h = WORK(0.0)
        for j in range(t.nv):
            by_h += w.weight[j] * k.v[t.dof_block[j]][t.dof_part[j]]
            w.by_q[j] = w.weight[j]
            w.by_v[j] = ZERO
        add(t, w, H, 0, by_h)
        z.rates(t, k, w)
        share = ZERO + ONE  # of the Coriolis forces, those at v
        if leaps == 1:
            leap.by_predicted(t, k, w)
            share = HALF
        passes.rise(t, k, w)
        passes.bodies(t, k, w, share, ONE, external, world)
        motion.joints(t, k, w)
        for i in range(t.springs):
            motion.spring(t, k, w, i)
        if wp.static(contact):
            rows.constraints(t, s, k, room, w)
        passes.fall(t, k, w)

    @wp.func
    def coriolis(t: wp.ref[Topology], k: wp.ref[Slot], w: wp.ref[View], share: WORK):
        """At the rates that are there, of a share."""
        for j in range(t.nv):
            w.by_v[j] = ZERO
        passes.turn(t, k, w, share)

    @wp.func(inline=False)
    def pull(
        t: wp.ref[Topology], s: wp.ref[Groups], k: wp.ref[Slot], room: wp.ref[Room], w: wp.ref[View],
        slot: int, external: wp.array2d(dtype=given), world: int, u: wp.array(dtype=given),
    ):  # fmt: skip
        parts = int(1 + t.leapfrog)
        for part in range(parts):
            if part == 1:
                leap.hold(t, w)
                begin(t, k, w, external, world, u)
                if step.solve(t, k, 0, 0) != wp.static(SOLVED):
                    return int(0)
                if leap.same(t, k) == 0:
                    return int(0)
            aim(t, k, w)
            if dual.weights(t, k, room, w, slot) == 0:
                return int(0)
            slopes(t, s, k, room, w, external, world, parts - 1 - part)
        if parts == 2:
            leap.join(t, w)
        return int(1)

    return SimpleNamespace(
        prepare=step.prepare,
        solve=solve,
        aim=aim,
        slopes=slopes,
        pull=pull,
        coriolis=coriolis,
        leap=leap,
        control=motion.control,
        dual=dual,
        rates=z.rates,
        at_edge=rows.at_edge if contact else None,
    )
