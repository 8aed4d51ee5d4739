"""How a solution with Coulomb's friction changes, at fixed modes (stick, slide, separate).

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
from .dual import make_dual


@cached
def make_coulomb_response(spec: Specialisation) -> SimpleNamespace:
    """The contract of `law.py`: dv' in the rows that hold, and no D."""
    s, dtype, method = spec
    active = make_active(spec)
    r, t = active.rows, active.types
    VQ, VR, MQ, JR = t.VQ, t.VR, t.MQ, t.JR
    Problem, Dual = make_problem(s, dtype), make_dual(s, dtype)
    TAU = dtype(PROXIMAL[dtype][1])
    ONE = dtype(1.0)

    @wp.struct
    class Factor:
        dense: active.Dense
        mode: active.MODES
        lu: active.Lu

    @wp.func
    def factor(world: t.World, p: Problem, lam: VR, z: VR, normals: JR):
        out = Factor()
        out.dense = active.gather(world, p)
        own = VR()
        row = out.dense.row
        for i in range(out.dense.count):
            own[i] = z[row[i]]
        out.mode = active.modes(out.dense, own)
        out.lu = active.factor(out.dense, out.mode, TAU)
        return out

    @wp.func
    def solve(fac: Factor, minv: MQ, jac: JR, scale: VR, mask: int, dv0: VQ, f2: VR, column: int):
        """dv = dv0 + M^-1 J' dlambda with J_i dv = f2_i in the rows that hold."""
        target = VR()
        moved = VR()
        row = fac.dense.row
        response = fac.dense.response
        for i in range(wp.static(s.nr)):
            moved[i] = wp.static(r.dots[i])(jac, dv0) - f2[i]
        for i in range(fac.dense.count):
            target[i] = moved[row[i]]
        dlam = active.impulses(fac.dense, fac.mode, fac.lu, target, VR(), TAU)
        dv = dv0
        for i in range(fac.dense.count):
            dv += dlam[i] * response[i]
        return dv, VR()

    @wp.func
    def dual(fac: Factor, p: Problem, lam: VR, z: VR, target: VQ):
        """P = -M^-1 (target + J' rho) that no impulse changes, with rho = 0 in rows that do not hold."""
        out = Dual()
        out.p = -(p.minv * target)
        if p.mask != 0:
            wanted = VR()
            moved = VR()
            row = fac.dense.row
            response = fac.dense.response
            mode = fac.mode
            for i in range(wp.static(s.nr)):
                moved[i] = wp.static(r.dots[i])(p.jac, out.p)
            for i in range(fac.dense.count):
                wanted[i] = moved[row[i]]
            own = active.transposed(fac.dense, fac.mode, fac.lu, wanted)
            for i in range(fac.dense.count):
                out.rho[row[i]] = own[i]
                out.p = out.p - own[i] * response[i]
                if mode[i] == wp.static(RIGHT):
                    out.slides[row[i]] = ONE
                if mode[i] == wp.static(LEFT):
                    out.slides[row[i]] = -ONE
        return out

    return SimpleNamespace(
        Factor=Factor, factor=factor, solve=solve, dual=dual, complete=None, roots=False, scaled=False
    )
