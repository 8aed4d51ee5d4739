"""How a solution with Coulomb's friction changes, at fixed modes (stick, slide, separate).

Where modes change the solution has a kink: a row with z = 0 counts as separate and a contact on the edge of
its cone as sticking, so what is returned there is a one-sided derivative. Rows that hold keep J dv' given, a
sliding contact keeps lambda_t/lambda_n; the same nonsymmetric system as in `coulomb.py`.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.problem import make_problem
from ..contact.refinement import GO_ON, LOST, SMALL, WRONG, make_refinement
from ..device.seldom import seldom
from ..factories import cached
from ..specialisation import Specialisation
from .coulomb import PROXIMAL
from .coulomb_modes import LEFT, PRESS, RIGHT, STICK, make_active
from .dual import make_dual

EDGE = {wp.float64: 1e-9, wp.float32: 1e-5}  # of mu: rounding of a contact at its edge


@cached
def make_coulomb_response(spec: Specialisation) -> SimpleNamespace:
    """The contract of `law.py`: dv' in the rows that hold, and no D."""
    s, dtype, method = spec
    active = make_active(spec)
    r, t = active.rows, active.types
    VQ, VR, MQ, JR = t.VQ, t.VR, t.MQ, t.JR
    Problem, Dual = make_problem(s, dtype), make_dual(s, dtype)
    TAU = dtype(PROXIMAL[dtype][1])
    refinement = make_refinement(spec)
    ZERO, ROUGH = dtype(0.0), dtype(WRONG[dtype])
    ONE, SHARE, INSIDE = dtype(1.0), dtype(SMALL[dtype]), dtype(1.0 - EDGE[dtype])

    @wp.struct
    class Factor:
        dense: active.Dense
        mode: active.MODES
        lu: active.Lu
        near: int  # 1: rows nearly oppose or repeat each other, solutions are refined

    @wp.func
    def factored(dense: active.Dense, own: VR, edge: dtype):
        out = Factor()
        out.dense = dense
        out.mode = active.modes(dense, own, edge)
        out.lu = active.factor(dense, out.mode, TAU)
        m = out.lu.m
        for c in range(out.lu.size):
            if TAU > SHARE * wp.abs(m[c, c]):
                out.near = 1
        return out

    @wp.func
    def factor(world: t.World, p: Problem, lam: VR, z: VR, normals: JR):
        """Where more sticks than bodies can follow, contacts at the edge of what friction holds slide."""
        dense = active.gather(world, p)
        own = VR()
        row = dense.row
        for i in range(dense.count):
            own[i] = z[row[i]]
        out = factored(dense, own, ONE)
        if seldom(out.near == 1):
            out = factored(dense, own, INSIDE)
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
    def agrees(fac: Factor, jac: JR, dv0: VQ, f2: VR, dv: VQ):
        """Whether the rows that hold, more than bodies can follow, ask for the same."""
        mode = fac.mode
        row = fac.dense.row
        a = fac.dense.a
        size = ZERO
        rest = ZERO
        for i in range(fac.dense.count):
            if mode[i] == wp.static(PRESS) or mode[i] == wp.static(STICK):
                asked = f2[row[i]]
                unit = wp.sqrt(a[i, i])
                free = ZERO
                left = -asked
                for j in range(wp.static(s.nv)):
                    free += wp.abs(jac[row[i], j] * dv0[j])
                    left += jac[row[i], j] * dv[j]
                size = wp.max(size, (wp.abs(asked) + free) / unit)
                rest = wp.max(rest, wp.abs(left) / unit)
        return rest <= ROUGH * size

    @wp.func(inline=False)
    def refined(fac: Factor, minv: MQ, jac: JR, scale: VR, mask: int, dv0: VQ, f2: VR, column: int):
        """dv, refined; not numbers where that does not end."""
        dv, rows = solve(fac, minv, jac, scale, mask, dv0, f2, column)
        before = VQ()
        way = int(wp.static(GO_ON))
        count = int(1)
        while way == wp.static(GO_ON):
            better, rows = solve(fac, minv, jac, scale, mask, dv, f2, column)
            by = better - dv
            dv = better
            way = refinement.judge(minv, dv0, dv, by, before, count)
            before = by
            count += 1
        if way == wp.static(LOST) or not agrees(fac, jac, dv0, f2, dv):
            dv, rows = refinement.none()
        return dv, rows

    @wp.func
    def held(fac: Factor, jac: JR, p: VQ):
        """The rows' weights that keep impulses from changing P, and P with them, once."""
        moved = VR()
        wanted = VR()
        out = p
        row = fac.dense.row
        response = fac.dense.response
        for i in range(wp.static(s.nr)):
            moved[i] = wp.static(r.dots[i])(jac, p)
        for i in range(fac.dense.count):
            wanted[i] = moved[row[i]]
        own = active.transposed(fac.dense, fac.mode, fac.lu, wanted)
        for i in range(fac.dense.count):
            out = out - own[i] * response[i]
        return out, own

    @wp.func(inline=False)
    def held_refined(fac: Factor, minv: MQ, jac: JR, lam: VR, target: VQ, p: VQ):
        """The same, refined; not numbers where that does not end, or impulses make much of what is left."""
        out, own = held(fac, jac, p)
        before = VQ()
        way = int(wp.static(GO_ON))
        count = int(1)
        while way == wp.static(GO_ON):
            better, more = held(fac, jac, out)
            by = better - out
            out = better
            own += more
            way = refinement.judge(minv, p, out, by, before, count)
            before = by
            count += 1
        if way == wp.static(LOST) or not refinement.carries(jac, lam, target, before):
            out, own = refinement.none()
        return out, own

    @wp.func
    def dual(fac: Factor, p: Problem, lam: VR, z: VR, target: VQ):
        """P = -M^-1 (target + J' rho) that no impulse changes, with rho = 0 in rows that do not hold."""
        out = Dual()
        out.p = -(p.minv * target)
        if p.mask != 0:
            row = fac.dense.row
            mode = fac.mode
            free = out.p
            reached, own = held(fac, p.jac, free)
            if seldom(fac.near == 1):
                reached, own = held_refined(fac, p.minv, p.jac, lam, target, free)
            out.p = reached
            for i in range(fac.dense.count):
                out.rho[row[i]] = own[i]
                if mode[i] == wp.static(RIGHT):
                    out.slides[row[i]] = ONE
                if mode[i] == wp.static(LEFT):
                    out.slides[row[i]] = -ONE
        return out

    return SimpleNamespace(
        Factor=Factor,
        factor=factor,
        yielding=factor,
        solve=solve,
        refined=refined,
        dual=dual,
        complete=None,
        roots=False,
        scaled=False,
    )
