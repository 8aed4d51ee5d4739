"""Newton's method for the smoothed complementarity problem in mixed form.

Unknowns z, one a row: D lambda = s(z), w = s(-z), and v' = v_free + M^-1 J' lambda exactly; what is left is
r(z) = J v' + d/h - s(-z) = 0. A Newton step solves [M, -J'; J, C](dv, dlambda) = (0, -r), C = D
s'(-z)/s'(z) (M19), shortened until sum r_i^2/A_ii falls (newton.py). Where it does not, or the
semismooth Newton of the `hard` problem (3) cycles, an interior-point method (interior.py) finds a better z
to go on from, or a proof that no velocity opens the rows. For REM-logistic, eq. (17), the root is unique
(docs/understand/residuals.md).
"""

import warp as wp

from ..contact.apart import make_apart
from ..contact.problem import COLD, make_measure, make_problem
from ..contact.row_sizes import make_row_sizes
from ..contact.rows import make_rows
from ..device.seldom import seldom
from ..factories import cached
from ..specialisation import Specialisation
from ..status import INFEASIBLE, NOT_CONVERGED, SOLVED
from .few_rows import make_few_rows
from .interior import make_interior
from .newton import make_newton


@cached
def make_solver(spec: Specialisation) -> wp.Function:
    """solve(world, problem, warm) -> v', z, lambda, status, iterations; warm: z of the last step. A fast
    method has the solver of few rows alone.
    """
    s, dtype, method = spec
    r = make_rows(spec)
    solve_few = make_few_rows(spec)
    Problem, measure = make_problem(s, dtype), make_measure(spec)
    row_sizes = make_row_sizes(spec)
    uneven = row_sizes.uneven
    apart = make_apart(spec)
    VQ, VR, World = r.types.VQ, r.types.VR, r.types.World
    NR = s.nr
    ZERO, HALF, UNUSED = dtype(0.0), dtype(0.5), dtype(COLD)
    RANK = dtype(1e-14 if dtype is wp.float64 else 1e-6)
    CERTIFICATE = dtype(1e-18 if dtype is wp.float64 else 1e-11)  # a square: tells 1:1e6 in mass from zero
    ROUNDING = dtype(1e-15 if dtype is wp.float64 else 5e-7)
    SPEED = dtype(1e6 if dtype is wp.float64 else 1e5)  # opens nothing, relative to the problem's

    def make_couple(first: int) -> wp.Function:
        @wp.func
        def couple(p: Problem, z: VR):
            """z of the hard two-row problem of one frictional contact, alone."""
            out = z
            c = wp.static(r.dots[first + 1])(p.jac, wp.static(r.applies[first])(p.minv, p.jac))
            w1 = p.w0[wp.static(first)]
            w2 = p.w0[wp.static(first + 1)]
            a1 = p.diag[wp.static(first)]
            a2 = p.diag[wp.static(first + 1)]
            d1 = p.scale[wp.static(first)]
            d2 = p.scale[wp.static(first + 1)]
            det = a1 * a2 - c * c
            l1 = (c * w2 - a2 * w1) / det
            l2 = (c * w1 - a1 * w2) / det
            if not (l1 > ZERO and l2 > ZERO and det > RANK * a1 * a2):  # opposed rows: det = 0
                l1 = wp.max(-w1 / a1, ZERO)
                l2 = ZERO
                if w2 + c * l1 < ZERO:
                    l1 = ZERO
                    l2 = wp.max(-w2 / a2, ZERO)
            out[wp.static(first)] = d1 * l1 - wp.max(w1 + a1 * l1 + c * l2, ZERO)
            out[wp.static(first + 1)] = d2 * l2 - wp.max(w2 + c * l1 + a2 * l2, ZERO)
            return out

        return couple

    frictional = tuple(row.kind == "contact" and row.sign > 0 for row in s.rows)
    couples = tuple(make_couple(i) if frictional[i] else None for i in range(NR))

    @wp.func
    def start(p: Problem, warm: VR):
        # the hard solution of every limit and contact alone; after an impact better than the last step's
        z = VR()
        for i in range(wp.static(NR)):
            z[i] = UNUSED
            if (p.mask & wp.static(1 << i)) != 0:
                z[i] = -p.w0[i]
                if p.w0[i] < ZERO:
                    z[i] = -p.w0[i] * p.scale[i] / p.diag[i]
        for i in range(wp.static(NR)):
            if wp.static(frictional[i]):
                if (p.mask & wp.static(3 << i)) == wp.static(3 << i):
                    z = wp.static(couples[i])(p, z)
        # of several contacts together the last step knows more; if it misleads, the second attempt is cold
        if wp.static(len(s.pairs) > 1):
            for i in range(wp.static(NR)):
                if (p.mask & wp.static(1 << i)) != 0 and wp.abs(warm[i]) < HALF * UNUSED:
                    z[i] = warm[i]
        return z

    @wp.func
    def judged(world: World, p: Problem, v: VQ, status: int):
        """The status of a solution v', which friction may not hide overlaps of."""
        if wp.static(apart.large is not None):
            if seldom(apart.large(world, p)):
                if status == wp.static(SOLVED) and not apart.keeps_apart(world, p, v):
                    return wp.static(NOT_CONVERGED)
        return status

    @wp.func
    def solve_fast(world: World, problem: Problem, warm: VR):
        p = measure(world, problem)
        z = start(p, warm)
        if wp.static(uneven is not None):
            if uneven(p):
                return p.vfree, z, VR(), wp.static(NOT_CONVERGED), int(0)
        return solve_few(world, p, z)

    if method.fast:
        return solve_fast
    interior, n = make_interior(spec), make_newton(spec)

    @wp.func
    def proves_infeasible(p: Problem, y: VR):
        # Farkas: y >= 0, J'y = 0, y.w0 = y.d/h < 0 proves that no velocity opens the rows; where J'y is not
        # quite 0, that no velocity below SPEED times the problem's does
        f = VQ()
        length = ZERO
        work = ZERO
        smallest = ZERO + UNUSED
        for i in range(wp.static(NR)):
            if (p.mask & wp.static(1 << i)) != 0:
                length += y[i] * y[i] * p.diag[i]
                work += y[i] * p.w0[i]
                smallest = wp.min(smallest, p.diag[i])
                f = wp.static(r.adds[i])(f, p.jac, y[i])
        left = wp.dot(f, p.minv * f)
        rounds = ZERO  # of that product, for its terms: where J = 1 and M^-1 is singular it is nothing else
        for i in range(wp.static(s.nv)):
            for j in range(wp.static(s.nv)):
                rounds += wp.abs(f[i] * p.minv[i, j] * f[j])
        left = wp.max(left - ROUNDING * rounds, ZERO)
        moves = SPEED * p.size * wp.sqrt(left / smallest)
        return work < -moves and left <= CERTIFICATE * length

    @wp.func
    def solve(world: World, problem: Problem, warm: VR):
        p = measure(world, problem)
        z = start(p, warm)
        v, z_few, lam_few, status, iterations = solve_few(world, p, z)
        differ = bool(False)
        unlike = bool(False)
        size = p.size
        if wp.static(uneven is not None):
            differ = uneven(p)
            if seldom(differ):
                unlike, size = row_sizes.unlike(world, p)
        if not seldom(status != wp.static(SOLVED) or unlike):
            return v, z_few, lam_few, judged(world, p, v, status), iterations
        if status == wp.static(SOLVED):  # relative to the largest row
            z = z_few
            status = wp.static(NOT_CONVERGED)
        at = n.Point()
        attempt = int(0)
        while status == wp.static(NOT_CONVERGED) and attempt < 2:
            if attempt == 1:
                z, lam, found, count = interior(world, p, start(p, VR(UNUSED)))
                iterations += count
                if found == 0 and proves_infeasible(p, lam):
                    status = wp.static(INFEASIBLE)
            if status == wp.static(NOT_CONVERGED):
                at, z, status, count = wp.static(n.newton)(world, p, z, size)
                iterations += count
                if status == wp.static(SOLVED) and not wp.static(n.good)(world, p, at, z, differ):
                    status = wp.static(NOT_CONVERGED)
            attempt += 1
        return at.v, z, at.lam, judged(world, p, at.v, status), iterations

    return solve
