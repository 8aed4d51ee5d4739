"""One time step (1a)-(1d) with smoothed or hard complementarity, as a Warp function.

Stages: kinematics and M, or with implicit damping the N that stands for it (`effective_mass.py`); free
velocity (`free_motion.py`); rows that can act; their solution v', lambda; q' = q + h v'. With the trapezoidal
integrator a first contact problem predicts J' lambda, which then counts among the forces of the free motion
and is taken off again, v_free = reached - N^-1 J' lambda; and q' = q + h v*, where v* solves the same contact
problem from the mean free velocity (v + v_free)/2: free flight follows the trapezoidal rule, what rests
stays, nothing penetrates.
A row is left out while w = J v' + d/h > cut sigma, where its smoothed impulse s(-w)/D is below the dtype's
resolution (with ERM all rows or none, see `erm.py`); the test is repeated with the solved v' until no row has
to be added, so leaving out is exact to rounding.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.acting import make_acting, rows_of_pairs
from ..contact.end_gap import REFINEMENTS, make_end_gap, make_unsteady
from ..contact.problem import COLD, make_problem
from ..contact.rows import make_pair_jacobian, make_rows
from ..contact.shapes import make_pair
from ..factories import cached
from ..mechanism.dynamics import make_mechanism
from ..mechanism.effective_mass import make_effective_mass
from ..mechanism.free_motion import make_free_motion
from ..residual.noise import make_noise
from ..solvers.law import law_of
from ..specialisation import Specialisation
from ..status import JAMMED, NOT_CONVERGED, SOLVED
from ..structure import layout


@cached
def make_step(spec: Specialisation, exact_gap: bool) -> SimpleNamespace:
    """Warp functions of a step; `exact_gap` computes every pair's distance even where it cannot act.

    solve_step(params, row, x, u, external, world, carry) -> Solution (world < 0: no external forces);
    next_state(params, row, x, solution) -> x'.
    """
    s, dtype, method = spec
    mech = make_mechanism(s, dtype)
    t = mech.types
    rows = make_rows(spec)
    free = make_free_motion(spec)
    mass = make_effective_mass(spec)
    NV, NR, NP = s.nv, s.nr, len(s.pairs)
    VQ, VX, VU, VR, MQ, JR = t.VQ, t.VX, t.VU, t.VR, t.MQ, t.JR
    VN = wp.types.vector(2 * max(NP, 1), dtype)
    V2 = t.V2
    H = layout(s).offset("step_size")

    HALF, ONE = dtype(0.5), dtype(1.0)
    UNUSED = dtype(COLD)
    pairs = tuple(make_pair(s, k, dtype) for k in range(NP))
    pair_jacobians = tuple(make_pair_jacobian(s, k, dtype) for k in range(NP))
    pair_rows = rows_of_pairs(s)
    pair_bit = tuple(1 << k for k in range(NP))
    law = law_of(method, NR)
    solver = law.make_solver(spec) if NR else None
    acting = make_acting(spec, exact_gap or law.whole)
    end_gap = make_end_gap(spec) if method.end_gap and NP else None  # bend(..), see there
    unsteady = make_unsteady(s, dtype)
    Problem = make_problem(s, dtype)
    limits = rows.limit
    noise = make_noise(spec)

    def make_deviation(i: int) -> wp.Function:
        @wp.func
        def deviation(params: wp.array2d(dtype=dtype), row: int, jac: JR):
            # sigma_i, eq. (18)
            j = wp.static(rows.adds[i])(VQ(), jac, ONE)
            return noise.deviation(wp.dot(j, noise.spread(params, row, j)))

        return deviation

    deviations = tuple(make_deviation(i) for i in range(NR))

    @wp.struct
    class Carry:
        z: VR  # multipliers of the last step, COLD where a row did not act
        normal: VN  # normals of the last step, (2 pair, 2 pair + 1)

    @wp.struct
    class Solution:
        v: VQ  # v' [rad/s, m/s]
        drift: VQ  # v*, where positions move with another velocity than v'
        lam: VR  # impulses
        z: VR
        rate: VR  # d/h
        scale: VR  # D
        sigma: VR  # noise levels, where they depend on the state
        jac: JR
        minv: MQ
        vfree: VQ
        acceleration: VQ  # at the start of the step, with the predicted contact forces
        push: VQ  # M^-1 J' lambda of the predictor
        unpushed: VQ  # v_free without contact forces
        mask: int  # bit i: row i is in the system
        normal: VN
        status: int

    @wp.func
    def posed(sol: Solution):
        """The contact problem that a solution solves."""
        out = Problem()
        out.minv = sol.minv
        out.vfree = sol.vfree
        out.jac = sol.jac
        out.rate = sol.rate
        out.scale = sol.scale
        out.sigma = sol.sigma
        out.mask = sol.mask
        return out

    @wp.func
    def split(x: VX):
        """(q, v) of a state."""
        q = VQ()
        v = VQ()
        for j in range(wp.static(NV)):
            q[j] = x[j]
            v[j] = x[wp.static(NV + j)]
        return q, v

    @wp.func
    def cold_carry():
        out = Carry()
        for i in range(wp.static(NR)):
            out.z[i] = UNUSED
        return out

    @wp.func
    def generalised_force(
        params: wp.array2d(dtype=dtype),
        row: int,
        q: VQ,
        fr: t.FRAMES,
        jb: t.JB,
        v: VQ,
        u: VU,
        external: wp.array2d(dtype=dtype),
        world: int,
    ):
        f = wp.static(mech.force)(params, row, q, fr, jb, v)
        if wp.static(s.nu > 0):
            f += wp.static(mech.control_force)(params, row, u)
        if world >= 0 and external.shape[0] > 0:  # world < 0: no external forces
            f += wp.static(mech.body_force)(params, row, jb, external, world)
        return f

    @wp.func
    def solve_step(
        params: wp.array2d(dtype=dtype),
        row: int,
        x: VX,
        u: VU,
        external: wp.array2d(dtype=dtype),
        world: int,
        carry: Carry,
    ):
        """The solution of one step from x = (q, v)."""
        q, v = split(x)
        out = Solution()
        fr = wp.static(mech.frames)(params, row, q)
        jb = wp.static(mech.com_jacobians)(params, row, fr)
        minv = wp.static(mech.inverse)(wp.static(mass.matrix)(params, row, fr, jb))
        force = generalised_force(params, row, q, fr, jb, v, u, external, world)
        vfree, a = wp.static(free.velocity)(params, row, fr, jb, minv, v, force, external, world)
        out.minv = minv
        out.vfree = vfree
        out.acceleration = a
        out.v = vfree
        out.z = carry.z
        out.normal = carry.normal
        out.status = wp.static(SOLVED)
        if wp.static(method.trapezoidal):
            return trapezoidal(params, row, fr, jb, q, v, force, external, world, out)
        if wp.static(NR > 0):
            out = contact(params, row, fr, q, out)
        return out

    @wp.func
    def problem(start: Solution, vfree: VQ, z: VR, normal: VN):
        # a contact problem not yet solved, with another free velocity
        out = Solution()
        out.minv = start.minv
        out.vfree = vfree
        out.acceleration = start.acceleration
        out.v = vfree
        out.z = z
        out.normal = normal
        out.status = wp.static(SOLVED)
        return out

    @wp.func
    def trapezoidal(
        params: wp.array2d(dtype=dtype),
        row: int,
        fr: t.FRAMES,
        jb: t.JB,
        q: VQ,
        v: VQ,
        force: VQ,
        external: wp.array2d(dtype=dtype),
        world: int,
        start: Solution,
    ):
        # predictor, drift, v': three contact problems in a loop, to have its code once
        h = params[row, wp.static(H)]
        out = start
        push = VQ()
        moving = VQ()
        vfree = start.vfree
        acceleration = start.acceleration
        status = int(wp.static(SOLVED))
        part = int(0)
        while part < 3:
            if wp.static(NR > 0):
                out = contact(params, row, fr, q, out)
            if out.status != wp.static(SOLVED) and status == wp.static(SOLVED):
                status = out.status
            if part == 0:
                if out.mask != 0:
                    push = out.v - out.vfree
                    held = force + wp.static(mass.matrix)(params, row, fr, jb) * push / h
                    reached, a = wp.static(free.velocity)(
                        params, row, fr, jb, start.minv, v, held, external, world
                    )
                    vfree = reached - push
                    acceleration = a
                out = problem(start, HALF * (v + vfree), out.z, out.normal)
            elif part == 1:
                moving = out.v
                out = problem(start, vfree, out.z, out.normal)
            part += 1
        out.acceleration = acceleration
        out.drift = moving
        out.push = push
        out.unpushed = start.vfree
        out.status = status
        return out

    @wp.func
    def parts(params: wp.array2d(dtype=dtype), row: int, fr: t.FRAMES, q: VQ, v: VQ, sol: Solution):
        """The other two contact problems of a solved trapezoidal step: predictor and drift."""
        first = problem(sol, sol.unpushed, sol.z, sol.normal)
        out = problem(sol, HALF * (v + sol.vfree), sol.z, sol.normal)
        if wp.static(NR > 0):
            part = int(0)
            out = first
            while part < 2:
                out = contact(params, row, fr, q, out)
                if part == 0:
                    first = out
                    out = problem(sol, HALF * (v + sol.vfree), sol.z, sol.normal)
                part += 1
        return first, out

    @wp.func
    def contact(params: wp.array2d(dtype=dtype), row: int, fr: t.FRAMES, q: VQ, start: Solution):
        # add rows until none is missing, solve after every addition
        out = start
        jac = JR()
        rate = wp.static(rows.limit_rates)(params, row, q)
        if wp.static(method.state_noise):
            for i in range(wp.static(NR)):
                if wp.static(limits[i]):
                    out.sigma[i] = wp.static(deviations[i])(params, row, jac)
        z = out.z
        mask = int(0)
        known = int(0)
        more = int(1)
        bent = VR()
        last = dtype(1e30)  # correction of the rows
        part = dtype(1.0)  # of a correction that is made
        refined = int(0)
        stale = int(0)
        every = int(0)  # 1: all rows are in the system
        late = int(0)  # pairs that only the end of the step brings within reach
        out.rate = rate
        while more == 1:
            before = mask
            if wp.static(law.joined):
                mask = mask | every * wp.static((1 << NR) - 1)
            mask = wp.static(acting.limits)(params, row, rate, jac, out.sigma, out.v, mask)
            for k in range(wp.static(NP)):
                if (known & wp.static(pair_bit[k])) == 0:
                    forced = every == 1 or (late & wp.static(pair_bit[k])) != 0
                    if forced or wp.static(acting.near[k])(params, row, fr, out.v):
                        known = known | wp.static(pair_bit[k])
                        warm = V2(out.normal[wp.static(2 * k)], out.normal[wp.static(2 * k + 1)])
                        g = wp.static(pairs[k].geometry)(params, row, fr, warm)
                        out.normal[wp.static(2 * k)] = g[0]
                        out.normal[wp.static(2 * k + 1)] = g[1]
                        jac = wp.static(rows.put_pairs[k])(
                            params, row, wp.static(pair_jacobians[k])(params, row, fr, g), jac
                        )
                        for i in range(wp.static(NR)):
                            if wp.static(i in pair_rows[k] and not rows.tangent[i]):
                                rate[i] = g[2] / params[row, wp.static(H)]
                                out.rate[i] = rate[i]
                                if wp.static(method.state_noise):
                                    out.sigma[i] = wp.static(deviations[i])(params, row, jac)
                if (known & wp.static(pair_bit[k])) != 0:
                    mask = wp.static(acting.contacts[k])(params, row, rate, jac, out.sigma, out.v, mask)
            if wp.static(law.whole):
                if mask != 0:
                    mask = wp.static((1 << NR) - 1)
            more = wp.where(mask != before or (stale == 1 and mask != 0), 1, 0)
            stale = 0
            if more == 1:
                out.scale = wp.static(rows.scale)(out.minv, jac, mask)
                out.jac = jac
                out.mask = mask
                p = posed(out)
                p.rate = rate
                v, z, lam, status, _iterations = wp.static(solver)(params, row, p, z)
                out.v = v
                out.lam = lam
                out.status = status
                if status != wp.static(SOLVED):
                    more = int(0)
                    if wp.static(law.joined):
                        # rows that press may free what is jammed without them
                        if status == wp.static(JAMMED) and mask != wp.static((1 << NR) - 1):
                            every = int(1)
                            more = int(1)
                            out.v = out.vfree
            if wp.static(end_gap is not None):
                moved = more == 1 or refined == 0 or late != 0  # since the gaps were last seen
                late = 0
                if moved and out.status == wp.static(SOLVED):
                    now = VR()
                    if known != 0:
                        now = wp.static(end_gap.bend if end_gap else None)(
                            params, row, q, out.v, out.normal, jac, out.rate, known
                        )
                    again = unsteady(q, now - bent, params[row, wp.static(H)])
                    if again and refined == wp.static(REFINEMENTS):
                        out.status = wp.static(NOT_CONVERGED)
                        more = int(0)
                    elif again:
                        change = wp.max(wp.abs(now - bent))
                        if change > last:  # past the solution by more than before
                            part = HALF * part
                        last = change
                        bent = bent + part * (now - bent)
                        rate = out.rate + bent
                        refined += 1
                        stale = 1
                        more = 1
                    else:
                        late = wp.static(end_gap.reached if end_gap else None)(params, row, q, out.v, known)
                        if late != 0:
                            more = 1
        for i in range(wp.static(NR)):
            if (mask & wp.static(1 << i)) == 0:
                z[i] = UNUSED
        out.z = z
        out.mask = mask
        out.jac = jac
        return out

    @wp.func
    def next_state(params: wp.array2d(dtype=dtype), row: int, x: VX, sol: Solution):
        """x' = (q + h v', v'), eq. (1), or (q + h v*, v')."""
        out = VX()
        v = sol.v
        if wp.static(method.trapezoidal):
            v = sol.drift
        for j in range(wp.static(NV)):
            out[j] = x[j] + params[row, wp.static(H)] * v[j]
            out[wp.static(NV + j)] = sol.v[j]
        return out

    return SimpleNamespace(
        mech=mech,
        types=t,
        rows=rows,
        pairs=pairs,
        pair_rows=pair_rows,
        gap_row=tuple(i - 1 if rows.tangent[i] else i for i in range(NR)),
        Carry=Carry,
        Solution=Solution,
        cold_carry=cold_carry,
        solve_step=solve_step,
        parts=parts,
        posed=posed,
        split=split,
        Problem=Problem,
        free=free,
        mass=mass,
        noise=noise,
        next_state=next_state,
    )
