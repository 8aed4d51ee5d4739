"""First derivatives of a step with Coulomb's friction, at fixed modes (stick, slide, separate).

Where modes change the solution has a kink: a row with z = 0 counts as separate and a contact on the edge of
its cone as sticking, so what is returned there is a one-sided derivative. Rows that hold keep J dv' given, a
sliding contact keeps lambda_t/lambda_n; the same nonsymmetric system as in `coulomb.py`.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.problem import make_problem
from ..factories import cached
from ..specialisation import Specialisation
from .coulomb import PROXIMAL
from .coulomb_modes import LEFT, RIGHT, make_active


@cached
def make_coulomb_response(spec: Specialisation) -> SimpleNamespace:
    """factor(params, row, problem, z) -> Factor; solve(factor, jac, dv0, f2) -> dv;
    transposed(factor, jac, p0) -> (P, rho, sides), see there.
    """
    s, dtype, _ = spec
    active = make_active(spec)
    r, t = active.rows, active.types
    VQ, VR, JR = t.VQ, t.VR, t.JR
    Problem = make_problem(s, dtype)
    TAU = dtype(PROXIMAL[dtype][1])
    ONE = dtype(1.0)

    @wp.struct
    class Factor:
        dense: active.Dense
        mode: active.MODES
        lu: active.Lu

    @wp.func
    def factor(params: wp.array2d(dtype=dtype), row: int, problem: Problem, z: VR):
        out = Factor()
        out.dense = active.gather(params, row, problem)
        own = VR()
        for i in range(out.dense.count):
            own[i] = z[out.dense.row[i]]
        out.mode = active.modes(out.dense, own)
        out.lu = active.factor(out.dense, out.mode, TAU)
        return out

    @wp.func
    def solve(fac: Factor, jac: JR, dv0: VQ, f2: VR):
        """dv = dv0 + M^-1 J' dlambda with J_i dv = f2_i in the rows that hold."""
        target = VR()
        moved = VR()
        for i in range(wp.static(s.nr)):
            moved[i] = wp.static(r.dots[i])(jac, dv0) - f2[i]
        for i in range(fac.dense.count):
            target[i] = moved[fac.dense.row[i]]
        dlam = active.impulses(fac.dense, fac.mode, fac.lu, target, VR(), TAU)
        dv = dv0
        for i in range(fac.dense.count):
            dv += dlam[i] * fac.dense.response[i]
        return dv

    @wp.func
    def transposed(fac: Factor, jac: JR, p0: VQ):
        """P = p0 - M^-1 J' rho that no impulse changes: target . dv' = -(P . dF1 + rho . dF2) for M p0 =
        target, with rho = 0 in rows that do not hold. Sides: lambda_t/(mu lambda_n) of sliding contacts, in
        the friction row.
        """
        target = VR()
        moved = VR()
        for i in range(wp.static(s.nr)):
            moved[i] = wp.static(r.dots[i])(jac, p0)
        for i in range(fac.dense.count):
            target[i] = moved[fac.dense.row[i]]
        own = active.transposed(fac.dense, fac.mode, fac.lu, target)
        p = p0
        rho = VR()
        side = VR()
        for i in range(fac.dense.count):
            rho[fac.dense.row[i]] = own[i]
            p -= own[i] * fac.dense.response[i]
            if fac.mode[i] == wp.static(RIGHT):
                side[fac.dense.row[i]] = ONE
            if fac.mode[i] == wp.static(LEFT):
                side[fac.dense.row[i]] = -ONE
        return p, rho, side

    return SimpleNamespace(Factor=Factor, factor=factor, solve=solve, transposed=transposed)
