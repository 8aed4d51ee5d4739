"""Hard contact with Coulomb's friction of at most FEW rows, unrolled.

The active sets of `coulomb.py` on a small dense problem: rows that press or stick hold (J v' + d/h = 0), a
sliding contact's tangential impulse is +-mu times its normal one, the others are zero. The rows that hold are
met by elimination without pivoting and a proximal term about the last impulses, applied twice. Where a pivot
is not positive (Painleve) or the modes do not settle, the general method starts afresh.
"""

import warp as wp

from ..contact.problem import COLD, make_places, make_problem
from ..contact.problem import SMALLEST as LEAST
from ..contact.rows import make_rows
from ..factories import cached
from ..specialisation import Specialisation
from ..structure import layout
from .coulomb_alone import make_cone
from .few_rows import LARGEST

FEW = 4
ITERATIONS = 5
TOLERANCE = {wp.float64: 1e-13, wp.float32: 2e-6}  # of the natural map, relative to the problem's size
MISSED = {wp.float64: 5e-11, wp.float32: 1e-4}  # and to the contact's own
PROXIMAL = {wp.float64: 1e-9, wp.float32: 1e-4}  # relative to A_ii


@cached
def make_coulomb_few(spec: Specialisation) -> wp.Function:
    """few(world, problem, warm) -> v', z, lambda, found.

    found is 0 where there are more than FEW rows, or no solution was found.
    """
    s, dtype, _ = spec
    r = make_rows(spec)
    VQ, VR, World = r.types.VQ, r.types.VR, r.types.World
    NR, NV, K = s.nr, s.nv, min(FEW, s.nr)
    Problem, places = make_problem(s, dtype), make_places(spec, K)
    V, M, J = places.V, places.A, places.J
    cone = make_cone(dtype)
    ZERO, ONE, SMALLEST = dtype(0.0), dtype(1.0), dtype(LEAST)
    TOL, TAU = dtype(TOLERANCE[dtype]), dtype(PROXIMAL[dtype])
    MISS = dtype(MISSED[dtype])
    UNUSED, HUGE, CANCEL = dtype(0.5 * COLD), dtype(1e30), dtype(LARGEST)
    FRICTION = layout(s).offset("friction")
    pair = tuple(row.index if row.kind == "contact" else 0 for row in s.rows)
    warmed = len(s.pairs) > 1  # of several contacts the last step knows more

    @wp.struct
    class Few:
        a: M  # J M^-1 J'
        b: V  # J v_free + d/h
        mu: V  # of friction rows; -1: a normal row or a limit, -2: no row
        z: V
        own: V  # size of the row's own terms
        size: dtype  # of the terms of the natural map

    @wp.func
    def gather(world: World, problem: Problem, warm: VR):
        out = Few()
        own = J()
        place = int(0)
        for k in range(wp.static(K)):
            out.mu[k] = -ONE - ONE
            out.z[k] = UNUSED
        for i in range(wp.static(NR)):
            if (problem.mask & wp.static(1 << i)) != 0:
                row_i = wp.static(r.adds[i])(VQ(), problem.jac, ONE)
                b = wp.static(r.dots[i])(problem.jac, problem.vfree) + problem.rate[i]
                terms = wp.abs(b) + wp.abs(problem.rate[i])
                for j in range(wp.static(NV)):
                    terms += wp.abs(row_i[j] * problem.vfree[j])
                out.size = wp.max(out.size, terms)
                for k in range(wp.static(K)):
                    if place == k:
                        for j in range(wp.static(NV)):
                            own[k, j] = row_i[j]
                        out.b[k] = b
                        out.own[k] = terms
                        out.mu[k] = -ONE
                        if wp.static(r.tangent[i]):
                            out.mu[k] = world.params[wp.static(FRICTION + pair[i])]
                        if wp.static(warmed):
                            out.z[k] = warm[i]
                place += 1
        out.a = places.product(own, problem.minv)
        for k in range(wp.static(K)):
            if out.mu[k] < -ONE:
                out.a[k, k] = ONE
            elif not (out.a[k, k] > SMALLEST):  # no impulse moves the row
                place = wp.static(FEW + 1)
        return out, place

    @wp.func
    def start(p: Few):
        # z of the last step, else of every contact as if it were the only one
        z = p.z
        for k in range(wp.static(K)):
            if not (wp.abs(p.z[k]) < UNUSED):
                if p.mu[k] < ZERO:
                    z[k] = -p.b[k]
                for l in range(wp.static(K)):
                    if wp.static(l == k + 1):
                        if p.mu[l] >= ZERO:
                            lam = cone(p.mu[l], p.a[k, k], p.a[k, l], p.a[l, l], p.b[k], p.b[l])
                            if p.b[k] < ZERO:
                                z[k] = p.a[k, k] * lam[0]
                            z[l] = -(p.b[l] + p.a[k, l] * lam[0])
        return z

    @wp.struct
    class Modes:
        held: V  # 1: presses or sticks
        slide: V  # of a pressing contact's friction row: lambda_t/lambda_n where it slides, else 0

    @wp.func
    def modes(p: Few, z: V):
        out = Modes()
        for k in range(wp.static(K)):
            if p.mu[k] == -ONE and z[k] > ZERO:
                out.held[k] = ONE
            for l in range(wp.static(K)):
                if wp.static(l == k - 1):
                    if p.mu[k] >= ZERO and out.held[l] == ONE:
                        bound = p.a[k, k] * p.mu[k] * z[l] / p.a[l, l]
                        if wp.abs(z[k]) <= bound:
                            out.held[k] = ONE
                        else:
                            out.slide[k] = wp.where(z[k] > ZERO, p.mu[k], -p.mu[k])
        return out

    @wp.func
    def factor(p: Few, m: Modes):
        # LU of the rows that hold, A + tau diag(A); unit rows for the others; not positive: no pivot
        lu = M()
        for i in range(wp.static(K)):
            for j in range(wp.static(K)):
                value = p.a[i, j]
                for l in range(wp.static(K)):
                    if wp.static(l == j + 1):
                        value += m.slide[l] * p.a[i, l]
                if wp.static(i == j):
                    value += TAU * p.a[i, i]
                    lu[i, j] = wp.where(m.held[i] == ONE, value, ONE)
                else:
                    lu[i, j] = m.held[i] * m.held[j] * value
        good = int(1)
        for c in range(wp.static(K)):
            if not (lu[c, c] > ZERO):
                good = 0
            inverse = ONE / lu[c, c]
            for i in range(wp.static(K)):
                if wp.static(i > c):
                    lu[i, c] = lu[i, c] * inverse
                    for j in range(wp.static(K)):
                        if wp.static(j > c):
                            lu[i, j] = lu[i, j] - lu[i, c] * lu[c, j]
            lu[c, c] = inverse
        return lu, good

    @wp.func
    def impulses(p: Few, m: Modes, lu: M, centre: V):
        # lambda with (A + tau diag(A)) lambda = tau diag(A) centre - b in the rows that hold
        x = V()
        for i in range(wp.static(K)):
            x[i] = m.held[i] * (TAU * p.a[i, i] * centre[i] - p.b[i])
            for j in range(wp.static(K)):
                if wp.static(j < i):
                    x[i] = x[i] - lu[i, j] * x[j]
        for k in range(wp.static(K)):
            for j in range(wp.static(K)):
                if wp.static(j > K - 1 - k):
                    x[wp.static(K - 1 - k)] = x[wp.static(K - 1 - k)] - lu[wp.static(K - 1 - k), j] * x[j]
            x[wp.static(K - 1 - k)] = x[wp.static(K - 1 - k)] * lu[wp.static(K - 1 - k), wp.static(K - 1 - k)]
        for k in range(wp.static(K)):
            for l in range(wp.static(K)):
                if wp.static(l == k - 1):
                    if m.slide[k] != ZERO:
                        x[k] = m.slide[k] * x[l]
        return x

    @wp.func
    def violation(p: Few, lam: V, z: V):
        # largest error of the natural map, huge where impulses against each other hide it, where it is one on
        # the scale of the contact itself (others may be far faster), or where it is no number
        worst = ZERO
        for k in range(wp.static(K)):
            error = ZERO
            total = ZERO
            for l in range(wp.static(K)):
                total += wp.abs(p.a[k, l] * lam[l])
            if not (total <= CANCEL * p.size):
                error = ZERO + HUGE
            own = p.own[k]
            if p.mu[k] == -ONE:
                error = wp.max(error, wp.abs(wp.min(p.a[k, k] * lam[k], p.a[k, k] * lam[k] - z[k])))
                for l in range(wp.static(K)):
                    if wp.static(l == k + 1):
                        if p.mu[l] >= ZERO:
                            own += p.own[l]
            for l in range(wp.static(K)):
                if wp.static(l == k - 1):
                    if p.mu[k] >= ZERO:
                        bound = p.a[k, k] * p.mu[k] * wp.max(lam[l], ZERO)
                        error = wp.max(error, wp.abs(p.a[k, k] * lam[k] - wp.clamp(z[k], -bound, bound)))
                        own += p.own[l]
            if error > MISS * own:
                error = ZERO + HUGE
            worst = wp.max(worst, error)
        return worst

    @wp.func
    def few(world: World, problem: Problem, warm: VR):
        p, count = gather(world, problem, warm)
        z = start(p)
        lam = V()
        for k in range(wp.static(K)):
            if p.mu[k] == -ONE:
                lam[k] = wp.max(z[k], ZERO) / p.a[k, k]
        found = int(0)
        it = int(0)
        while found == 0 and it < wp.static(ITERATIONS) and count <= wp.static(K):
            it += 1
            m = modes(p, z)
            lu, good = factor(p, m)
            lam = impulses(p, m, lu, lam)
            lam = impulses(p, m, lu, lam)
            w = p.b + p.a * lam
            for k in range(wp.static(K)):
                z[k] = p.a[k, k] * lam[k] - w[k]
            if good == 0:
                it = wp.static(ITERATIONS)
            elif violation(p, lam, z) <= TOL * p.size:
                found = 1
        v, z_out, lam_out = places.spread(problem, z, lam, warm)
        return v, z_out, lam_out, found

    return few
