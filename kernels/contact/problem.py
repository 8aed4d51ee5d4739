"""The contact problem of a step as its solvers take and measure it, and a few of its rows by themselves."""

from types import SimpleNamespace

import warp as wp

from ..factories import cached
from ..mechanism.kinematics import make_types
from ..residual.noise import make_noise
from ..specialisation import Specialisation
from ..structure import Structure
from .rows import make_rows

SMALLEST = 1e-30  # of an A_ii
COLD = 1.0e30  # a multiplier that stands for "no warm start"


@cached
def make_problem(s: Structure, dtype: type) -> type:
    """The struct of a problem: 0 <= lambda _|_ J v' + d/h >= 0 with v' = v_free + M^-1 J' lambda, eq. (3)."""
    t = make_types(s, dtype)

    @wp.struct
    class Problem:
        minv: t.MQ
        vfree: t.VQ
        jac: t.JR
        rate: t.VR  # d/h
        scale: t.VR  # D
        sigma: t.VR  # noise levels, where they depend on the state
        mask: int  # bit i: row i is in the system
        # what solvers on z derive from these (`make_measure`)
        diag: t.VR  # A_ii; above zero even where J = 0
        inverse_diag: t.VR
        inverse_sigma: t.VR
        w0: t.VR  # J v_free + d/h
        size: dtype  # of the terms of the residual, the largest of all rows: what rounding is relative to
        least: dtype  # the smallest of all rows

    return Problem


@cached
def make_measure(spec: Specialisation) -> wp.Function:
    """measure(world, problem) -> the problem with what `Problem` derives."""
    s, dtype, method = spec
    r = make_rows(spec)
    noise = make_noise(spec)
    Problem = make_problem(s, dtype)
    ZERO, ONE, FLOOR, NONE = dtype(0.0), dtype(1.0), dtype(SMALLEST), dtype(COLD)
    index = tuple(row.index for row in s.rows)

    @wp.func
    def measure(world: r.types.World, problem: Problem):
        out = problem
        out.size = ZERO
        out.least = NONE
        for i in range(wp.static(s.nr)):
            if (problem.mask & wp.static(1 << i)) != 0:
                response = wp.static(r.applies[i])(problem.minv, problem.jac)
                out.diag[i] = wp.max(wp.static(r.dots[i])(problem.jac, response), FLOOR)
                out.inverse_diag[i] = ONE / out.diag[i]
                out.w0[i] = wp.static(r.dots[i])(problem.jac, problem.vfree) + problem.rate[i]
                terms = wp.abs(problem.rate[i]) + wp.abs(out.w0[i])
                if wp.static(r.limit[i]):
                    terms += wp.abs(problem.vfree[wp.static(index[i])])
                else:
                    for j in range(wp.static(s.nv)):
                        terms += wp.abs(problem.jac[i, j] * problem.vfree[j])
                if wp.static(not method.hard):
                    level = wp.static(noise.level[i])(world, problem.sigma)
                    out.inverse_sigma[i] = ONE / level
                    terms += level
                out.size = wp.max(out.size, terms)
                out.least = wp.min(out.least, terms)
        return out

    return measure


@cached
def make_places(spec: Specialisation, count: int) -> SimpleNamespace:
    """The rows in the mask in the first of `count` places, one after the other.

    product(J, M^-1) -> A = J M^-1 J' of the places; spread(problem, z, lambda, z0) -> v', z (z0 outside the
    mask), lambda of the structure's rows, from the places' z and lambda.
    """
    s, dtype, _ = spec
    r = make_rows(spec)
    t = r.types
    Problem = make_problem(s, dtype)
    V = wp.types.vector(count, dtype)
    A = wp.types.matrix((count, count), dtype)
    J = wp.types.matrix((count, s.nv), dtype)

    @wp.func
    def product(own: J, minv: t.MQ):
        out = A()
        for k in range(wp.static(count)):
            g = minv * own[k]
            for l in range(wp.static(count)):
                if wp.static(l <= k):
                    out[k, l] = wp.dot(own[l], g)
                    out[l, k] = out[k, l]
        return out

    @wp.func
    def spread(problem: Problem, z: V, lam: V, z0: t.VR):
        z_out = z0
        lam_out = t.VR()
        f = t.VQ()
        place = int(0)
        for i in range(wp.static(s.nr)):
            if (problem.mask & wp.static(1 << i)) != 0:
                for k in range(wp.static(count)):
                    if place == k:
                        z_out[i] = z[k]
                        lam_out[i] = lam[k]
                f = wp.static(r.adds[i])(f, problem.jac, lam_out[i])
                place += 1
        return problem.vfree + problem.minv * f, z_out, lam_out

    return SimpleNamespace(V=V, A=A, J=J, product=product, spread=spread)
