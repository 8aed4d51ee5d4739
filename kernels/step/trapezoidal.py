"""A step of the linearly implicit trapezoidal method (footnote 1, the paper's [6]): three contact problems.

A first one predicts J' lambda, which then counts among the forces of the free motion and is taken off again,
v_free = reached - N^-1 J' lambda; and q' = q + h v*, where v* solves the same contact problem from the mean
free velocity (v + v_free)/2: free flight follows the trapezoidal rule, what rests stays, nothing penetrates.
"""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..mechanism.effective_mass import make_effective_mass
from ..mechanism.free_motion import make_free_motion
from ..specialisation import Specialisation
from ..status import SOLVED
from ..structure import layout
from .contact import make_contact
from .solution import make_solution


@cached
def make_trapezoidal(spec: Specialisation, exact_gap: int) -> SimpleNamespace:
    """integrate(world, pose, v, force, start) -> Solution, from the motion in
    `start`; parts(world, pose, v, sol) -> the other two contact problems of a solved step, predictor
    and drift.
    """
    s, dtype, _ = spec
    contact, free, mass = make_contact(spec, exact_gap), make_free_motion(spec), make_effective_mass(spec)
    solution = make_solution(s, dtype)
    Solution, unsolved, t = solution.Solution, solution.unsolved, solution.types
    VQ, HALF = t.VQ, dtype(0.5)
    H = layout(s).offset("step_size")

    @wp.func
    def integrate(world: t.World, pose: t.Pose, v: VQ, force: VQ, start: Solution):
        # predictor, drift, v': three contact problems in a loop, to have its code once
        h = world.params[wp.static(H)]
        out = start
        push = VQ()
        moving = VQ()
        vfree = start.vfree
        acceleration = start.acceleration
        status = int(wp.static(SOLVED))
        part = int(0)
        while part < 3:
            out = contact(world, pose, out)
            if out.status != wp.static(SOLVED) and status == wp.static(SOLVED):
                status = out.status
            if part == 0:
                if out.mask != 0:
                    push = out.v - out.vfree
                    held = force + wp.static(mass.matrix)(world, pose) * push / h
                    reached, a = wp.static(free.velocity)(world, pose, start.minv, v, held)
                    vfree = reached - push
                    acceleration = a
                out = unsolved(start, HALF * (v + vfree), out.z, out.normal)
            elif part == 1:
                moving = out.v
                out = unsolved(start, vfree, out.z, out.normal)
            part += 1
        out.acceleration = acceleration
        out.drift = moving
        out.push = push
        out.unpushed = start.vfree
        out.status = status
        return out

    @wp.func
    def parts(world: t.World, pose: t.Pose, v: VQ, sol: Solution):
        first = unsolved(sol, sol.unpushed, sol.z, sol.normal)
        part = int(0)
        out = first
        while part < 2:
            out = contact(world, pose, out)
            if part == 0:
                first = out
                out = unsolved(sol, HALF * (v + sol.vfree), sol.z, sol.normal)
            part += 1
        return first, out

    return SimpleNamespace(integrate=integrate, parts=parts)
