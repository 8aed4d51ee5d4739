"""The loop of DDP: linearise, pass backwards, try all step sizes, choose."""

import math
import threading
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.inputs.checks import instance, memory, whole
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.kernels.control import status as codes
from slcp_warp.kernels.control.costs import make_cost_kernel
from slcp_warp.kernels.control.line_search import (
    make_candidate_arrays,
    make_choice_kernels,
    make_rollout_kernel,
)
from slcp_warp.kernels.control.riccati import make_backward_kernel
from slcp_warp.kernels.control.solver_state import SolverState, make_derivative_arrays, make_policy_arrays
from slcp_warp.kernels.device.launch import Prepared

from .batches import fill
from .dynamics import dynamics_of
from .options import Options
from .problem import Problem
from .result import Result
from .trace import Trace


class Workspace:
    """Arrays and launches of one problem and batch size, made once and used for any number of solves.

    The device arrays ``xs``, ``us``, ``K``, ``k``, ``Vx``, ``Vxx``, ``cost``, ``status``, ``passes``,
    ``gradient`` and ``pivot`` hold the last solution; the next solve overwrites them.
    """

    def __init__(self, problem: Problem, batch: int, options: Options | None = None) -> None:
        instance("problem", problem, Problem, "a ddp.Problem")
        instance("options", options, Options | None, "a ddp.Options")
        self.problem, self.batch, self.options = problem, whole("batch", batch, 0), options or Options()
        self.dynamics = dynamics_of(problem.dynamics)
        self.device, self.dtype = self.dynamics.device, self.dynamics.dtype
        self.numpy_dtype = wp.dtype_to_numpy(self.dtype)
        self.second_order = self.options.method == "second-order"
        default = float(np.sqrt(np.finfo(self.numpy_dtype).eps))
        tolerance = self.options.gradient_tolerance
        self.gradient_tolerance = default if tolerance is None else float(tolerance)
        self._allocate()
        self._prepare()

    def _zeros(self, *shape: int, dtype: Any = None) -> Any:
        kind = dtype or self.dtype
        what = f"batch {self.batch}, horizon {self.problem.horizon} and max_iterations: an array {shape}"
        memory(what, math.prod(shape), wp.types.type_size_in_bytes(kind), self.device)
        return wp.zeros(shape, dtype=kind, device=self.device)

    def _allocate(self) -> None:
        """Arrays in the four structs that the kernels share."""
        self.x0 = self._zeros(self.batch, self.problem.nx)
        self.params = wp.clone(self.problem.param_array(self.batch))
        self._policy = self._policy_arrays()
        self._derivatives = self._derivative_arrays()
        self._candidates = self._candidate_arrays()
        self._state = self._solver_state()
        p, s = self._policy, self._state
        self.xs, self.us, self.K, self.k, self.Vx, self.Vxx = p.xs, p.us, p.K, p.k, p.Vx, p.Vxx
        self.cost, self.status, self.passes = s.cost, s.status, s.passes
        self.gradient, self.pivot = s.gradient, s.pivot
        self._all = wp.ones(self.batch, dtype=wp.int32, device=self.device)
        self._using = threading.RLock()

    def _policy_arrays(self) -> Any:
        """The trajectory, its gains and value function, and the limits of its controls."""
        B, N, nx, nu = self.batch, self.problem.horizon, self.problem.nx, self.problem.nu
        p = make_policy_arrays(self.dtype)()
        p.xs, p.us, p.k = self._zeros(B, N + 1, nx), self._zeros(B, N, nu), self._zeros(B, N, nu)
        p.K, p.Vx, p.Vxx = self._zeros(B, N, nu, nx), self._zeros(B, N + 1, nx), self._zeros(B, N + 1, nx, nx)
        low, high = self.problem.limit_rows()
        if low.shape[0] not in (1, B):
            raise ArgumentError(f"control_limits are for {low.shape[0]} problems, the batch has {B}")
        p.lower, p.upper = (
            wp.array(a.astype(self.numpy_dtype), dtype=self.dtype, device=self.device) for a in (low, high)
        )
        return p

    def _derivative_arrays(self) -> Any:
        """Derivatives of the dynamics and the cost along the trajectory."""
        B, N, nx, nu = self.batch, self.problem.horizon, self.problem.nx, self.problem.nu
        nw, nz = int(self.dynamics.nw), nx + nu
        d = make_derivative_arrays(self.dtype)()
        d.fx, d.fu = self._zeros(B, N, nx, nx), self._zeros(B, N, nx, nu)
        d.status = self._zeros(B, N, dtype=wp.int32)
        d.second = self._zeros(B * N, nw, nz, nz) if self.second_order else self._zeros(1, 1, 1, 1)
        d.lift = self._zeros(B, nw, nx)
        self.dynamics.lift_into(self.params, d.lift)
        d.lx, d.lu = self._zeros(B, N + 1, nx), self._zeros(B, N, nu)
        d.lxx, d.lux = self._zeros(B, N + 1, nx, nx), self._zeros(B, N, nu, nx)
        d.luu = self._zeros(B, N, nu, nu)
        return d

    def _candidate_arrays(self) -> Any:
        """A trajectory and its cost for every step size."""
        B, N, step_sizes = self.batch, self.problem.horizon, self.options.step_sizes
        A, f64 = len(step_sizes), wp.float64
        c = make_candidate_arrays(self.dtype)()
        c.step_sizes = wp.array(np.asarray(step_sizes, dtype=np.float64), dtype=f64, device=self.device)
        c.xs, c.us = self._zeros(B, A, N + 1, self.problem.nx), self._zeros(B, A, N, self.problem.nu)
        c.cost, c.status = self._zeros(B, A, dtype=f64), self._zeros(B, A, dtype=wp.int32)
        c.size = self._zeros(B, A, dtype=f64)
        return c

    def _solver_state(self) -> Any:
        """Where every problem stands: cost, regularisation, status, trace."""
        B, f64, i32 = self.batch, wp.float64, wp.int32
        s = SolverState()
        s.status, s.active, s.fresh, s.passes = (self._zeros(B, dtype=i32) for _ in range(4))
        s.cost, s.mu, s.delta, s.gradient, s.pivot = (self._zeros(B, dtype=f64) for _ in range(5))
        s.size, s.relative, s.flat = (self._zeros(B, dtype=k) for k in (f64, f64, i32))
        s.expected = self._zeros(B, 2, dtype=f64)
        schedule = self.options.regularization.rows()
        if schedule.shape[0] not in (1, B):
            raise ArgumentError(f"regularization is for {schedule.shape[0]} problems, the batch has {B}")
        s.schedule = wp.array(schedule, dtype=f64, device=self.device)
        s.trace = self._zeros(B, self.options.max_iterations + 1, codes.TRACE_COLUMNS, dtype=f64)
        return s

    def _prepare(self) -> None:
        """Kernels, and their launches with arguments packed."""
        problem, B, dtype = self.problem, self.batch, self.dtype
        functions = problem.cost.functions(dtype, problem.nx, problem.nu)
        rows = problem.cost.rows(B)
        weights: Any = wp.array(rows.astype(self.numpy_dtype), dtype=dtype, device=self.device)
        self._prepare_derivatives(functions, rows, weights)
        self._prepare_backward()
        self._prepare_rollouts(functions, weights)

    def _prepare_derivatives(self, functions: Any, rows: np.ndarray, weights: Any) -> None:
        """Derivatives of the dynamics, and of the cost: where it gives none, differences in float64."""
        problem, B, N, dtype = self.problem, self.batch, self.problem.horizon, self.dtype
        policy, d, fresh = self._policy, self._derivatives, self._state.fresh
        second = d.second if self.second_order else None
        arrays = (policy.xs, policy.us, self.params, d.fx, d.fu, second, d.status, fresh)
        if hasattr(self.dynamics, "prepare_linearize"):
            self._run_linearize = self.dynamics.prepare_linearize(*arrays)
        else:
            self._run_linearize = lambda: self.dynamics.linearize_into(*arrays)

        differences = functions.running_derivatives is None or functions.final_derivatives is None
        inner = wp.float64 if differences else dtype
        exact = weights if inner == dtype else wp.array(rows, dtype=inner, device=self.device)
        kernel = make_cost_kernel(
            problem.cost.functions(inner, problem.nx, problem.nu), problem.nx, problem.nu, dtype
        )
        inputs = [policy.xs, policy.us, exact, fresh, d]
        grain = 16 if differences else 512
        self._run_cost = Prepared(kernel, B * (N + 1), inputs, self.device, grain=grain)

    def _prepare_backward(self) -> None:
        problem, B = self.problem, self.batch
        limited = problem.control_limits is not None
        kernel = make_backward_kernel(
            problem.nx, problem.nu, int(self.dynamics.nw), self.options.method, limited, self.dtype
        )
        inputs = [self._derivatives, self._policy, self._state, self.gradient_tolerance]
        self._run_backward = Prepared(kernel, B, [*inputs, 0], self.device, grain=1)
        self._run_last_backward = Prepared(kernel, B, [*inputs, 1], self.device, grain=1)

    def _prepare_rollouts(self, functions: Any, weights: Any) -> None:
        """Rollouts with every step size, the first one with step size 1, and the choice among them."""
        problem, options, B, dtype = self.problem, self.options, self.batch, self.dtype
        policy, candidates, state = self._policy, self._candidates, self._state
        nx, nu = problem.nx, problem.nu
        rollout = make_rollout_kernel(
            self.dynamics.step_function(),
            self.dynamics.initial_carry(),
            functions.running,
            functions.final,
            nx,
            nu,
            problem.control_limits is not None,
            dtype,
        )
        shared = [self.params, weights]
        inputs = [B, self.x0, policy, candidates, *shared, state.active]
        self._run_search = Prepared(rollout, B * len(options.step_sizes), inputs, self.device, grain=1)
        first = make_candidate_arrays(dtype)()
        first.step_sizes = wp.array([1.0], dtype=wp.float64, device=self.device)
        for name in ("xs", "us", "cost", "size", "status"):
            setattr(first, name, getattr(candidates, name))
        inputs = [B, self.x0, policy, first, *shared, self._all]
        self._run_first = Prepared(rollout, B, inputs, self.device, grain=1)

        start, accept = make_choice_kernels(nx, nu, dtype)
        self._run_start = Prepared(start, B, [policy, candidates, state], self.device, grain=64)
        inputs = [policy, candidates, state, options.min_reduction_ratio, options.improvement_tolerance]
        inputs.append(self.gradient_tolerance)
        self._run_accept = Prepared(accept, B, inputs, self.device, grain=64)

    def set_params(self, params: Any) -> None:
        """Use other numbers for the dynamics from now on, of the same number of rows."""
        array = params if isinstance(params, wp.array) else self.dynamics.parameter_array(params, self.batch)
        if array.shape != self.params.shape:
            raise ArgumentError(f"params must have shape {self.params.shape} as before, got {array.shape}")
        wp.copy(self.params, array)
        self.dynamics.lift_into(self.params, self._derivatives.lift)

    def run(
        self,
        x0: Any,
        us0: Any,
        xs0: Any = None,
        K0: Any = None,
        k0: Any = None,
        max_iterations: int | None = None,
    ) -> int:
        """Solve and leave the solution in the workspace's arrays; returns the number of passes.

        Args:
            x0: initial states (B, nx), or one (nx,) for all.
            us0: controls to start from (B, N, nu) or (N, nu).
            xs0: with K0, the warm start (19) is rolled out with feedback: u = us0 + k0 + K0 (x - xs0);
                (B, N+1, nx).
            K0: gains (B, N, nu, nx).
            k0: (B, N, nu), default 0.
            max_iterations: fewer line searches than the options allow.
        """
        limit = self.options.max_iterations
        limit = limit if max_iterations is None else min(whole("max_iterations", max_iterations, 0), limit)
        B, N, nx, nu = self.batch, self.problem.horizon, self.problem.nx, self.problem.nu
        if (xs0 is None) != (K0 is None):
            raise ArgumentError(
                "xs0 and K0 belong together: give both for a closed-loop warm start, or neither"
            )
        with self._using:
            fill(self.x0, x0, "x0", (B, nx))
            fill(self.us, us0, "us0", (B, N, nu))
            for target, value, name, shape in (
                (self.xs, xs0, "xs0", (B, N + 1, nx)),
                (self.K, K0, "K0", (B, N, nu, nx)),
                (self.k, k0, "k0", (B, N, nu)),
            ):
                if value is None:
                    target.zero_()
                else:
                    fill(target, value, name, shape)
            self._run_first()
            self._run_start()
            for count in range(limit):
                if not self._differentiate(self._run_backward):
                    return count
                self._run_search()
                self._run_accept()
            self._differentiate(self._run_last_backward)
            return limit

    def solve(
        self,
        x0: Any,
        us0: Any,
        xs0: Any = None,
        K0: Any = None,
        k0: Any = None,
        max_iterations: int | None = None,
    ) -> Result:
        """`run`, with the solution copied into a `Result`; other threads wait meanwhile."""
        with self._using:
            return self.result(self.run(x0, us0, xs0, K0, k0, max_iterations))

    def result(self, passes: int | None = None) -> Result:
        """Copy of the solution that the workspace holds."""
        if passes is None:
            passes = int(self.passes.numpy().max(initial=0))
        names = ("xs", "us", "K", "k", "Vx", "Vxx", "cost", "status", "gradient")
        lower, upper = (np.tile(a, (self.batch // len(a), 1)) for a in self.problem.limit_rows())
        return Result(
            **{name: getattr(self, name).numpy().copy() for name in names},
            iterations=self.passes.numpy().copy(),
            min_pivot=self.pivot.numpy().copy(),
            lower=lower,
            upper=upper,
            trace=Trace.from_rows(self._state.trace.numpy()[:, : passes + 1]),
            simulated=self.problem.simulated(),
        )

    def _differentiate(self, backward: Prepared) -> bool:
        """Derivatives where trajectories changed, and a backward pass; whether any problem goes on."""
        self._run_linearize()
        self._run_cost()
        backward()
        return bool(self._state.active.numpy().any())
