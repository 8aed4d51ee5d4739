"""Damped Newton steps on z for the (smoothed) complementarity problem in mixed form, as in `convex.py`.

A step solves [M, -J'; J, C](dv, dlambda) = (0, -r), C = D s'(-z)/s'(z) (elimination.py) and is shortened
until sum r_i^2/A_ii falls.
"""

from types import SimpleNamespace

import warp as wp

from ..contact.problem import make_problem
from ..contact.row_sizes import make_row_sizes
from ..contact.rows import make_rows
from ..factories import cached
from ..method import Method
from ..residual.noise import make_noise
from ..residual.smoothing import make_smoothing
from ..specialisation import Specialisation
from ..status import NONFINITE, NOT_CONVERGED, SOLVED
from .elimination import PROXIMAL

ITERATIONS = {False: 20, True: 8}  # of Newton's method for the smoothed and the hard problem
# rounding of impulses against each other that v' may hide, relative to a row's terms, as the data set
# them: in float64 impulses may be 1e7 times what the data ask of a row (a tonne on a gram), not more
CANCELLED = {wp.float64: 1e-9, wp.float32: 4e-6}
RESOLUTION = {wp.float64: 2e-14, wp.float32: 1e-6}  # rounding of r, relative to the problem's size


def resolution(dtype: type, method: Method) -> float:
    """|r_i| that counts as none, relative to the size of its row."""
    return max(RESOLUTION[dtype], method.tolerance or 0.0)


@cached
def make_newton(spec: Specialisation) -> SimpleNamespace:
    """Of a measured problem: `evaluate` r at z, Newton's `direction` there, the damped iteration `newton`,
    and whether what it ends at is `good`.
    """
    s, dtype, method = spec
    r = make_rows(spec)
    t = r.types
    sm = make_smoothing(dtype, method.residual)
    VQ, VR, JR = t.VQ, t.VR, t.JR
    NR, Problem = s.nr, make_problem(s, dtype)
    noise, row_sizes = make_noise(spec), make_row_sizes(spec)
    ZERO, HALF, ONE = dtype(0.0), dtype(0.5), dtype(1.0)
    BEND = dtype(0.5 * sm.steepest)
    HUGE = dtype(1e300 if dtype is wp.float64 else 1e38)
    TOL = dtype(resolution(dtype, method))
    ACCEPT, LARGEST = (dtype(x) for x in ((2e-12, 1e-10) if dtype is wp.float64 else (1e-5, 1e-5)))
    COUNTS = dtype(max(TOL, ACCEPT))
    OPPOSED = dtype(8.0)  # times the problem's size: velocities by single impulses that others take back
    ROUNDING = dtype(1e-15)  # of the impulses' own velocities, which cancel between heavy and light bodies
    WQ, bounded = wp.types.vector(s.nv, wp.float64), dtype is wp.float64
    ROUND, HIDDEN = wp.float64(1e-16 if bounded else 1.0), dtype(CANCELLED[dtype])
    JACOBIAN = dtype(1.2e-8)  # of impulses: a rounding of J, 6e-8, may be 2e-5 of a row, CANCELLED is 4e-6
    twins = tuple(i + (row.sign if row.kind == "contact" else 0) for i, row in enumerate(s.rows))
    MOST = dtype(1.0 if dtype is wp.float64 else 2.5)  # of a row's size, relative to the problem's
    DECREASE = dtype(1e-4)
    SHORTEST = dtype(0.05)
    TAU = dtype(PROXIMAL[dtype])

    @wp.func
    def weigh(x: dtype):
        if wp.static(bounded):
            return wp.float64(wp.abs(x))
        return wp.float64(x)

    @wp.struct
    class Point:
        v: VQ
        lam: VR
        res: VR  # r(z)
        slope: VR  # s'(z)
        slack: VR  # s'(-z)
        merit: dtype  # sum r_i^2 / A_ii
        worst: dtype  # max |r_i|

    @wp.func
    def evaluate(world: t.World, p: Problem, z: VR):
        out = Point()
        f = VQ()
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                if wp.static(method.hard):
                    e = wp.static(sm.kink)(z[i])
                else:
                    level = wp.static(noise.level[i])(world, p.sigma)
                    e = wp.static(sm.smooth)(z[i], level, p.inverse_sigma[i])
                out.lam[i] = e[0]
                if wp.static(method.inertia_scaling):
                    out.lam[i] = e[0] / p.scale[i]
                out.res[i] = p.rate[i] - e[1]
                out.slope[i] = e[2]
                out.slack[i] = e[3]
                f = wp.static(r.adds[i])(f, p.jac, out.lam[i])
        out.v = p.vfree + p.minv * f
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                out.res[i] = out.res[i] + wp.static(r.dots[i])(p.jac, out.v)
                out.merit += out.res[i] * out.res[i] * p.inverse_diag[i]
                out.worst = wp.max(out.worst, wp.abs(out.res[i]))
        return out

    @wp.func
    def direction(p: Problem, at: Point):
        # `factor`, `forward` and `back` of elimination.py in one go, without what only derivatives need
        left = p.minv
        dv = VQ()
        gain = JR()
        innovation = VR()  # divided by T
        weight = VR()  # 1/T
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                g = wp.static(r.applies[i])(left, p.jac)
                stiffness = wp.max(wp.static(r.dots[i])(p.jac, g), ZERO) + TAU * p.diag[i]
                slack = at.slack[i]
                if wp.static(method.inertia_scaling):
                    slack = slack * p.scale[i]
                inverse = ONE / (slack + at.slope[i] * stiffness)
                innovation[i] = -inverse * (at.res[i] + wp.static(r.dots[i])(p.jac, dv))
                weight[i] = inverse
                k = at.slope[i] * inverse
                gain[i] = g
                dv += (at.slope[i] * innovation[i]) * g
                left -= k * wp.outer(g, g)
        dz = VR()
        f = VQ()
        for j in range(wp.static(NR)):
            if (p.mask & wp.static(1 << (NR - 1 - j))) != 0:
                inner = wp.dot(gain[wp.static(NR - 1 - j)], f)
                step = innovation[wp.static(NR - 1 - j)] - weight[wp.static(NR - 1 - j)] * inner
                f = wp.static(r.adds[NR - 1 - j])(f, p.jac, at.slope[wp.static(NR - 1 - j)] * step)
                if wp.static(method.inertia_scaling):
                    step = step * p.scale[wp.static(NR - 1 - j)]
                dz[wp.static(NR - 1 - j)] = step
        return dz

    @wp.func
    def remainder(p: Problem, dz: VR):
        # bound on |r| after a full Newton step: s is quadratic up to s'' dz^2/2, s'' <= steepest/sigma
        bend = ZERO
        largest = ZERO
        smallest = ZERO + HUGE
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                bend += BEND * p.inverse_sigma[i] * dz[i] * dz[i]
                largest = wp.max(largest, p.diag[i])
                smallest = wp.min(smallest, p.scale[i])
        return bend * (ONE + largest / smallest)

    @wp.func
    def follow(p: Problem, at: Point, dz: VR):
        # the end of a Newton step that needs no other: lambda and v' to first order in dz
        out = at
        f = VQ()
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                change = at.slope[i] * dz[i]
                if wp.static(method.inertia_scaling):
                    change = change / p.scale[i]
                out.lam[i] = at.lam[i] + change
                f = wp.static(r.adds[i])(f, p.jac, out.lam[i])
        out.v = p.vfree + p.minv * f
        return out

    @wp.func
    def hidden(world: t.World, p: Problem, at: Point, own: VR):
        # what the rounding of impulses against each other left in J v', where r, of the same v', does not see
        # it: the error itself in float32, with what a rounding of J = J_n +- mu J_t makes of J' lambda, in
        # float64 a bound of both; relative to a row's own terms and to what the rows that press, each by
        # itself, do to it, or to what is its `own` size
        f = WQ()
        alone = VQ()
        push = VQ()
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                j = wp.static(r.adds[i])(VQ(), p.jac, ONE)
                twin = wp.static(r.adds[twins[i]])(VQ(), p.jac, ONE)
                most = wp.max(-p.w0[i], ZERO)
                if wp.static(not method.hard):
                    most += wp.static(noise.level[i])(world, p.sigma)
                most = wp.min(most * p.inverse_diag[i], at.lam[i])
                for k in range(wp.static(s.nv)):
                    f[k] = f[k] + wp.static(weigh)(j[k]) * wp.static(weigh)(at.lam[i])
                    alone[k] = alone[k] + wp.abs(j[k]) * most
                    if wp.static(not bounded):
                        push[k] = push[k] + wp.max(wp.abs(j[k]), wp.abs(twin[k])) * at.lam[i]
        v = WQ()
        reach = VQ()
        hit = VQ()
        for k in range(wp.static(s.nv)):
            reach[k] = wp.abs(p.vfree[k])
            if wp.static(not bounded):
                v[k] = wp.float64(p.vfree[k]) - wp.float64(at.v[k])
            for l in range(wp.static(s.nv)):
                v[k] = v[k] + wp.static(weigh)(p.minv[k, l]) * f[l]
                reach[k] = reach[k] + wp.abs(p.minv[k, l]) * alone[l]
                if wp.static(not bounded):
                    hit[k] = hit[k] + wp.abs(p.minv[k, l]) * push[l]
        worst = dtype(0.0)
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                j = wp.static(r.adds[i])(VQ(), p.jac, ONE)
                moved = wp.float64(0.0)
                size = wp.abs(p.rate[i]) + wp.abs(p.w0[i])
                if wp.static(not method.hard):
                    size += wp.static(noise.level[i])(world, p.sigma)
                for k in range(wp.static(s.nv)):
                    moved += wp.static(weigh)(j[k]) * v[k]
                    size += wp.abs(j[k]) * reach[k]
                error = dtype(wp.abs(moved) * ROUND)
                if wp.static(not bounded):
                    error += JACOBIAN * wp.dot(wp.abs(j), hit)
                size = wp.max(wp.min(size, MOST * p.size), own[i])
                if not (error <= worst * size):
                    worst = error / size
        return worst

    @wp.func
    def loud(p: Problem, at: Point):
        # whether impulses move rows by far more than there is to be moved, as those against each other do:
        # they may have no digits for a step that nobody looks at after it is taken
        out = bool(False)
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                out = out or p.diag[i] * at.lam[i] > OPPOSED * p.size
        return out

    @wp.func
    def rounding(p: Problem, z: VR):
        # of the velocities that impulses of z make by themselves
        out = ZERO
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                out = wp.max(out, ROUNDING * z[i] * p.diag[i] / p.scale[i])
        return out

    @wp.func
    def newton(world: t.World, p: Problem, z0: VR, size: dtype):
        # from z0 until no |r_i| counts relative to `size`; NOT_CONVERGED where no step length helps or the
        # iterations do not suffice
        z = z0
        best = z0
        dz = VR()
        old = ZERO + HUGE
        best_worst = ZERO + HUGE
        length = dtype(1.0)
        tolerance = TOL * size
        it = int(0)
        last = int(0)
        status = int(wp.static(NOT_CONVERGED))
        at = Point()
        while status == wp.static(NOT_CONVERGED):
            it += 1
            at = evaluate(world, p, z)
            finite = wp.isfinite(at.merit)
            if not finite and it == 1:
                status = wp.static(NONFINITE)
                break
            if finite and at.worst <= tolerance:
                status = wp.static(SOLVED)
                break
            if last == 1:
                break
            if finite and at.merit <= old * (ONE - DECREASE * length):
                best = z
                best_worst = at.worst
                old = at.merit
                length = dtype(1.0)
                dz = direction(p, at)
                z = best + dz
                if wp.static(not method.hard):
                    if remainder(p, dz) <= TOL * size and not loud(p, at):
                        at = follow(p, at, dz)
                        status = wp.static(SOLVED)
            else:
                length = HALF * length
                z = best + length * dz
            if length < SHORTEST or it >= wp.static(ITERATIONS[method.hard]):
                # rounding may be all that is left: the best point then counts with a wider tolerance
                tolerance = wp.min(wp.max(ACCEPT * p.size, rounding(p, best)), LARGEST * p.size)
                if best_worst > tolerance:
                    break
                z = best
                last = 1
        return at, z, status, it

    @wp.func(inline=False)  # in line, with sizes by row, it makes every step a seventh slower
    def good(world: t.World, p: Problem, at: Point, z: VR, differ: bool):
        # whether a point that newton ended at, or a step from it, solves every row relative to what it is
        # measured by, where rows may `differ`
        own = VR()
        out = bool(True)
        if differ:
            own = row_sizes.sizes(world, p)
            rounded = rounding(p, z)
            again = evaluate(world, p, z)
            for i in range(wp.static(NR)):
                if (p.mask & wp.static(1 << i)) != 0:
                    most = wp.max(COUNTS * own[i], wp.min(rounded, LARGEST * own[i]))
                    out = out and wp.abs(again.res[i]) <= most
        return out and hidden(world, p, at, own) <= HIDDEN

    return SimpleNamespace(Point=Point, evaluate=evaluate, direction=direction, newton=newton, good=good)
