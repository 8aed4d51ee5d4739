"""Derivatives of the solved step by the implicit function theorem: v'(q, v, u) to first order.

At the solution F1 = M (v' - v) - h (r + u) - J' lambda = 0, and the contact law holds, F2 = 0. `linear.py`
has the factor of the law's equations, `rows_by_q.py` how they change with q, `respond.py` the answer column
by column. No iteration is differentiated.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..mechanism.dynamics_derivatives import make_mechanism_derivatives
from ..specialisation import Specialisation
from .linear import make_linear
from .respond import make_respond
from .rows_by_q import make_rows_by_q
from .trapezoidal import make_trapezoidal_expansion


@cached
def make_linearization(spec: Specialisation) -> SimpleNamespace:
    """linearize(world, x, sol) -> the first-order expansion `Linear` of v' (and z) at a step's solution, and
    d/d(q, v, u) of what positions move with, which `exists` or is refused; once(...): the same, faster and
    without refinement, so only where its factor is not near; beside it what curvature and gradients by
    parameters start from.
    """
    s, dtype, method = spec
    linear = make_linear(spec)
    step, Linear = linear.step, linear.Linear
    mech, t = step.mech, step.types
    trapezoidal = make_trapezoidal_expansion(spec) if method.trapezoidal else None

    def linearized_by(respond: wp.Function) -> wp.Function:
        @wp.func
        def linearize(world: t.World, x: t.VX, sol: step.Solution):
            q, v = step.split(x)
            lin = Linear()
            lin.pose = wp.static(mech.pose)(world, q)
            lin.w = sol.v - v
            if wp.static(method.trapezoidal):
                return trapezoidal(world, q, v, sol, lin)
            source = wp.static(step.free.source)(world, lin.pose, lin.w, v)
            lin = respond(world, sol, lin, source)
            return lin, lin.dv

        return linearize

    @wp.func
    def exists(dv: linear.DV, drift: linear.DV):
        """A law gives numbers that are none where it has no derivative."""
        known = not wp.isnan(dv[0, 0])
        if wp.static(method.trapezoidal):
            known = known and not wp.isnan(drift[0, 0])
        return known

    contact = make_rows_by_q(spec)
    return SimpleNamespace(
        step=step,
        response=linear.response,
        Linear=Linear,
        factored=linear.factored,
        linearize=linearized_by(make_respond(spec)),
        once=linearized_by(make_respond(spec, False)),
        exists=exists,
        motion=make_mechanism_derivatives(s, dtype, method.trapezoidal),
        pairs=contact.pairs,
        pair_mask=contact.pair_mask,
        NZ=linear.NZ,
        DV=linear.DV,
    )
