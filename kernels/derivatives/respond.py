"""How the solution of a contact problem answers to (q, v, u), by the implicit function theorem."""

import warp as wp

from ..device.seldom import seldom
from ..factories import cached
from ..specialisation import Specialisation
from .linear import make_linear
from .rows_by_q import make_rows_by_q


@cached
def make_respond(spec: Specialisation) -> wp.Function:
    """respond(world, sol, start, source) -> Linear.

    `source` is -F1_(q, v, u) without the contact's part.
    """
    s, dtype, method = spec
    linear = make_linear(spec)
    step, response, Linear = linear.step, linear.response, linear.Linear
    contact = make_rows_by_q(spec)
    t = step.types
    VQ, VR, MQ, JR = t.VQ, t.VR, t.MQ, t.JR

    @wp.func
    def whole(dv: linear.DV):
        """No column, where one is none."""
        total = dtype(0.0)
        for c in range(wp.static(linear.NZ)):
            total += dv[0, c]
        out = dv
        if wp.isnan(total):
            for c in range(wp.static(linear.NZ)):
                for j in range(wp.static(s.nv)):
                    out[j, c] = total
        return out

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
                dv, dz = response.solve(lin.factor, sol.minv, sol.jac, sol.scale, sol.mask, dv, f2, c)
                if wp.static(response.roots):
                    for i in range(wp.static(s.nr)):
                        lin.dz[i, c] = dz[i]
            for j in range(wp.static(s.nv)):
                lin.dv[j, c] = dv[j]
        if seldom(lin.factor.near == 1):
            lin.dv = whole(lin.dv)
        return lin

    @wp.func
    def respond(world: t.World, sol: step.Solution, start: Linear, source: linear.DV):
        lin = linear.factored(world, sol, start)
        f1q, f2q, rows = contact.by_q(world, sol, lin)
        lin.rows = rows
        if wp.static(response.complete is not None):
            if sol.mask != 0:
                force, motion = contact.second_form(world, sol, lin)
                lin.factor = response.complete(
                    lin.factor, step.posed(sol), sol.lam, force, motion, rows.scale_by_q
                )
        return fill(sol, lin, source, f1q, f2q)

    return respond
