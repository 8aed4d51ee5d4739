"""First-order expansion of a step of the trapezoidal integrator.

F1 = M (v' - v_free) - J' lambda, where v_free(q, v, u) has derivatives of its own, and so for the velocity v*
that positions move with: the predictor, the drift and v' in turn, as the step solves them.
"""

import warp as wp

from ..factories import cached
from ..specialisation import Specialisation
from ..structure import layout
from .linear import make_linear
from .respond import make_respond


@cached
def make_trapezoidal_expansion(spec: Specialisation) -> wp.Function:
    """expand(world, q, v, sol, start) -> Linear of v', d v*/d(q, v, u)."""
    s, dtype, method = spec
    linear = make_linear(spec)
    step, t = linear.step, linear.step.types
    respond = make_respond(spec)
    DV = linear.DV
    HALF = dtype(0.5)
    H = layout(s).offset("step_size")

    @wp.func
    def expand(world: t.World, q: t.VQ, v: t.VQ, sol: step.Solution, start: linear.Linear):
        h = world.params[wp.static(H)]
        first, moving = step.parts(world, start.pose, v, sol)
        now = first
        reached = sol.unpushed
        acceleration = sol.acceleration - sol.push / h
        dforce = DV()  # of the predicted contact forces
        dpush = DV()
        free = DV()
        drift = DV()
        lin = start
        part = int(0)
        while part < 3:
            if part < 2:
                free = wp.static(step.free.by_state)(
                    world, start.pose, sol.minv, v, reached, acceleration, dforce
                )
                free = free - dpush
            given = free
            if part == 1:
                given = HALF * free
                for j in range(wp.static(s.nv)):
                    given[j, wp.static(s.nv + j)] = given[j, wp.static(s.nv + j)] + HALF
            source = wp.static(step.free.held)(world, start.pose, now.v - now.vfree, given)
            lin = respond(world, now, start, source)
            if part == 0:
                dpush = lin.dv - free
                dforce = wp.static(step.free.held)(world, start.pose, -sol.push, dpush) / h
                reached = sol.vfree + sol.push
                acceleration = sol.acceleration
                now = moving
            elif part == 1:
                drift = lin.dv
                now = sol
            part += 1
        return lin, drift

    return expand
