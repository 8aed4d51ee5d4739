"""First-order expansion of a contact problem's solution: the struct, and what of it no direction changes."""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..solvers.law import law_of
from ..specialisation import Specialisation
from ..step.step import make_step


@cached
def make_linear(spec: Specialisation) -> SimpleNamespace:
    """The struct `Linear`, the law's `response`, and factored(world, sol, start) -> `start` with what
    does not depend on what the step is differentiated by; factored_once(...): where nothing is refined.
    """
    s, dtype, method = spec
    step = make_step(spec, False)
    response = law_of(method, s.nr).make_response(spec)
    rows, t = step.rows, step.types
    NZ = 2 * s.nv + s.nu
    DV, DZ = step.free.DV, wp.types.matrix((max(s.nr, 1), NZ), dtype)

    @wp.struct
    class Rows:
        gap_row: t.JR  # dd/dq of every active row
        m: t.JR  # M^-1 J_i'
        scale_by_q: t.JR  # dD_i/dq

    @wp.struct
    class Linear:
        pose: t.Pose  # at the start of the step
        w: t.VQ  # v' - v
        factor: response.Factor
        rows: Rows
        dv: DV  # dv'/d(q, v, u)
        dz: DZ  # dz/d(q, v, u), where z is the law's unknown

    def factored_by(factor: wp.Function) -> wp.Function:
        @wp.func
        def factored(world: t.World, sol: step.Solution, start: Linear):
            lin = start
            normals = t.JR()
            for i in range(wp.static(s.nr)):
                if (sol.mask & wp.static(1 << i)) != 0:
                    m = wp.static(rows.applies[i])(sol.minv, sol.jac)
                    for j in range(wp.static(s.nv)):
                        normals[i, j] = m[j]
            lin.factor = factor(world, step.posed(sol), sol.lam, sol.z, normals)
            lin.rows.m = normals
            return lin

        return factored

    return SimpleNamespace(
        step=step,
        response=response,
        Rows=Rows,
        Linear=Linear,
        factored=factored_by(response.yielding),
        factored_once=factored_by(response.factor),
        NZ=NZ,
        DV=DV,
        DZ=DZ,
    )
