"""Kernels for derivatives along trajectories: Jacobians and second derivatives in batch, and the adjoint of
a rollout.
"""

import functools

import warp as wp

from .compile import specialised
from .curvature import make_curvature
from .method import Method
from .parameter_gradient import make_parameter_gradient
from .rollout import make_world
from .sensitivity import make_linearization
from .solve import SOLVED
from .structure import Structure


@functools.cache
def make_linearize_kernel(s: Structure, dtype: type, method: Method, second: bool) -> wp.Kernel:
    """A = df/dx, B = df/du (and d2v'/d(x, u)2) at every (problem, step): item i is step i mod N of problem i
    div N.
    """
    linear = make_linearization(s, dtype, method)
    step = linear.step
    world_of = make_world(s, dtype, method, False)
    curvature = make_curvature(s, dtype, method) if second else None
    NV, NX, NU, NZ = s.nv, 2 * s.nv, s.nu, linear.NZ
    VX, VU, DV = step.types.VX, step.types.VU, linear.DV
    ZERO, ONE = dtype(0.0), dtype(1.0)

    @wp.func
    def write(
        fx: wp.array4d(dtype=dtype), fu: wp.array4d(dtype=dtype), b: int, k: int, h: dtype, dv: DV, drift: DV
    ):
        # x' = (q + h v*, v'), v* = v' but for the trapezoidal integrator
        for i in range(wp.static(NV)):
            for j in range(wp.static(NX)):
                fx[b, k, wp.static(NV + i), j] = dv[i, j]
                fx[b, k, i, j] = h * drift[i, j] + wp.where(wp.static(i == j), ONE, ZERO)
            for j in range(wp.static(NU)):
                fu[b, k, wp.static(NV + i), j] = dv[i, wp.static(NX + j)]
                fu[b, k, i, j] = h * drift[i, wp.static(NX + j)]

    @specialised(s, dtype, method, second)
    def linearize_kernel(
        first: int,
        params: wp.array2d(dtype=dtype),
        steps: int,
        xs: wp.array3d(dtype=dtype),  # (B, >= N, nx)
        us: wp.array3d(dtype=dtype),  # (B, N, nu)
        external: wp.array2d(dtype=dtype),
        active: wp.array(dtype=wp.int32),  # (0 or B,) zero: skip the problem
        fx: wp.array4d(dtype=dtype),  # out (B, N, nx, nx)
        fu: wp.array4d(dtype=dtype),  # out (B, N, nx, nu)
        fzz: wp.array4d(dtype=dtype),  # out (B N, nv, nz, nz) or empty
        status: wp.array2d(dtype=wp.int32),  # out (B, N)
    ):
        item = first + wp.tid()
        b = item / steps
        k = item - b * steps
        if active.shape[0] > 0:
            if active[b] == 0:
                return
        row = wp.where(params.shape[0] == 1, 0, b)
        x = VX()
        u = VU()
        for j in range(wp.static(NX)):
            x[j] = xs[b, k, j]
        for j in range(wp.static(NU)):
            u[j] = us[b, k, j]
        sol = step.solve_step(params, row, x, u, external, b, step.cold_carry())
        code = world_of.status_of(sol, step.next_state(params, row, x, sol))
        status[b, k] = code
        if code == wp.static(SOLVED):
            lin, drift = linear.linearize(params, row, x, sol, external, b)
            write(fx, fu, b, k, params[row, 0], lin.dv, drift)
            if wp.static(second):
                for output in range(NV):
                    hess = wp.static(curvature)(params, row, x, sol, lin, output, external, b)
                    for i in range(wp.static(NZ)):
                        for j in range(wp.static(NZ)):
                            fzz[item, output, i, j] = hess[i, j]

    return linearize_kernel


@functools.cache
def make_adjoint_kernel(s: Structure, dtype: type, method: Method, by_parameters: bool) -> wp.Kernel:
    """Reverse sweep of open-loop rollouts: gradients by x0, controls and parameters from gradients by the
    recorded states.

    Every step is solved again at its recorded state and differentiated at the solution; nothing else is
    stored.
    """
    linear = make_linearization(s, dtype, method)
    step = linear.step
    NV, NX, NU = s.nv, 2 * s.nv, s.nu
    VX, VU = step.types.VX, step.types.VU

    parameters = make_parameter_gradient(s, dtype, method) if by_parameters else None
    VQ = step.types.VQ

    @specialised(s, dtype, method, by_parameters)
    def adjoint_kernel(
        first: int,
        params: wp.array2d(dtype=dtype),
        us: wp.array3d(dtype=dtype),  # (B, N, nu)
        external: wp.array2d(dtype=dtype),
        states: wp.array3d(dtype=dtype),  # (B, N+1, nx)
        status: wp.array(dtype=wp.int32),  # (B,)
        states_grad: wp.array3d(dtype=dtype),  # (B, N+1, nx)
        x0_grad: wp.array2d(dtype=dtype),  # accumulated (0 or B, nx)
        us_grad: wp.array3d(dtype=dtype),  # accumulated (0 or B, N, nu)
        params_grad: wp.array2d(dtype=dtype),  # accumulated (0 or B, width)
    ):
        world = first + wp.tid()
        row = wp.where(params.shape[0] == 1, 0, world)
        steps = us.shape[1]
        h = params[row, 0]
        g = VX()
        for j in range(wp.static(NX)):
            g[j] = states_grad[world, steps, j]
        carry = step.cold_carry()
        for back in range(steps):
            k = steps - 1 - back
            x = VX()
            u = VU()
            total = VX()
            for j in range(wp.static(NX)):
                x[j] = states[world, k, j]
                total[j] = states_grad[world, k, j]
            for j in range(wp.static(NU)):
                u[j] = us[world, k, j]
            sol = step.solve_step(params, row, x, u, external, world, carry)
            carry.z = sol.z
            carry.normal = sol.normal
            lin, drift = linear.linearize(params, row, x, sol, external, world)
            if wp.static(by_parameters):
                weights = VQ()
                for i in range(wp.static(NV)):
                    weights[i] = g[wp.static(NV + i)] + h * g[i]
                    params_grad[world, 0] = params_grad[world, 0] + g[i] * sol.v[i]  # q' = q + h v'
                wp.static(parameters)(params, row, x, u, external, world, sol, lin, weights, params_grad)
            for i in range(wp.static(NV)):
                total[i] = total[i] + g[i]
                for j in range(wp.static(NX)):
                    total[j] = total[j] + (g[wp.static(NV + i)] * lin.dv[i, j] + h * g[i] * drift[i, j])
                if us_grad.shape[0] > 0:
                    for j in range(wp.static(NU)):
                        c = wp.static(NX + j)
                        value = g[wp.static(NV + i)] * lin.dv[i, c] + h * g[i] * drift[i, c]
                        us_grad[world, k, j] = us_grad[world, k, j] + value
            g = total
        if status[world] != wp.static(SOLVED):  # no gradient exists: say so instead of inventing one
            for j in range(wp.static(NX)):
                g[j] = dtype(wp.NAN)
            if us_grad.shape[0] > 0:
                for k in range(steps):
                    for j in range(wp.static(NU)):
                        us_grad[world, k, j] = dtype(wp.NAN)
            if wp.static(by_parameters):
                for j in range(params_grad.shape[1]):
                    params_grad[world, j] = dtype(wp.NAN)
        if x0_grad.shape[0] > 0:
            for j in range(wp.static(NX)):
                x0_grad[world, j] = x0_grad[world, j] + g[j]

    return adjoint_kernel
