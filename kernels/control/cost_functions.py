"""Costs that come with the package, as Warp functions; `slcp_warp.costs` gives them their weights."""

import warp as wp

from ..device.compile import translate
from ..factories import cached
from .costs import CostFunctions


def check_cost(functions, dtype, VX, VU):
    """An error where functions are no cost: they are translated on their own."""
    running, final = functions.running, functions.final

    def priced(weights: wp.array2d(dtype=dtype), x: VX, u: VU, out: wp.array(dtype=dtype)):
        out[0] = dtype(running(weights, 0, x, u, 0)) + dtype(final(weights, 0, x))

    translate(priced)


@cached
def make_plain(make):
    """A cost from ``make(dtype, VX, VU) -> (running(x, u, k), final(x) or None)``; weights: the step of the
    user's that step 0 is, and how many of these a step is.
    """

    def adapted(dtype, VX, VU):
        user_running, user_final = make(dtype, VX, VU)
        has_final = user_final is not None
        ZERO, HALF = dtype(0.0), dtype(0.5)

        @wp.func
        def running(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, k: int):
            step = wp.floor(weights[row, 0] + dtype(k) * weights[row, 1] + HALF)
            return user_running(x, u, int(step))

        @wp.func
        def final(weights: wp.array2d(dtype=dtype), row: int, x: VX):
            if wp.static(has_final):
                return user_final(x)
            return ZERO

        return CostFunctions(running, final)

    return adapted


@cached
def make_later(make, first):
    """A cost's functions of the steps from one on, counted from there."""

    def later(dtype, VX, VU):
        whole = make(dtype, VX, VU)
        own, of_running, START = whole.running, whole.running_derivatives, int(first)

        @wp.func
        def running(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, k: int):
            return own(weights, row, x, u, k + START)

        derivatives = None
        if of_running is not None:

            @wp.func
            def derivatives(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, k: int):
                return of_running(weights, row, x, u, k + START)

        return CostFunctions(running, whole.final, derivatives, whole.final_derivatives)

    return later


def make_quadratic(dtype, VX, VU):
    """l = (x - t_k)' Q (x - t_k) / 2 + u' R u / 2 and a final one; weights Q, R, Qf, t, (1 or N+1) rows."""
    nx, nu = VX._length_, VU._length_
    MXX, MUX, MUU = (wp.types.matrix(shape, dtype) for shape in ((nx, nx), (nu, nx), (nu, nu)))
    HALF = dtype(0.5)
    AT_R, AT_QF = nx * nx, nx * nx + nu * nu
    AT_TARGET = AT_QF + nx * nx

    @wp.func
    def deviation(weights: wp.array2d(dtype=dtype), row: int, x: VX, k: int):
        nodes = (weights.shape[1] - AT_TARGET) / nx
        at = AT_TARGET + wp.min(k, nodes - 1) * nx
        out = VX()
        for i in range(nx):
            out[i] = x[i] - weights[row, at + i]
        return out

    @wp.func
    def state_matrix(weights: wp.array2d(dtype=dtype), row: int, at: int):
        out = MXX()
        for i in range(nx):
            for j in range(nx):
                out[i, j] = weights[row, at + i * nx + j]
        return out

    @wp.func
    def control_matrix(weights: wp.array2d(dtype=dtype), row: int):
        out = MUU()
        for i in range(nu):
            for j in range(nu):
                out[i, j] = weights[row, AT_R + i * nu + j]
        return out

    @wp.func
    def running(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, k: int):
        e = deviation(weights, row, x, k)
        bent = wp.dot(e, state_matrix(weights, row, 0) * e) + wp.dot(u, control_matrix(weights, row) * u)
        return HALF * bent

    @wp.func
    def final(weights: wp.array2d(dtype=dtype), row: int, x: VX):
        e = deviation(weights, row, x, weights.shape[1])
        return HALF * wp.dot(e, state_matrix(weights, row, AT_QF) * e)

    @wp.func
    def running_derivatives(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, k: int):
        q, r = state_matrix(weights, row, 0), control_matrix(weights, row)
        return q * deviation(weights, row, x, k), r * u, q, MUX(), r

    @wp.func
    def final_derivatives(weights: wp.array2d(dtype=dtype), row: int, x: VX):
        q = state_matrix(weights, row, AT_QF)
        return q * deviation(weights, row, x, weights.shape[1]), q

    return CostFunctions(running, final, running_derivatives, final_derivatives)
