"""The device arrays of a solve, in the structs that the kernels share."""

import math
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.inputs.checks import memory
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.kernels.control import status as codes
from slcp_warp.kernels.control.backward.riccati_parts import WEIGHED
from slcp_warp.kernels.control.rollouts import make_candidate_arrays
from slcp_warp.kernels.control.solver_state import SolverState, make_derivative_arrays, make_policy_arrays
from slcp_warp.kernels.control.state_limits import make_state_limits

from ..options import Options
from ..problem import Problem


class Arrays:
    """Allocates the structs of one problem and batch size.

    Args:
        dynamics: the problem's, as a `Dynamics`.
    """

    def __init__(self, problem: Problem, dynamics: Any, batch: int, options: Options) -> None:
        self.problem, self.dynamics, self.batch, self.options = problem, dynamics, batch, options
        self.device, self.dtype = dynamics.device, dynamics.dtype
        self.numpy_dtype = wp.dtype_to_numpy(self.dtype)

    def zeros(self, *shape: int, dtype: Any = None) -> Any:
        """Zeros on the device.

        Raises:
            ArgumentError: more than there is memory for.
        """
        kind = dtype or self.dtype
        what = f"batch {self.batch}, horizon {self.problem.horizon} and max_iterations: an array {shape}"
        memory(what, math.prod(shape), wp.types.type_size_in_bytes(kind), self.device)
        return wp.zeros(shape, dtype=kind, device=self.device)

    def rows(self, name: str, *arrays: np.ndarray) -> list[Any]:
        """Host arrays (1 or B, n) on the device.

        Raises:
            ArgumentError: another number of rows.
        """
        if len(arrays[0]) not in (1, self.batch):
            raise ArgumentError(f"{name} are for {len(arrays[0])} problems, the batch has {self.batch}")
        return [wp.array(a.astype(self.numpy_dtype), dtype=self.dtype, device=self.device) for a in arrays]

    def policy(self) -> Any:
        """The trajectory, its gains and value function, and the limits of its controls; no gaps."""
        B, N, nx, nu = self.batch, self.problem.horizon, self.problem.nx, self.problem.nu
        p = make_policy_arrays(self.dtype)()
        p.xs, p.us, p.k = self.zeros(B, N + 1, nx), self.zeros(B, N, nu), self.zeros(B, N, nu)
        p.K, p.Vx, p.Vxx = self.zeros(B, N, nu, nx), self.zeros(B, N + 1, nx), self.zeros(B, N + 1, nx, nx)
        p.gaps = self.zeros(0, N, nx)
        p.lower, p.upper = self.rows("control_limits", *self.problem.limit_rows())
        return p

    def shooting_policy(self, policy: Any) -> Any:
        """The same arrays as a policy's, with gaps between its steps."""
        p = make_policy_arrays(self.dtype)()
        for name in ("xs", "us", "K", "k", "Vx", "Vxx", "lower", "upper"):
            setattr(p, name, getattr(policy, name))
        p.gaps = self.zeros(self.batch, self.problem.horizon, self.problem.nx)
        return p

    def derivatives(self, params: Any, second_order: bool) -> Any:
        """Derivatives of the dynamics and the cost along the trajectory."""
        B, N, nx, nu = self.batch, self.problem.horizon, self.problem.nx, self.problem.nu
        nw, nz = int(self.dynamics.nw), nx + nu
        d = make_derivative_arrays(self.dtype)()
        d.fx, d.fu = self.zeros(B, N, nx, nx), self.zeros(B, N, nx, nu)
        d.status = self.zeros(B, N, dtype=wp.int32)
        own = 1 if nw == WEIGHED else nw
        d.second = self.zeros(B * N, own, nz, nz) if second_order else self.zeros(1, 1, 1, 1)
        d.lift = self.zeros(B, max(nw, 0), nx)
        self.dynamics.lift_into(params, d.lift)
        d.lx, d.lu = self.zeros(B, N + 1, nx), self.zeros(B, N, nu)
        d.lxx, d.lux = self.zeros(B, N + 1, nx, nx), self.zeros(B, N, nu, nx)
        d.luu = self.zeros(B, N, nu, nu)
        return d

    def candidates(self) -> Any:
        """A trajectory and its cost for every step size."""
        B, N, step_sizes = self.batch, self.problem.horizon, self.options.step_sizes
        A, f64 = len(step_sizes), wp.float64
        c = make_candidate_arrays(self.dtype)()
        c.step_sizes = wp.array(np.asarray(step_sizes, dtype=np.float64), dtype=f64, device=self.device)
        c.xs, c.us = self.zeros(B, A, N + 1, self.problem.nx), self.zeros(B, A, N, self.problem.nu)
        c.cost, c.status = self.zeros(B, A, dtype=f64), self.zeros(B, A, dtype=wp.int32)
        c.size = self.zeros(B, A, dtype=f64)
        return c

    def first_candidate(self, candidates: Any) -> Any:
        """The same arrays as the candidates', with the one step size 1."""
        first = make_candidate_arrays(self.dtype)()
        first.step_sizes = wp.array([1.0], dtype=wp.float64, device=self.device)
        for name in ("xs", "us", "cost", "size", "status"):
            setattr(first, name, getattr(candidates, name))
        return first

    def solver_state(self) -> Any:
        """Where every problem stands: cost, regularisation, status, trace."""
        B, f64, i32 = self.batch, wp.float64, wp.int32
        s = SolverState()
        for name in ("status", "active", "searching", "fresh", "passes", "valued"):
            setattr(s, name, self.zeros(B, dtype=i32))
        s.cost, s.mu, s.delta, s.gradient, s.pivot = (self.zeros(B, dtype=f64) for _ in range(5))
        s.size, s.relative, s.gap, s.gap_price = (self.zeros(B, dtype=f64) for _ in range(4))
        s.flat = self.zeros(B, dtype=i32)
        s.expected = self.zeros(B, 2, dtype=f64)
        schedule = self.options.regularization.rows()
        if schedule.shape[0] not in (1, B):
            raise ArgumentError(f"regularization is for {schedule.shape[0]} problems, the batch has {B}")
        s.schedule = wp.array(schedule, dtype=f64, device=self.device)
        s.trace = self.zeros(B, self.options.max_iterations + 1, codes.TRACE_COLUMNS, dtype=f64)
        return s

    def state_limits(self) -> Any:
        """Limits of the states, first weights and multipliers; without rows where the problem has none."""
        B, N, nx = self.batch, self.problem.horizon, self.problem.nx
        s = make_state_limits(self.dtype)()
        if self.problem.state_limits is None:
            s.lower, s.upper, s.weight = self.zeros(0, nx), self.zeros(0, nx), self.zeros(0)
            s.multiplier = self.zeros(0, N + 1, nx)
            return s
        s.lower, s.upper = self.rows("state_limits", *self.problem.state_limit_rows())
        s.weight, s.multiplier = self.zeros(B), self.zeros(B, N + 1, nx)
        s.weight.fill_(self.options.limit_weight)
        return s
