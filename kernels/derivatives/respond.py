"""How the solution of a contact problem answers to (q, v, u), by the implicit function theorem."""

import warp as wp

from ..factories import cached
from ..specialisation import Specialisation
from .linear import make_linear
from .rows_by_q import make_rows_by_q


@cached
def make_respond(spec: Specialisation) -> wp.Function:
    """respond(params, row, sol, start, source) -> Linear.

    `source` is -F1_(q, v, u) without the contact's part.
    """
    s, dtype, method = spec
    linear = make_linear(spec)
    step, response, Linear = linear.step, linear.response, linear.Linear
    contact = make_rows_by_q(spec)
    Problem, t = step.Problem, step.types
    VQ, VR, MQ, JR = t.VQ, t.VR, t.MQ, t.JR
    NV, NR = s.nv, s.nr

    @wp.func
    def column(problem: Problem, lin: Linear, f1: VQ, f2: VR, c: int):
        # one column of (dv', dz) for the right-hand side (f1, f2)
        dv = problem.minv * f1
        if problem.mask != 0:
            dv, dz = response.solve(lin.factor, problem, dv, f2, c)
            if wp.static(response.roots):
                for i in range(wp.static(NR)):
                    lin.dz[i, c] = dz[i]
        for j in range(wp.static(NV)):
            lin.dv[j, c] = dv[j]
        return lin

    @wp.func
    def fill(problem: Problem, lin: Linear, source: linear.DV, f1q: MQ, f2q: JR):
        out = lin
        for c in range(wp.static(linear.NZ)):
            f1 = VQ()
            f2 = VR()
            for j in range(wp.static(NV)):
                f1[j] = source[j, c]
                if wp.static(c < NV):
                    f1[j] = f1[j] - f1q[j, c]
            if wp.static(c < NV):
                for i in range(wp.static(NR)):
                    f2[i] = -f2q[i, c]
            out = column(problem, out, f1, f2, c)
        return out

    @wp.func
    def respond(
        params: wp.array2d(dtype=dtype), row: int, sol: step.Solution, start: Linear, source: linear.DV
    ):
        problem = step.posed(sol)
        lin = linear.factored(params, row, sol, start)
        f1q, f2q, lin = contact.by_q(params, row, start.fr, sol, lin)
        if wp.static(response.complete is not None):
            if sol.mask != 0:
                force, motion = contact.second_form(params, row, start.fr, sol, lin)
                lin.factor = response.complete(lin.factor, problem, sol.lam, force, motion, lin.scale_by_q)
        return fill(problem, lin, source, f1q, f2q)

    return respond
