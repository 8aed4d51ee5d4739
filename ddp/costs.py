"""Costs of optimal control problems: sums over k of l(x_k, u_k, k), and a final cost l_f(x_N)."""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.costs import CostFunctions

__all__ = ["Cost", "CostFunctions", "flicking_finger", "plain", "quadratic"]


class Cost:
    """A running and a final cost as Warp functions, made for each dtype; their weights are run-time data.

    Args:
        make: ``make(dtype, VX, VU) -> CostFunctions``, called once per dtype; VX, VU are the vector types of
            a state and a control. Functions read weights as ``weights[row, i]``. It must be a function of a
            module, or be kept and passed again, for kernels to be found again instead of being compiled anew.
        weights: numbers (P,), or one row per problem (B, P).
        nx: number of states that the cost needs, or None for any.
        nu: number of controls, or None for any.
    """

    def __init__(
        self,
        make: Callable[..., CostFunctions],
        weights: Any = (),
        nx: int | None = None,
        nu: int | None = None,
    ) -> None:
        values = np.array(weights, dtype=np.float64, ndmin=1)
        if values.ndim > 2 or not np.isfinite(values).all():
            raise ValueError(
                f"weights must be finite numbers of shape (P,) or (B, P), got shape {values.shape}"
            )
        self.make, self.weights, self.nx, self.nu = make, values, nx, nu

    def functions(self, dtype: Any, nx: int, nu: int) -> CostFunctions:
        """Warp functions for a scalar type and sizes, made once."""
        return _functions(self.make, dtype, nx, nu)

    def with_weights(self, weights: Any) -> "Cost":
        """The same functions with other numbers, (P,) or (B, P); nothing is compiled."""
        other = Cost(self.make, weights, self.nx, self.nu)
        if other.weights.shape[-1] != self.weights.shape[-1]:
            raise ValueError(
                f"weights must have {self.weights.shape[-1]} columns, got {other.weights.shape[-1]}"
            )
        return other

    def rows(self, batch: int) -> np.ndarray:
        """Weights as rows (1 or B, max(P, 1))."""
        rows = np.atleast_2d(self.weights)
        if rows.shape[0] not in (1, batch):
            raise ValueError(f"cost weights have {rows.shape[0]} rows, the batch has {batch} problems")
        return rows if rows.shape[1] else np.zeros((1, 1))


@functools.cache
def _functions(make: Callable[..., CostFunctions], dtype: Any, nx: int, nu: int) -> CostFunctions:
    functions = make(dtype, wp.types.vector(nx, dtype), wp.types.vector(nu, dtype))
    if not isinstance(functions, CostFunctions):
        raise TypeError(f"a cost's make must return ddp.costs.CostFunctions, got {type(functions).__name__}")
    return functions


def plain(make: Callable[..., Any]) -> Cost:
    """A cost without weights: ``make(dtype, VX, VU) -> (running(x, u, k), final(x) or None)``, Warp functions.

    Derivatives come from differences in double precision (see `slcp_warp.kernels.costs`).
    """
    return Cost(_plain_adapter(make))


@functools.cache
def _plain_adapter(make: Callable[..., Any]) -> Callable[..., CostFunctions]:
    def adapted(dtype: Any, VX: Any, VU: Any) -> CostFunctions:
        user_running, user_final = make(dtype, VX, VU)
        has_final = user_final is not None
        ZERO = dtype(0.0)

        @wp.func
        def running(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, k: int):
            return user_running(x, u, k)

        @wp.func
        def final(weights: wp.array2d(dtype=dtype), row: int, x: VX):
            if wp.static(has_final):
                return user_final(x)
            return ZERO

        return CostFunctions(running, final)

    return adapted


def flicking_finger(c_x: float = 1.0, c_u: float = 0.05) -> Cost:
    """Section V: l = -c_x theta_3 + c_u |u|^2, x = (theta_1, theta_2, theta_3, rates), and no final cost."""
    return Cost(_make_flicking_finger, (c_x, c_u), nx=6, nu=2)


def _make_flicking_finger(dtype: Any, VX: Any, VU: Any) -> CostFunctions:
    nx, nu = VX._length_, VU._length_
    MXX, MUX, MUU = (wp.types.matrix(shape, dtype) for shape in ((nx, nx), (nu, nx), (nu, nu)))
    ZERO, TWO = dtype(0.0), dtype(2.0)

    @wp.func
    def running(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, k: int):
        return weights[row, 1] * wp.dot(u, u) - weights[row, 0] * x[2]

    @wp.func
    def final(weights: wp.array2d(dtype=dtype), row: int, x: VX):
        return ZERO

    @wp.func
    def running_derivatives(weights: wp.array2d(dtype=dtype), row: int, x: VX, u: VU, k: int):
        lx, luu = VX(), MUU()
        lx[2] = -weights[row, 0]
        for i in range(nu):
            luu[i, i] = TWO * weights[row, 1]
        return lx, TWO * weights[row, 1] * u, MXX(), MUX(), luu

    @wp.func
    def final_derivatives(weights: wp.array2d(dtype=dtype), row: int, x: VX):
        return VX(), MXX()

    return CostFunctions(running, final, running_derivatives, final_derivatives)


def quadratic(Q: Any, R: Any, Qf: Any = None, target: Any = None) -> Cost:
    """l = (x - t_k)' Q (x - t_k) / 2 + u' R u / 2, final cost (x - t_N)' Qf (x - t_N) / 2.

    Args:
        Q: symmetric (nx, nx).
        R: symmetric (nu, nu).
        Qf: symmetric (nx, nx), default 0.
        target: state (nx,), or one per node (N+1, nx); default 0.
    """
    Q, R = np.array(Q, dtype=np.float64), np.array(R, dtype=np.float64)
    nx, nu = Q.shape[0], R.shape[0]
    Qf = np.zeros((nx, nx)) if Qf is None else np.array(Qf, dtype=np.float64)
    target = np.zeros(nx) if target is None else np.array(target, dtype=np.float64)
    for name, value, size in (("Q", Q, nx), ("R", R, nu), ("Qf", Qf, nx)):
        if value.shape != (size, size) or not np.allclose(value, value.T, rtol=1e-12, atol=1e-14):
            raise ValueError(f"{name} must be a symmetric matrix ({size}, {size}), got shape {value.shape}")
    if target.ndim not in (1, 2) or target.shape[-1] != nx:
        raise ValueError(f"target must have shape ({nx},) or (N+1, {nx}), got {target.shape}")
    return Cost(_make_quadratic, np.concatenate([a.ravel() for a in (Q, R, Qf, target)]), nx=nx, nu=nu)


def _make_quadratic(dtype: Any, VX: Any, VU: Any) -> CostFunctions:
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
