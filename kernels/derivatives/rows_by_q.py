"""How the equations of a contact problem change with the configuration, at a solution (v', lambda, z).

F1 gains -d(J' lambda)/dq, F2 gains dJ v' + d(d/h)/dq, limit by limit and pair by pair. With inertia scaling
D(q) = J M^-1 J' on the diagonal: dD = 2 dJ.m - m'(dM)m with m = M^-1 J', and where z is the unknown
lambda = s(z)/D, so that F1 gains J' (lambda/D) dD.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.derivatives import make_pair_derivatives
from ..factories import cached
from ..specialisation import Specialisation
from ..structure import layout
from .linear import make_linear
from .pair_terms import make_pair_terms


@cached
def make_rows_by_q(spec: Specialisation) -> SimpleNamespace:
    """by_q(world, sol, lin) -> F1_q, F2_q and the rows of `lin` with gradients of gaps and of D;
    second_form(world, sol, lin) -> force and motion of the law's `complete`.
    """
    s, dtype, method = spec
    linear = make_linear(spec)
    step, response, Linear, Rows = linear.step, linear.response, linear.Linear, linear.Rows
    rows, t, Solution = step.rows, step.types, step.Solution
    NV, NR, NP = s.nv, s.nr, len(s.pairs)
    VQ, MQ, JR, V2 = t.VQ, t.MQ, t.JR, t.V2
    H = layout(s).offset("step_size")
    index = tuple(r.index for r in s.rows)
    sign = tuple(dtype(float(r.sign)) for r in s.rows)
    pairs = tuple(make_pair_derivatives(s, k, dtype) for k in range(NP))
    pair_terms = tuple(make_pair_terms(spec, linear, pairs[k], k) for k in range(NP))
    pair_rows = step.pair_rows
    pair_mask = tuple(sum(1 << i for i in pair_rows[k]) for k in range(NP))

    @wp.func
    def scaling(world: t.World, pose: t.Pose, sol: step.Solution, start: Rows):
        # dD/dq of every row, from 2 dJ.m of the contact rows
        out = start
        for i in range(wp.static(NR)):
            if (sol.mask & wp.static(1 << i)) != 0:
                m = VQ()
                for j in range(wp.static(NV)):
                    m[j] = out.m[i, j]
                by_q = wp.static(step.mass.by_q)(world, pose, m)
                for k in range(wp.static(NV)):
                    value = out.scale_by_q[i, k]
                    for j in range(wp.static(NV)):
                        value -= m[j] * by_q[j, k]
                    out.scale_by_q[i, k] = value
        return out

    @wp.func
    def scaled_force(sol: step.Solution, scale_by_q: JR, f1: MQ):
        # F1 at fixed z
        out = f1
        for i in range(wp.static(NR)):
            if (sol.mask & wp.static(1 << i)) != 0:
                share = sol.lam[i] / sol.scale[i]
                for k in range(wp.static(NV)):
                    column = wp.static(rows.adds[i])(VQ(), sol.jac, share * scale_by_q[i, k])
                    for j in range(wp.static(NV)):
                        out[j, k] = out[j, k] + column[j]
        return out

    @wp.func
    def by_q(world: t.World, sol: step.Solution, lin: Linear):
        out = lin.rows
        h = world.params[wp.static(H)]
        f1q = MQ()
        f2q = JR()
        for i in range(wp.static(NR)):
            if wp.static(rows.limit[i]):
                if (sol.mask & wp.static(1 << i)) != 0:
                    out.gap_row[i, wp.static(index[i])] = wp.static(sign[i])
                    f2q[i, wp.static(index[i])] = wp.static(sign[i]) / h
        for k in range(wp.static(NP)):
            if (sol.mask & wp.static(pair_mask[k])) != 0:
                n = V2(sol.normal[wp.static(2 * k)], sol.normal[wp.static(2 * k + 1)])
                g = wp.static(pairs[k].geometry)(world, lin.pose.frames, n)
                f1q, f2q, gap_row = wp.static(pair_terms[k].rows)(world, sol, g, out.gap_row, f1q, f2q)
                out.gap_row = gap_row
                if wp.static(response.scaled):
                    out.scale_by_q = wp.static(pair_terms[k].scale)(world, g, out.m, out.scale_by_q)
                if wp.static(method.state_noise):
                    f1q, f2q = wp.static(pair_terms[k].noise)(world, sol, g, lin.factor, f1q, f2q)
        if wp.static(response.scaled):
            out = scaling(world, lin.pose, sol, out)
            if wp.static(response.roots):
                f1q = scaled_force(sol, out.scale_by_q, f1q)
        return f1q, f2q, out

    @wp.func
    def second_form(world: t.World, sol: step.Solution, lin: Linear):
        # the rows' derivatives once more, with y and p in place of lambda and v'
        fac = lin.factor
        twin = Solution()
        twin.jac = sol.jac
        twin.lam = fac.y
        twin.v = fac.p
        force = MQ()
        motion = JR()
        for k in range(wp.static(NP)):
            if (sol.mask & wp.static(pair_mask[k])) != 0:
                n = V2(sol.normal[wp.static(2 * k)], sol.normal[wp.static(2 * k + 1)])
                g = wp.static(pairs[k].geometry)(world, lin.pose.frames, n)
                force, motion, _gap = wp.static(pair_terms[k].rows)(
                    world, twin, g, lin.rows.gap_row, force, motion
                )
                for i in range(wp.static(NR)):
                    if wp.static(i in pair_rows[k]):
                        for j in range(wp.static(NV)):
                            motion[i, j] = motion[i, j] - lin.rows.gap_row[i, j] / world.params[wp.static(H)]
        force += wp.static(step.mass.by_q)(world, lin.pose, fac.p)
        return -force, motion

    return SimpleNamespace(by_q=by_q, second_form=second_form, pairs=pairs, pair_mask=pair_mask)
