"""Interior-point method for the (smoothed) complementarity problem, where Newton's method on z fails.

Contacts that land together are redundant, and Newton on z then jumps between active sets. Here a = D lambda >
0 and w > 0 are both unknowns, kept positive by the step length, and a w = m(a - w) + mu (M21) is followed
from a large mu to none; m(z) = s(z) s(-z) is the product on the curve of the residual (0 if hard). Its
linearisation is that of a = s(z), w = s(-z) with weights p, q > 0 in place of s'(z), s'(-z): da = p dz + e,
dw = -q dz + e, p + q = 1, so the elimination is the same. mu follows Mehrotra's rule, but falls in every
iteration, and what falls below the curve is lifted to it (hard: what falls far below the path, towards it): a
rod that lands flat on its two ends (rank 3 of 4 rows) and boxes on boxes stalled without. 5 to 15 iterations,
about two Newton steps each.
"""

import warp as wp

from ..contact.problem import make_problem
from ..contact.rows import make_rows
from ..factories import cached
from ..residual.noise import make_noise
from ..residual.smoothing import make_smoothing
from ..specialisation import Specialisation
from .elimination import PROXIMAL, make_row_elimination

MAX_ITERATIONS = 50
# end: sqrt(mu) and |r| relative to the size of the problem; a block that lands flat shows its active set late
END = {
    (wp.float64, False): (1e-8, 1e-12),
    (wp.float64, True): (1e-13, 1e-13),
    (wp.float32, False): (3e-5, 2e-6),
    (wp.float32, True): (2e-6, 2e-6),
}
START = 0.1  # smallest a and w at the start, relative to the same


@cached
def make_interior(spec: Specialisation) -> wp.Function:
    """interior(world, problem, z) -> z, lambda, done, iterations; the problem is measured."""
    s, dtype, method = spec
    r = make_rows(spec)
    t = r.types
    sm = make_smoothing(dtype, method.residual)
    elimination = make_row_elimination(spec)
    VQ, VR = t.VQ, t.VR
    NR, Problem = s.nr, make_problem(s, dtype)
    noise = make_noise(spec)
    ZERO, ONE = dtype(0.0), dtype(1.0)
    TAU = dtype(PROXIMAL[dtype])
    LIMIT, RESIDUAL = (dtype(x) for x in END[dtype, method.hard])
    DELTA = dtype(START)
    POSITIVE = dtype(0.01)  # smallest weight, relative to that of the hard problem
    NEAREST, FARTHEST = dtype(1e-3), dtype(0.1)  # kept of the way to the boundary
    REJOIN = dtype(0.01)  # smallest a w, relative to what the path has
    MOST = dtype(0.9)  # largest share of mu kept, to the third power: a step that only centres leads nowhere
    TINY = dtype(1e-30)
    DIVERGED = dtype(1e12 if dtype is wp.float64 else 1e7)

    @wp.struct
    class Inside:
        a: VR  # D lambda > 0
        w: VR  # J v' + d/h > 0

    @wp.struct
    class Curve:
        excess: VR  # a w - m(a - w)
        p: VR  # weight of dz in da
        q: VR  # weight of dz in -dw
        total: VR  # what p and q were divided by
        mean: dtype  # mean |excess|

    @wp.func
    def curve(world: t.World, p: Problem, at: Inside):
        out = Curve()
        count = ZERO
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                a = at.a[i]
                w = at.w[i]
                up = a
                down = w
                out.excess[i] = a * w
                if wp.static(not method.hard):
                    level = wp.static(noise.level[i])(world, p.sigma)
                    e = wp.static(sm.smooth)(a - w, level, ONE / level)
                    out.excess[i] = a * w - e[0] * e[1]
                    slope = e[2] * e[1] - e[3] * e[0]  # m'(z)
                    up = wp.max(a + slope, POSITIVE * a)
                    down = wp.max(w - slope, POSITIVE * w)
                total = up + down
                out.p[i] = up / total
                out.q[i] = down / total
                out.total[i] = total
                out.mean += wp.abs(out.excess[i])
                count += ONE
        out.mean = out.mean / count
        return out

    @wp.func
    def move(p: Problem, fac: elimination.Factor, now: Curve, res: VR, at: Inside, mu: dtype):
        # Newton step towards excess = mu, r = 0; Inside holds the changes of a and w
        out = Inside()
        e = VR()
        rhs = VR()
        f = VQ()
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                e[i] = (mu - now.excess[i]) / now.total[i]
                rhs[i] = e[i] - res[i]
                f = wp.static(r.adds[i])(f, p.jac, e[i] / p.scale[i])
        dv, innovation = wp.static(elimination.forward)(fac, p.jac, now.p, p.mask, p.minv * f, rhs)
        dz = wp.static(elimination.back)(fac, p.jac, p.scale, now.p, p.mask, innovation)
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                out.a[i] = now.p[i] * dz[i] + e[i]
                out.w[i] = e[i] - now.q[i] * dz[i]
        return out

    @wp.func
    def advance(p: Problem, at: Inside, step: Inside, kept: dtype):
        # a and w after the step, or after 1 - kept of the way to where the first of them vanishes
        out = Inside()
        fall = TINY
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                fall = wp.max(fall, wp.max(-step.a[i] / at.a[i], -step.w[i] / at.w[i]))
        length = wp.min((ONE - kept) / fall, ONE)
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                out.a[i] = at.a[i] + length * step.a[i]
                out.w[i] = at.w[i] + length * step.w[i]
        return out

    @wp.func
    def rejoin(world: t.World, p: Problem, at: Inside, mu: dtype):
        # an a or w far below the path would block all further steps: lift both onto the curve, or towards the
        # path of the hard problem; r pays for it
        out = at
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                if wp.static(method.hard):
                    if at.a[i] > at.w[i]:
                        out.w[i] = wp.max(at.w[i], REJOIN * mu / at.a[i])
                    else:
                        out.a[i] = wp.max(at.a[i], REJOIN * mu / at.w[i])
                else:
                    level = wp.static(noise.level[i])(world, p.sigma)
                    e = wp.static(sm.smooth)(at.a[i] - at.w[i], level, ONE / level)
                    out.a[i] = wp.max(at.a[i], e[0])
                    out.w[i] = wp.max(at.w[i], e[1])
        return out

    @wp.func(inline=False if method.rest else None)
    def interior(world: t.World, p: Problem, z: VR):
        """z near the solution and lambda; if not converged lambda tends to what proves infeasibility."""
        at = Inside()
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                at.a[i] = wp.max(z[i], ZERO) + DELTA * p.size
                at.w[i] = wp.max(-z[i], ZERO) + DELTA * p.size
        lam = VR()
        res = VR()
        out = z
        it = int(0)
        status = int(0)
        while it < wp.static(MAX_ITERATIONS) and status == 0:
            it += 1
            f = VQ()
            largest = ZERO
            for i in range(wp.static(NR)):
                if (p.mask & wp.static(1 << i)) != 0:
                    lam[i] = at.a[i] / p.scale[i]
                    out[i] = at.a[i] - at.w[i]
                    largest = wp.max(largest, at.a[i])
                    f = wp.static(r.adds[i])(f, p.jac, lam[i])
            v = p.vfree + p.minv * f
            worst = ZERO
            for i in range(wp.static(NR)):
                if (p.mask & wp.static(1 << i)) != 0:
                    res[i] = p.rate[i] + wp.static(r.dots[i])(p.jac, v) - at.w[i]
                    worst = wp.max(worst, wp.abs(res[i]))
            now = curve(world, p, at)
            if worst <= RESIDUAL * p.size and now.mean <= LIMIT * LIMIT * p.size * p.size:
                status = int(1)
            elif not (largest < DIVERGED * p.size):
                it = wp.static(MAX_ITERATIONS)
            else:
                fac = wp.static(elimination.factor)(p.minv, p.jac, p.scale, p.diag, now.p, now.q, p.mask, TAU)
                straight = move(p, fac, now, res, at, ZERO)
                there = curve(world, p, advance(p, at, straight, ZERO))
                part = wp.min(there.mean / now.mean, MOST)
                mu = part * part * part * now.mean
                step = move(p, fac, now, res, at, mu)
                kept = wp.clamp(wp.sqrt(now.mean) / p.size, NEAREST, FARTHEST)
                at = rejoin(world, p, advance(p, at, step, kept), mu)
        return out, lam, status, it

    return interior
