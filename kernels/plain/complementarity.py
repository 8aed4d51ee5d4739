"""Kernels for plain (stochastic) linear complementarity problems (3): w = A lambda + b, and their adjoint.

A batch of problems is a mechanism of n sliders at a lower limit, J = 1, M^-1 = A, v_free = b, for which the
step's solvers need no more than products with A: a semidefinite A is fine.

Adjoint of the roots F = s(x) - D lambda = 0, x = D lambda - w: with p = s'(x), q = 1 - p and (Q D + A P) nu
= g the gradients are -p nu by b, -(p nu) lambda' by A, -q lambda nu by D and nu (s - x p)/sigma by sigma.
Adjoint of ERM: `erm.py`'s gradient G = D r_a + A r_w = 0 with mu = -H^-1 g.
"""

import math
from types import SimpleNamespace

import warp as wp

from ..contact.problem import COLD, make_problem
from ..contact.rows import make_rows
from ..device.compile import specialised
from ..factories import cached
from ..method import Method
from ..residual.smoothing import make_smoothing
from ..solvers.continuation import make_continuation_solver
from ..solvers.convex import make_solver
from ..solvers.elimination import PROXIMAL, make_row_elimination
from ..solvers.erm import PROXIMAL as ERM_PROXIMAL
from ..solvers.erm import make_erm
from ..solvers.erm_descent import make_erm_solver
from ..specialisation import Specialisation
from ..status import NONFINITE, SOLVED
from ..structure import PRISMATIC, WORLD, BodyStructure, Structure


@cached
def sliders(n: int) -> Structure:
    """n sliders, each with a lower limit: as many rows with J = 1."""
    bodies = tuple(BodyStructure(WORLD, PRISMATIC, (i,)) for i in range(n))
    return Structure(bodies, (), (), (True,) * n, (False,) * n, ())


def method_of(residual: str, scaling: str) -> Method:
    """The method with noise levels handed to the solver, not read from a table of parameters."""
    return Method(residual, scaling, noise="state", deviation="scale")


@cached
def make_reader(n: int, dtype: type, method: Method) -> SimpleNamespace:
    """read(A, b, sigma, item) -> Problem; what both kernels share."""
    spec = Specialisation(sliders(n), dtype, method)
    r = make_rows(spec)
    t = r.types
    Problem = make_problem(spec.structure, dtype)
    ALL = (1 << n) - 1

    @wp.func
    def read(
        A: wp.array3d(dtype=dtype), b: wp.array2d(dtype=dtype), sigma: wp.array2d(dtype=dtype), item: int
    ):
        out = Problem()
        for i in range(n):
            out.vfree[i] = b[item, i]
            out.sigma[i] = sigma[item, i]
            for j in range(n):
                out.minv[i, j] = A[item, i, j]
        out.mask = wp.static(ALL)
        out.scale = wp.static(r.scale)(out.minv, out.jac, out.mask)
        return out

    return SimpleNamespace(spec=spec, types=t, rows=r, Problem=Problem, read=read)


@cached
def make_complementarity_kernel(n: int, dtype: type, method: Method, continuation: bool) -> wp.Kernel:
    """Solves one problem an item, hard ones by `continuation.py` if asked."""
    problem = make_reader(n, dtype, method)
    t = problem.types
    make = make_continuation_solver if continuation else make_erm_solver if method.erm else make_solver
    solver = make(problem.spec)
    UNUSED = dtype(COLD)

    @specialised
    def complementarity_kernel(
        first: int,
        A: wp.array3d(dtype=dtype),  # (B, n, n)
        b: wp.array2d(dtype=dtype),  # (B, n)
        sigma: wp.array2d(dtype=dtype),  # (B, n)
        impulse: wp.array2d(dtype=dtype),  # out (B, n)
        slack: wp.array2d(dtype=dtype),  # out (B, n), w = A lambda + b
        status: wp.array(dtype=wp.int32),  # out (B,)
        iterations: wp.array(dtype=wp.int32),  # out (B,)
    ):
        item = first + wp.tid()
        p = problem.read(A, b, sigma, item)
        v, _z, lam, code, count = wp.static(solver)(t.World(), p, t.VR(UNUSED))
        finite = wp.isfinite(wp.dot(lam, lam))
        if code == wp.static(SOLVED) and not finite:
            code = wp.static(NONFINITE)
        status[item] = code
        iterations[item] = count
        for i in range(n):
            impulse[item, i] = lam[i]
            slack[item, i] = v[i]

    return complementarity_kernel


@cached
def make_complementarity_adjoint_kernel(n: int, dtype: type, method: Method) -> wp.Kernel:
    """Adds the gradients by A (symmetric), b and sigma; NaN where the problem was not solved."""
    problem = make_reader(n, dtype, method)
    t = problem.types
    VR = t.VR
    sm = make_smoothing(dtype, method.residual)
    elimination = make_row_elimination(problem.spec)
    erm = make_erm(n, dtype, method.residual) if method.erm else None
    TAU = dtype((ERM_PROXIMAL if method.erm else PROXIMAL)[dtype])
    HALF, ONE, NAN = dtype(0.5), dtype(1.0), dtype(math.nan)

    @wp.struct
    class Gradient:
        left: VR  # by A: left lambda' + outer right'
        outer: VR
        right: VR
        by_b: VR
        by_scale: VR
        by_sigma: VR

    @wp.func
    def by_root(p: problem.Problem, lam: VR, w: VR, grad: VR):
        out = Gradient()
        slope = VR()
        slack = VR()
        diag = VR()
        rise = VR()
        for i in range(wp.static(n)):
            x = p.scale[i] * lam[i] - w[i]
            if wp.static(method.hard):
                e = wp.static(sm.kink)(x)
            else:
                e = wp.static(sm.smooth)(x, p.sigma[i], ONE / p.sigma[i])
                rise[i] = (e[0] - x * e[2]) / p.sigma[i]
                if x > dtype(0.0):
                    rise[i] = (e[1] + x * e[3]) / p.sigma[i]
            slope[i] = e[2]
            slack[i] = e[3]
            diag[i] = p.minv[i, i]
        fac = wp.static(elimination.factor)(p.minv, p.jac, p.scale, diag, slope, slack, p.mask, TAU)
        _dv, innovation = wp.static(elimination.forward)(fac, p.jac, slope, p.mask, t.VQ(), grad)
        dz = wp.static(elimination.back)(fac, p.jac, p.scale, slope, p.mask, innovation)
        for i in range(wp.static(n)):
            nu = dz[i] / p.scale[i]
            out.left[i] = -slope[i] * nu
            out.by_b[i] = -slope[i] * nu
            out.by_scale[i] = -slack[i] * lam[i] * nu
            out.by_sigma[i] = rise[i] * nu
        return out

    @wp.func
    def by_minimum(p: problem.Problem, lam: VR, w: VR, grad: VR):
        out = Gradient()
        a = wp.cw_mul(p.scale, lam)
        l, _ok = wp.static(erm.factor if erm else None)(
            wp.static(erm.hessian if erm else None)(p.minv, p.scale, p.sigma, a, w),
            wp.static(erm.sizes if erm else None)(p.minv, p.scale),
            TAU,
        )
        mu = -wp.static(erm.substitute if erm else None)(l, grad)
        moved = p.minv * mu
        for i in range(wp.static(n)):
            e = wp.static(erm.terms if erm else None)(a[i], w[i], p.sigma[i])
            out.outer[i] = mu[i]
            out.right[i] = e[1]
            out.by_b[i] = e[3] * p.scale[i] * mu[i] + e[4] * moved[i]
            out.left[i] = out.by_b[i]
            out.by_scale[i] = mu[i] * (e[0] + p.scale[i] * e[2] * lam[i]) + moved[i] * e[3] * lam[i]
            # r_a and r_w are of degree 1 in (a, w, sigma)
            by_a = (e[0] - a[i] * e[2] - w[i] * e[3]) / p.sigma[i]
            by_w = (e[1] - a[i] * e[3] - w[i] * e[4]) / p.sigma[i]
            out.by_sigma[i] = p.scale[i] * mu[i] * by_a + moved[i] * by_w
        return out

    adjoint = by_minimum if method.erm else by_root

    @specialised
    def complementarity_adjoint_kernel(
        first: int,
        A: wp.array3d(dtype=dtype),  # (B, n, n)
        b: wp.array2d(dtype=dtype),  # (B, n)
        sigma: wp.array2d(dtype=dtype),  # (B, n)
        impulse: wp.array2d(dtype=dtype),  # (B, n)
        slack: wp.array2d(dtype=dtype),  # (B, n)
        status: wp.array(dtype=wp.int32),  # (B,)
        impulse_grad: wp.array2d(dtype=dtype),  # (B, n)
        A_grad: wp.array3d(dtype=dtype),  # in out (B, n, n)
        b_grad: wp.array2d(dtype=dtype),  # in out (B, n)
        sigma_grad: wp.array2d(dtype=dtype),  # in out (B, n)
    ):
        item = first + wp.tid()
        p = problem.read(A, b, sigma, item)
        lam = VR()
        w = VR()
        grad = VR()
        for i in range(n):
            lam[i] = impulse[item, i]
            w[i] = slack[item, i]
            grad[i] = impulse_grad[item, i]
            if status[item] != wp.static(SOLVED):
                grad[i] = NAN
        g = wp.static(adjoint)(p, lam, w, grad)
        for i in range(n):
            b_grad[item, i] = b_grad[item, i] + g.by_b[i]
            sigma_grad[item, i] = sigma_grad[item, i] + g.by_sigma[i]
            for j in range(n):
                value = g.left[i] * lam[j] + g.left[j] * lam[i]
                value += g.outer[i] * g.right[j] + g.outer[j] * g.right[i]
                value = HALF * value
                if wp.static(method.inertia_scaling):
                    if i == j:
                        value += g.by_scale[i]
                A_grad[item, i, j] = A_grad[item, i, j] + value

    return complementarity_adjoint_kernel
