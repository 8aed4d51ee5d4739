"""One time step (1a)-(1d) with smoothed or hard complementarity, as a Warp function.

Stages: kinematics; M, or with implicit damping the N that stands for it (`effective_mass.py`); forces; free
velocity (`free_motion.py`); the contact problem (`contact.py`), which the trapezoidal integrator has three of
(`trapezoidal.py`); v' to rounding (`balance.py`); q' = q + h v'.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.acting import rows_of_pairs
from ..contact.rows import make_rows
from ..contact.shapes import make_pair
from ..device.seldom import seldom
from ..factories import cached
from ..mechanism.dynamics import make_mechanism
from ..mechanism.effective_mass import make_effective_mass
from ..mechanism.forces import make_forces
from ..mechanism.free_motion import make_free_motion
from ..residual.noise import make_noise
from ..specialisation import Specialisation
from ..status import NOT_CONVERGED, SOLVED
from ..structure import layout
from .balance import make_balance
from .contact import make_contact
from .solution import make_solution
from .trapezoidal import make_trapezoidal


@cached
def make_step(spec: Specialisation, exact_gap: int) -> SimpleNamespace:
    """Warp functions of a step; `exact_gap` computes every pair's distance even where it cannot act; AFTER:
    so that no bit of the step depends on it.

    solve_step(world, x, u, carry) -> Solution; next_state(world, x, solution) -> x'.
    """
    s, dtype, method = spec
    mech, mass, free = make_mechanism(s, dtype), make_effective_mass(spec), make_free_motion(spec)
    forces, contact = make_forces(s, dtype), make_contact(spec, exact_gap)
    trapezoidal = make_trapezoidal(spec, exact_gap) if method.trapezoidal else None
    balance = make_balance(spec)
    is_ill, refined = balance.is_ill, balance.refined
    solution, rows = make_solution(s, dtype), make_rows(spec)
    Carry, Solution, split, t = solution.Carry, solution.Solution, solution.split, solution.types
    NV = s.nv
    VX, VU = t.VX, t.VU
    H = layout(s).offset("step_size")

    @wp.func(inline=True)
    def solve_step(world: t.World, x: VX, u: VU, carry: Carry):
        """The solution of one step from x = (q, v)."""
        q, v = split(x)
        pose = wp.static(mech.pose)(world, q)
        n = wp.static(mass.matrix)(world, pose)
        minv = wp.static(mech.inverse)(n)
        ill = is_ill(n, minv)
        force = forces(world, pose, v, u)
        vfree, a = wp.static(free.velocity)(world, pose, minv, v, force)
        out = Solution()
        out.minv = minv
        out.vfree = vfree
        out.acceleration = a
        out.v = vfree
        out.z = carry.z
        out.normal = carry.normal
        out.status = wp.static(SOLVED)
        if wp.static(method.trapezoidal):
            out = trapezoidal.integrate(world, pose, v, force, out)
        else:
            out = contact(world, pose, out)
        if wp.static(balance.loses):
            if seldom(ill and out.status == wp.static(SOLVED)):
                if wp.static(method.fast):  # left to what makes the steps that the fast methods leave
                    out.status = wp.static(NOT_CONVERGED)
                else:
                    reached, lam, status = refined(world, x, u, out)  # not a Solution: that is kept in memory
                    out.v = reached
                    if wp.static(balance.shuts):
                        out.lam = lam
                    out.status = status
        return out

    @wp.func
    def next_state(world: t.World, x: VX, sol: Solution):
        """x' = (q + h v', v'), eq. (1), or (q + h v*, v')."""
        out = VX()
        v = sol.v
        if wp.static(method.trapezoidal):
            v = sol.drift
        for j in range(wp.static(NV)):
            out[j] = x[j] + world.params[wp.static(H)] * v[j]
            out[wp.static(NV + j)] = sol.v[j]
        return out

    return SimpleNamespace(
        mech=mech,
        types=t,
        rows=rows,
        pairs=tuple(make_pair(s, k, dtype) for k in range(len(s.pairs))),
        pair_rows=rows_of_pairs(s),
        gap_row=tuple(i - 1 if rows.tangent[i] else i for i in range(s.nr)),
        Carry=Carry,
        Solution=Solution,
        Problem=solution.Problem,
        cold_carry=solution.cold_carry,
        split=split,
        posed=solution.posed,
        solve_step=solve_step,
        parts=trapezoidal.parts if trapezoidal else None,
        free=free,
        mass=mass,
        noise=make_noise(spec),
        next_state=next_state,
    )
