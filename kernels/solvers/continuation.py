"""Continuation to the hard solution (3), the paper's (5)-(6): smoothed problems, sigma lowered to zero.

Chen and Mangasarian (the paper's [12]) minimise (6), sum_i (a_i - s(a_i - w_i, sigma))^2 with s of eq. (5),
lower sigma and repeat. Here Newton's method on z (newton.py) finds the root in place of the minimum: a =
s(z), w = s(-z) makes every term of (6) vanish, and what is left of the equations is r(z). Each problem is
solved to |r| <= INEXACT sigma from the z of the last one; the last problem is the hard one, s(z, 0) = max(z,
0).

The schedule is ours, the paper leaves it open: the first sigma is START of the problem's size, every other is
a fixed share of the last. Where Newton's method does not follow, the share is replaced by its square root (or
the first sigma halved), and squared again after each success. A smoothed problem has a solution only where
some lambda >= 0 makes w > 0: rows that can but touch zero may end NOT_CONVERGED.
"""

import dataclasses

import warp as wp

from ..contact.problem import SMALLEST as LEAST
from ..contact.problem import make_measure, make_problem
from ..factories import cached
from ..mechanism.kinematics import make_types
from ..specialisation import Specialisation
from ..status import NOT_CONVERGED, SOLVED
from .newton import RESOLUTION, make_newton

START = 0.3  # first sigma relative to the size of w
SHARE = 0.1  # of sigma kept from one problem to the next, where Newton's method follows
SLOWEST = 0.97  # share at which continuation gives up
LOWEST_START = 1e-3  # first sigma at which it gives up
END = {wp.float64: 1e-9, wp.float32: 1e-4}  # last sigma before the hard problem
INEXACT = 0.01
CORRECTIONS = 15  # iterations of Newton's method at one sigma
PROBLEMS = 200


@cached
def make_continuation_solver(spec: Specialisation) -> wp.Function:
    """As `make_solver`, for the hard problem; noise levels and `warm` are not read."""
    s, dtype, method = spec
    smooth = make_newton(spec._replace(method=dataclasses.replace(method, residual="rem-logistic")))
    hard = make_newton(spec)
    Problem, measure = make_problem(s, dtype), make_measure(spec)
    t = make_types(s, dtype)
    NR, VR, World = s.nr, t.VR, t.World
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    FIRST, KEPT, LAST, LOW, CLOSE = (dtype(x) for x in (START, SHARE, END[dtype], LOWEST_START, INEXACT))
    TOL, SLOW = dtype(RESOLUTION[dtype]), dtype(SLOWEST)
    SHORTEST, DECREASE = dtype(0.01), dtype(1e-4)
    HUGE, SMALLEST = dtype(1e300 if dtype is wp.float64 else 1e38), dtype(LEAST)

    @wp.func
    def at_level(p: Problem, level: dtype):
        out = p
        out.sigma = VR(level)
        out.inverse_sigma = VR(ONE / level)
        return out

    @wp.func
    def correct(world: World, p: Problem, tolerance: dtype, z0: VR):
        # damped Newton steps at one sigma; z, whether |r| <= tolerance, iterations
        z = z0
        best = z0
        dz = VR()
        old = ZERO + HUGE
        length = dtype(1.0)
        it = int(0)
        found = int(0)
        while found == 0 and it < wp.static(CORRECTIONS) and length >= SHORTEST:
            it += 1
            at = wp.static(smooth.evaluate)(world, p, z)
            if at.worst <= tolerance and wp.isfinite(at.merit):
                found = int(1)
            elif wp.isfinite(at.merit) and at.merit <= old * (ONE - DECREASE * length):
                best = z
                old = at.merit
                length = dtype(1.0)
                dz = wp.static(smooth.direction)(p, at)
                z = best + dz
            else:
                length = HALF * length
                z = best + length * dz
        return z, found, it

    @wp.func
    def solve(world: World, problem: Problem, warm: VR):
        p = measure(world, problem)
        z = VR()
        p.size = SMALLEST
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                z[i] = -p.w0[i]
                p.size = wp.max(p.size, wp.abs(z[i]))
        z0 = z
        level = ZERO
        trial = FIRST * p.size
        share = ZERO + KEPT
        problems = int(0)
        iterations = int(0)
        on = int(1)
        while on == 1:
            problems += 1
            tolerance = wp.max(CLOSE * trial, TOL * p.size)
            there, found, count = correct(world, at_level(p, trial), tolerance, z)
            iterations += count
            if found == 1:
                z = there
                level = trial
                share = wp.max(share * share, KEPT)
                if level <= LAST * p.size:
                    on = int(0)
            elif level > ZERO:
                share = wp.sqrt(share)
                if share > SLOW:
                    on = int(0)
            if level > ZERO:
                trial = wp.max(share * level, LAST * p.size)
            else:
                z = z0
                trial = HALF * trial
                if trial < LOW * p.size:
                    on = int(0)
            if problems >= wp.static(PROBLEMS):
                on = int(0)
        at = hard.Point()
        status = int(wp.static(NOT_CONVERGED))
        if level > ZERO and level <= LAST * p.size:
            at, z, status, count = wp.static(hard.newton)(world, p, z, p.size)
            iterations += count
            if status == wp.static(SOLVED) and not wp.static(hard.good)(world, p, at, z, False):
                status = wp.static(NOT_CONVERGED)
        return at.v, z, at.lam, status, iterations

    return solve
