"""The contact problem of a step: rows join until none is missing, and it is solved after every addition.

A row is left out while w = J v' + d/h > cut sigma, where its smoothed impulse s(-w)/D is below the dtype's
resolution (of a law that takes the whole system, all rows or none); the test is repeated with the solved v'
until no row has to be added, so leaving out is exact to rounding. Limits that cross are INFEASIBLE by how
little they may cross (whatever the velocity, one of them is violated, so that a row acts); only a law that
asks for the least expected error has an answer to them.
"""

import warp as wp

from ..contact.problem import COLD
from ..contact.rows import make_rows
from ..factories import cached
from ..solvers.coulomb import MOST_TRIED
from ..solvers.law import law_of
from ..specialisation import Specialisation
from ..status import INFEASIBLE, JAMMED, NOT_CONVERGED, SOLVED
from .end_gap import make_correction
from .groups import make_group_solver
from .reach import AFTER, make_reach
from .solution import make_solution

LIGHTEST = 1e-11  # response of a coordinate beside another's, that proofs in double precision still see


@cached
def make_digits(spec: Specialisation) -> wp.Function:
    """known(status, minv, jac, mask) -> the status: NOT_CONVERGED for INFEASIBLE and JAMMED where rows move
    coordinates that answer so differently to them, by their masses, that no proof has digits for both.
    """
    s, dtype, _ = spec
    rows, t = make_rows(spec), make_solution(s, dtype).types
    LEAST, ZERO = dtype(LIGHTEST), dtype(0.0)

    @wp.func(inline=False)
    def few(minv: t.MQ, jac: t.JR, mask: int):
        lever = t.VQ()
        for i in range(wp.static(s.nr)):
            if (mask & wp.static(1 << i)) != 0:
                lever = wp.max(lever, wp.abs(wp.static(rows.adds[i])(t.VQ(), jac, dtype(1.0))))
        most = ZERO
        for j in range(wp.static(s.nv)):
            most = wp.max(most, minv[j, j] * lever[j] * lever[j])
        out = bool(False)
        for j in range(wp.static(s.nv)):
            out = out or (lever[j] > ZERO and minv[j, j] * lever[j] * lever[j] < LEAST * most)
        return out

    @wp.func
    def known(status: int, minv: t.MQ, jac: t.JR, mask: int):
        if (status == wp.static(INFEASIBLE) or status == wp.static(JAMMED)) and mask != 0:
            if few(minv, jac, mask):
                return wp.static(NOT_CONVERGED)
        return status

    return known


@cached
def make_contact(spec: Specialisation, exact_gap: int) -> wp.Function:
    """contact(world, pose, start) -> the solved `start`; without rows it is."""
    s, dtype, method = spec
    solution = make_solution(s, dtype)
    Solution, posed, t = solution.Solution, solution.posed, solution.types
    if not s.nr:

        @wp.func
        def untouched(world: t.World, pose: t.Pose, start: Solution):
            return start

        return untouched

    law, rows, reach_of = law_of(method, s.nr), make_rows(spec), make_reach(spec, exact_gap)
    solve = make_group_solver(spec)
    correction = make_correction(spec, exact_gap)
    known = make_digits(spec)
    UNUSED = dtype(COLD)

    @wp.func
    def contact(world: t.World, pose: t.Pose, start: Solution):
        # long: one loop over what joins the system, and what it leaves behind in its locals
        out = start
        reach = reach_of.begin(world, pose.q, start.normal)
        ending = correction.begin()
        stale = int(0)  # 1: what the rows of the mask say has changed since they were solved
        more = int(1)
        if wp.static(rows.excluded is not None and not law.weighs):
            if wp.static(rows.excluded)(world):
                out.status = wp.static(INFEASIBLE)
                more = 0
        while more == 1:
            before = reach.mask
            reach = reach_of.look(world, pose.frames, out.v, reach)
            more = wp.where(reach.mask != before or (stale == 1 and reach.mask != 0), 1, 0)
            stale = 0
            if wp.static(method.fast):
                if reach.lost == 1:
                    out.status = wp.static(NOT_CONVERGED)
                    more = 0
            if more == 1:
                out.scale = wp.static(rows.scale)(out.minv, reach.jac, reach.mask)
                problem = posed(out)
                problem.jac = reach.jac
                problem.rate = reach_of.rates(reach.rate, reach.bent)
                problem.sigma = reach.sigma
                problem.mask = reach.mask
                v, z, lam, status, _iterations = wp.static(solve)(world, problem, out.z)
                out.v = v
                out.z = z
                out.lam = lam
                out.status = status
                if out.status != wp.static(SOLVED):
                    more = 0
                if wp.static(law.joined):
                    held = out.status == wp.static(JAMMED)
                    if wp.static(s.nr > MOST_TRIED):
                        held = held or out.status == wp.static(NOT_CONVERGED)
                    if held and reach.mask != wp.static(reach_of.ALL):
                        # rows that press may free what is jammed without them
                        reach.mask = wp.static(reach_of.ALL)
                        reach.wanted = wp.static(reach_of.PAIRS)
                        out.v = out.vfree
                        stale = 1
                        more = 1
            if wp.static(correction.needed):
                if out.status == wp.static(SOLVED) and (more == 1 or ending.open == 1):
                    reach, ending = correction.correct(world, pose.q, out.v, reach, ending)
                    stale = ending.stale
                    more = wp.max(more, ending.open)
                    if ending.failed == 1:
                        out.status = wp.static(NOT_CONVERGED)
                        more = 0
        if wp.static(exact_gap == AFTER):
            reach = reach_of.complete(world, pose.frames, reach)
            if wp.static(method.fast):
                if reach.lost == 1:
                    out.status = wp.static(NOT_CONVERGED)
        out.status = known(out.status, out.minv, reach.jac, reach.mask)
        out.mask = reach.mask
        out.jac = reach.jac
        out.rate = reach.rate
        out.sigma = reach.sigma
        out.normal = reach.normal
        for i in range(wp.static(s.nr)):
            if (reach.mask & wp.static(1 << i)) == 0:
                out.z[i] = UNUSED
        return out

    return contact
