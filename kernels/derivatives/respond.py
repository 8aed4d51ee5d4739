"""How the solution of a contact problem answers to (q, v, u), by the implicit function theorem."""

import warp as wp

from ..device.seldom import seldom
from ..factories import cached
from ..specialisation import Specialisation
from .linear import make_linear
from .rows_by_q import make_rows_by_q


@cached
def make_respond(spec: Specialisation, refines: bool = True) -> wp.Function:
    """respond(world, sol, start, source) -> Linear.

    `source` is -F1_(q, v, u) without the contact's part. refines: what asks for refinement is refined; no
    column is a number where that finds none. Otherwise whoever looks at `factor.near` has to.
    """
    s, dtype, method = spec
    linear = make_linear(spec)
    step, response, Linear = linear.step, linear.response, linear.Linear
    contact = make_rows_by_q(spec)
    t = step.types
    VQ, VR, MQ, JR = t.VQ, t.VR, t.MQ, t.JR

    def filled_by(solve: wp.Function) -> wp.Function:
        @wp.func
        def fill(sol: step.Solution, start: Linear, source: linear.DV, f1q: MQ, f2q: JR):
            # (dv', dz) column by column
            lin = start
            for c in range(wp.static(linear.NZ)):
                f1 = VQ()
                f2 = VR()
                for j in range(wp.static(s.nv)):
                    f1[j] = source[j, c]
                    if wp.static(c < s.nv):
                        f1[j] = f1[j] - f1q[j, c]
                if wp.static(c < s.nv):
                    for i in range(wp.static(s.nr)):
                        f2[i] = -f2q[i, c]
                dv = sol.minv * f1
                if sol.mask != 0:
                    dv, dz = solve(lin.factor, sol.minv, sol.jac, sol.scale, sol.mask, dv, f2, c)
                    if wp.static(response.roots):
                        for i in range(wp.static(s.nr)):
                            lin.dz[i, c] = dz[i]
                for j in range(wp.static(s.nv)):
                    lin.dv[j, c] = dv[j]
            return lin

        return fill

    factored = linear.factored if refines else linear.factored_once
    fill, fill_refined = filled_by(response.solve), filled_by(response.refined)

    @wp.func(inline=False)
    def refined(sol: step.Solution, start: Linear, source: linear.DV, f1q: MQ, f2q: JR):
        """No column, where one is none."""
        lin = fill_refined(sol, start, source, f1q, f2q)
        total = dtype(0.0)
        for c in range(wp.static(linear.NZ)):
            total += lin.dv[0, c]
        if wp.isnan(total):
            for c in range(wp.static(linear.NZ)):
                for j in range(wp.static(s.nv)):
                    lin.dv[j, c] = total
        return lin

    @wp.func
    def respond(world: t.World, sol: step.Solution, start: Linear, source: linear.DV):
        lin = factored(world, sol, start)
        f1q, f2q, rows = contact.by_q(world, sol, lin)
        lin.rows = rows
        if wp.static(response.complete is not None):
            if sol.mask != 0:
                force, motion = contact.second_form(world, sol, lin)
                lin.factor = response.complete(
                    lin.factor, step.posed(sol), sol.lam, force, motion, rows.scale_by_q
                )
        if wp.static(refines):
            if seldom(lin.factor.near == 1):
                return refined(sol, lin, source, f1q, f2q)
        return fill(sol, lin, source, f1q, f2q)

    return respond
