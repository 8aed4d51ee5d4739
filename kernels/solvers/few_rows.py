"""Newton's method for a contact problem of at most FEW rows, in the space of the rows.

The same equations as in `convex.py`, r(z) = A lambda(z) + J v_free + d/h - s(-z) = 0 with D lambda = s(z),
but A = J M^-1 J' is formed once, so that an iteration works on FEW numbers instead of on vectors of nv. Steps
are not shortened: where one does not let sum r_i^2/A_ii fall, or where large impulses cancel, the general
method starts afresh.
"""

import warp as wp

from ..contact.problem import SMALLEST, make_places, make_problem
from ..contact.rows import make_rows
from ..factories import cached
from ..residual.noise import make_noise
from ..residual.smoothing import make_smoothing
from ..specialisation import Specialisation
from ..status import NOT_CONVERGED, SOLVED
from .elimination import PROXIMAL
from .newton import resolution

FEW = {False: 3, True: 4}  # rows, by whether there are several pairs: one with a limit, or two
ITERATIONS = 10
LARGEST = 8.0  # of sums of |A_ij lambda_j|, relative to the terms of the residual
DECREASE = 0.99  # of the sum of squares, at least, in every step


@cached
def make_few_rows(spec: Specialisation) -> wp.Function:
    """solve_few(world, problem, z) -> v', z, lambda, status, iterations; NOT_CONVERGED also where there
    are more than FEW rows. The problem is measured.
    """
    s, dtype, method = spec
    r = make_rows(spec)
    sm = make_smoothing(dtype, method.residual)
    noise = make_noise(spec)
    VQ, VR, World = r.types.VQ, r.types.VR, r.types.World
    NR, NV, K = s.nr, s.nv, min(FEW[len(s.pairs) > 1], s.nr)
    Problem, places = make_problem(s, dtype), make_places(spec, K)
    V, M, J = places.V, places.A, places.J
    ZERO, ONE = dtype(0.0), dtype(1.0)
    HUGE = dtype(1e300 if dtype is wp.float64 else 1e38)
    TOL, TAU = dtype(resolution(dtype, method)), dtype(PROXIMAL[dtype])
    CANCEL, FLOOR = dtype(LARGEST), dtype(SMALLEST)
    BEND, FALL = dtype(0.5 * sm.steepest), dtype(DECREASE)

    @wp.struct
    class Few:
        a: M  # J M^-1 J'
        diag: V  # its diagonal; above zero even where J = 0
        w0: V  # J v_free + d/h
        scale: V  # D
        sigma: V
        inverse_sigma: V
        z: V

    @wp.func
    def gather(world: World, problem: Problem, z: VR):
        # the rows of the mask, one after the other; unused places hold rows that stay as they are
        out = Few()
        own = J()  # J_i of the rows in the system
        place = int(0)
        for k in range(wp.static(K)):
            out.scale[k] = ONE
        for i in range(wp.static(NR)):
            if (problem.mask & wp.static(1 << i)) != 0:
                row_i = wp.static(r.adds[i])(VQ(), problem.jac, ONE)
                for k in range(wp.static(K)):
                    if place == k:
                        for j in range(wp.static(NV)):
                            own[k, j] = row_i[j]
                        out.w0[k] = problem.w0[i]
                        out.scale[k] = problem.scale[i]
                        out.z[k] = z[i]
                        if wp.static(not method.hard):
                            out.sigma[k] = wp.static(noise.level[i])(world, problem.sigma)
                            out.inverse_sigma[k] = problem.inverse_sigma[i]
                place += 1
        out.a = places.product(own, problem.minv)
        for k in range(wp.static(K)):
            out.diag[k] = wp.where(place > k, wp.max(out.a[k, k], FLOOR), ONE)
        return out, place

    @wp.struct
    class At:
        lam: V
        res: V  # r(z)
        slope: V  # s'(z)
        slack: V  # s'(-z)
        merit: dtype  # sum r_i^2 / A_ii
        worst: dtype  # max |r_i|

    @wp.func
    def evaluate(p: Few, count: int, z: V):
        out = At()
        for k in range(wp.static(K)):
            out.slack[k] = ONE
            if wp.static(k) < count:
                if wp.static(method.hard):
                    e = wp.static(sm.kink)(z[k])
                else:
                    e = wp.static(sm.smooth)(z[k], p.sigma[k], p.inverse_sigma[k])
                out.lam[k] = e[0]
                if wp.static(method.inertia_scaling):
                    out.lam[k] = e[0] / p.scale[k]
                out.res[k] = p.w0[k] - e[1]
                out.slope[k] = e[2]
                out.slack[k] = e[3]
        out.res = out.res + p.a * out.lam
        for k in range(wp.static(K)):
            out.merit += out.res[k] * out.res[k] / p.diag[k]
            out.worst = wp.max(out.worst, wp.abs(out.res[k]))
        return out

    @wp.func
    def direction(p: Few, at: At):
        # as in elimination.py, in the space of the rows
        left = p.a
        moved = V()  # J dv
        innovation = V()
        weight = V()
        dz = V()
        for i in range(wp.static(K)):
            slack = at.slack[i]
            if wp.static(method.inertia_scaling):
                slack = slack * p.scale[i]
            weight[i] = ONE / (slack + at.slope[i] * (wp.max(left[i, i], ZERO) + TAU * p.diag[i]))
            innovation[i] = -weight[i] * (at.res[i] + moved[i])
            gain = at.slope[i] * weight[i]
            for l in range(wp.static(K)):
                if wp.static(l > i):
                    moved[l] += at.slope[i] * innovation[i] * left[l, i]
                    for m in range(wp.static(K)):
                        if wp.static(m > i and m <= l):
                            left[l, m] -= gain * left[l, i] * left[m, i]
        for j in range(wp.static(K)):
            dz[wp.static(K - 1 - j)] = innovation[wp.static(K - 1 - j)]
            for l in range(wp.static(K)):
                if wp.static(l > K - 1 - j):
                    coupling = weight[wp.static(K - 1 - j)] * left[l, wp.static(K - 1 - j)]
                    dz[wp.static(K - 1 - j)] = dz[wp.static(K - 1 - j)] - coupling * at.slope[l] * dz[l]
        if wp.static(method.inertia_scaling):
            for k in range(wp.static(K)):
                dz[k] = dz[k] * p.scale[k]
        return dz

    @wp.func
    def remainder(p: Few, count: int, dz: V):
        # bound on |r| after a full step, as in newton.py
        bend = ZERO
        largest = ZERO
        smallest = ZERO + HUGE
        for k in range(wp.static(K)):
            if wp.static(k) < count:
                bend += BEND * p.inverse_sigma[k] * dz[k] * dz[k]
                largest = wp.max(largest, p.diag[k])
                smallest = wp.min(smallest, p.scale[k])
        return bend * (ONE + largest / smallest)

    @wp.func
    def cancels(p: Few, lam: V, size: dtype):
        # whether impulses against each other are so large that rounding of A lambda is not rounding of J v'
        largest = ZERO
        for k in range(wp.static(K)):
            total = ZERO
            for l in range(wp.static(K)):
                total += wp.abs(p.a[k, l] * lam[l])
            largest = wp.max(largest, total)
        return not (largest <= CANCEL * size)

    @wp.func
    def solve_few(world: World, problem: Problem, z0: VR):
        p, count = gather(world, problem, z0)
        size = problem.size
        z = p.z
        lam = V()
        old = ZERO + HUGE
        status = int(wp.static(NOT_CONVERGED))
        it = int(0)
        on = wp.where(count <= wp.static(K), 1, 0)
        while on == 1 and status == wp.static(NOT_CONVERGED) and it < wp.static(ITERATIONS):
            it += 1
            at = evaluate(p, count, z)
            lam = at.lam
            if at.worst <= TOL * size and wp.isfinite(at.merit):  # wp.max drops a NaN
                status = wp.static(SOLVED)
            elif at.merit <= FALL * old or wp.static(method.hard):
                old = at.merit
                dz = direction(p, at)
                z = z + dz
                if wp.static(not method.hard):
                    if remainder(p, count, dz) <= TOL * size:
                        # lambda to first order in dz
                        for k in range(wp.static(K)):
                            change = at.slope[k] * dz[k]
                            if wp.static(method.inertia_scaling):
                                change = change / p.scale[k]
                            lam[k] = lam[k] + change
                        status = wp.static(SOLVED)
            else:  # no number, or a step too long
                on = int(0)
        if status == wp.static(SOLVED) and cancels(p, lam, size):
            status = wp.static(NOT_CONVERGED)
        v, z_out, lam_out = places.spread(problem, z, lam, z0)
        return v, z_out, lam_out, status, it

    return solve_few
