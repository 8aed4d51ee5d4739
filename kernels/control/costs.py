"""Derivatives of the running and final cost along a batch of trajectories.

A cost is a pair of Warp functions, ``running(weights, row, x, u, k) -> dtype`` and ``final(weights, row, x)
-> dtype``. Derivatives are the cost's own where it has them. Otherwise they come from central differences of
fourth order in double precision, of the cost's float64 version whatever the dtype of the trajectories:
relative to the cost and for variables of order one, gradients are good to about 1e-12 and Hessians to about
1e-9. Warp's adjoint, which would have to be looked at first (`adjoint_check`), costs seconds more to compile.
"""

from typing import Any, NamedTuple

import warp as wp

from ..device.compile import named_by_code
from ..device.differences import make_scalar_differences
from ..factories import cached
from .solver_state import make_derivative_arrays


class CostFunctions(NamedTuple):
    """Warp functions of a cost for one dtype; the last two may be None.

    running_derivatives(weights, row, x, u, k) -> (l_x, l_u, l_xx, l_ux, l_uu)
    final_derivatives(weights, row, x) -> (l_x, l_xx)
    """

    running: Any
    final: Any
    running_derivatives: Any = None
    final_derivatives: Any = None


@cached
def make_price_kernel(functions, nx, nu, dtype):
    """Kernel ``(first, xs, us, weights, price)`` over B: costs, summed in double precision."""
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(nu, dtype)
    running, final = functions.running, functions.final

    @named_by_code(max_unroll=1)
    def price(
        first: int,
        xs: wp.array3d(dtype=dtype),
        us: wp.array3d(dtype=dtype),
        weights: wp.array2d(dtype=dtype),
        out: wp.array(dtype=wp.float64),
    ):
        b = first + wp.tid()
        row = wp.where(weights.shape[0] == 1, 0, b)
        x, u = VX(), VU()
        value = wp.float64(0.0)
        for k in range(us.shape[1]):
            for i in range(nx):
                x[i] = xs[b, k, i]
            for i in range(nu):
                u[i] = us[b, k, i]
            value += wp.float64(running(weights, row, x, u, k))
        for i in range(nx):
            x[i] = xs[b, us.shape[1], i]
        out[b] = value + wp.float64(final(weights, row, x))

    return price


@cached
def make_cost_kernel(functions, nx, nu, dtype):
    """Kernel ``(first, xs, us, weights, mask, Derivatives)`` over B (N+1): derivatives of l and l_f.

    ``functions`` is for the dtype of ``weights``: dtype itself, or float64 when derivatives come from
    differences.
    """
    differences = functions.running_derivatives is None or functions.final_derivatives is None
    inner = wp.float64 if differences else dtype
    VX, VU = wp.types.vector(nx, inner), wp.types.vector(nu, inner)
    Derivatives = make_derivative_arrays(dtype)
    running_derivatives, final_derivatives = functions.running_derivatives, functions.final_derivatives
    if differences:
        made = make_scalar_differences(functions.running, functions.final, nx, nu)
        running_derivatives = running_derivatives or made[0]
        final_derivatives = final_derivatives or made[1]

    @named_by_code(max_unroll=1)
    def cost_derivatives(
        first: int,
        xs: wp.array3d(dtype=dtype),
        us: wp.array3d(dtype=dtype),
        weights: wp.array2d(dtype=inner),
        mask: wp.array(dtype=wp.int32),
        out: Derivatives,
    ):
        item = first + wp.tid()
        nodes = xs.shape[1]
        b = item / nodes
        k = item - b * nodes
        if mask[b] == 0:
            return
        row = wp.where(weights.shape[0] == 1, 0, b)
        x = VX()
        for i in range(nx):
            x[i] = inner(xs[b, k, i])
        if k == nodes - 1:
            fx, fxx = final_derivatives(weights, row, x)
            for i in range(nx):
                out.lx[b, k, i] = dtype(fx[i])
                for j in range(nx):
                    out.lxx[b, k, i, j] = dtype(fxx[i, j])
            return
        u = VU()
        for i in range(nu):
            u[i] = inner(us[b, k, i])
        lx, lu, lxx, lux, luu = running_derivatives(weights, row, x, u, k)
        for i in range(nx):
            out.lx[b, k, i] = dtype(lx[i])
            for j in range(nx):
                out.lxx[b, k, i, j] = dtype(lxx[i, j])
        for i in range(nu):
            out.lu[b, k, i] = dtype(lu[i])
            for j in range(nx):
                out.lux[b, k, i, j] = dtype(lux[i, j])
            for j in range(nu):
                out.luu[b, k, i, j] = dtype(luu[i, j])

    return cost_derivatives
