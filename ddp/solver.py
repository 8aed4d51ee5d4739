"""The loop of DDP: linearise, sweep backwards, try all step sizes, choose."""

import math
import threading
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.inputs.checks import instance, memory, numeric, shown, whole
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
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

from .options import Options
from .problem import Problem
from .result import Result, Trace


class Workspace:
    """Arrays and launches of one problem and batch size, made once and used for any number of solves.

    The device arrays ``xs``, ``us``, ``K``, ``k``, ``Vx``, ``Vxx``, ``cost``, ``status``, ``passes``,
    ``gradient`` and ``pivot`` hold the last solution; the next solve overwrites them.
    """

    def __init__(self, problem: Problem, batch: int, options: Options | None = None) -> None:
        instance("problem", problem, Problem, "a ddp.Problem")
        instance("options", options, Options | None, "a ddp.Options")
        self.problem, self.batch, self.options = problem, whole("batch", batch, 0), options or Options()
        self.dynamics, self.device, self.dtype = (
            problem.dynamics,
            problem.dynamics.device,
            problem.dynamics.dtype,
        )
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
        problem, options, B, N = self.problem, self.options, self.batch, self.problem.horizon
        nx, nu, nw = problem.nx, problem.nu, int(problem.dynamics.nw)
        nz, A = nx + nu, len(options.step_sizes)
        f64, i32 = wp.float64, wp.int32
        self.x0 = self._zeros(B, nx)
        self.params = wp.clone(problem.param_array(B))

        p = self._policy = make_policy_arrays(self.dtype)()
        p.xs, p.us, p.k = self._zeros(B, N + 1, nx), self._zeros(B, N, nu), self._zeros(B, N, nu)
        p.K, p.Vx, p.Vxx = self._zeros(B, N, nu, nx), self._zeros(B, N + 1, nx), self._zeros(B, N + 1, nx, nx)
        low, high = problem.limit_rows()
        if low.shape[0] not in (1, B):
            raise ArgumentError(f"control_limits are for {low.shape[0]} problems, the batch has {B}")
        p.lower, p.upper = (
            wp.array(a.astype(self.numpy_dtype), dtype=self.dtype, device=self.device) for a in (low, high)
        )

        d = self._derivatives = make_derivative_arrays(self.dtype)()
        d.fx, d.fu, d.status = (
            self._zeros(B, N, nx, nx),
            self._zeros(B, N, nx, nu),
            self._zeros(B, N, dtype=i32),
        )
        d.second = self._zeros(B * N, nw, nz, nz) if self.second_order else self._zeros(1, 1, 1, 1)
        d.lift = self._zeros(B, nw, nx)
        problem.dynamics.lift_into(self.params, d.lift)
        d.lx, d.lu = self._zeros(B, N + 1, nx), self._zeros(B, N, nu)
        d.lxx, d.lux, d.luu = (
            self._zeros(B, N + 1, nx, nx),
            self._zeros(B, N, nu, nx),
            self._zeros(B, N, nu, nu),
        )

        c = self._candidates = make_candidate_arrays(self.dtype)()
        c.step_sizes = wp.array(
            np.asarray(options.step_sizes, dtype=np.float64), dtype=f64, device=self.device
        )
        c.xs, c.us = self._zeros(B, A, N + 1, nx), self._zeros(B, A, N, nu)
        c.cost, c.status = self._zeros(B, A, dtype=f64), self._zeros(B, A, dtype=i32)
        c.size = self._zeros(B, A, dtype=f64)

        s = self._state = SolverState()
        s.status, s.active, s.fresh, s.passes = (self._zeros(B, dtype=i32) for _ in range(4))
        s.cost, s.mu, s.delta, s.gradient, s.pivot = (self._zeros(B, dtype=f64) for _ in range(5))
        s.size, s.relative, s.flat = (self._zeros(B, dtype=k) for k in (f64, f64, i32))
        s.expected = self._zeros(B, 2, dtype=f64)
        schedule = options.regularization.rows()
        if schedule.shape[0] not in (1, B):
            raise ArgumentError(f"regularization is for {schedule.shape[0]} problems, the batch has {B}")
        s.schedule = wp.array(schedule, dtype=f64, device=self.device)
        s.trace = self._zeros(B, options.max_iterations + 1, codes.TRACE_COLUMNS, dtype=f64)

        self.xs, self.us, self.K, self.k, self.Vx, self.Vxx = p.xs, p.us, p.K, p.k, p.Vx, p.Vxx
        self.cost, self.status, self.passes, self.gradient, self.pivot = (
            s.cost,
            s.status,
            s.passes,
            s.gradient,
            s.pivot,
        )
        self._all = wp.ones(B, dtype=i32, device=self.device)
        self._using = threading.RLock()

    def _prepare(self) -> None:
        """Kernels, and their launches with arguments packed."""
        problem, options, B, N, dtype = (
            self.problem,
            self.options,
            self.batch,
            self.problem.horizon,
            self.dtype,
        )
        nx, nu, nw = problem.nx, problem.nu, int(problem.dynamics.nw)
        policy, derivatives, candidates, state = (
            self._policy,
            self._derivatives,
            self._candidates,
            self._state,
        )
        limited = problem.control_limits is not None
        functions = problem.cost.functions(dtype, nx, nu)
        rows = problem.cost.rows(B)
        weights: Any = wp.array(rows.astype(self.numpy_dtype), dtype=dtype, device=self.device)

        d = derivatives
        second = d.second if self.second_order else None
        arrays = (policy.xs, policy.us, self.params, d.fx, d.fu, second, d.status, state.fresh)
        if hasattr(self.dynamics, "prepare_linearize"):
            self._run_linearize = self.dynamics.prepare_linearize(*arrays)
        else:
            self._run_linearize = lambda: self.dynamics.linearize_into(*arrays)

        differences = functions.running_derivatives is None or functions.final_derivatives is None
        inner = wp.float64 if differences else dtype
        exact = weights if inner == dtype else wp.array(rows, dtype=inner, device=self.device)
        cost_kernel = make_cost_kernel(problem.cost.functions(inner, nx, nu), nx, nu, dtype)
        cost_inputs = [policy.xs, policy.us, exact, state.fresh, derivatives]
        self._run_cost = Prepared(
            cost_kernel, B * (N + 1), cost_inputs, self.device, grain=16 if differences else 512
        )

        backward = make_backward_kernel(nx, nu, nw, options.method, limited, dtype)
        inputs = [derivatives, policy, state, self.gradient_tolerance]
        self._run_backward = Prepared(backward, B, [*inputs, 0], self.device, grain=1)
        self._run_last_backward = Prepared(backward, B, [*inputs, 1], self.device, grain=1)

        rollout = make_rollout_kernel(
            self.dynamics.step_function(),
            self.dynamics.initial_carry(),
            functions.running,
            functions.final,
            nx,
            nu,
            limited,
            dtype,
            getattr(self.dynamics, "kernel_key", ""),
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
            self._fill(self.x0, x0, "x0", (B, nx))
            self._fill(self.us, us0, "us0", (B, N, nu))
            for target, value, name, shape in (
                (self.xs, xs0, "xs0", (B, N + 1, nx)),
                (self.K, K0, "K0", (B, N, nu, nx)),
                (self.k, k0, "k0", (B, N, nu)),
            ):
                if value is None:
                    target.zero_()
                else:
                    self._fill(target, value, name, shape)
            self._run_first()
            self._run_start()
            for count in range(limit):
                if not self._sweep(self._run_backward):
                    return count
                self._run_search()
                self._run_accept()
            self._sweep(self._run_last_backward)
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
        )

    def _sweep(self, backward: Prepared) -> bool:
        """Derivatives where trajectories changed, and a backward pass; whether any problem goes on."""
        self._run_linearize()
        self._run_cost()
        backward()
        return bool(self._state.active.numpy().any())

    def _fill(self, target: Any, value: Any, name: str, shape: tuple[int, ...]) -> None:
        """Copy an argument into a device array, checking its shape, and host arrays for NaN."""
        if isinstance(value, wp.array):
            if value.shape != shape or value.dtype != self.dtype:
                raise ArgumentError(
                    f"{name} must have shape {shape} and dtype {self.dtype.__name__}, got {value.shape}, "
                    f"{value.dtype.__name__}"
                )
            if value.ptr != target.ptr:
                wp.copy(target, value)
            return
        _check_array(name, value, shape)
        array = np.asarray(value, dtype=self.numpy_dtype)
        if self.device.is_cpu:
            target.numpy()[...] = array
        else:
            target.assign(np.ascontiguousarray(np.broadcast_to(array, shape)))


def _check_array(name: str, value: Any, shape: tuple[int, ...]) -> None:
    """Raise ValueError unless a host array has this shape, or this without its batch axis, and is finite."""
    array = value if isinstance(value, wp.array) else numeric(value)
    if array is None:
        raise ArgumentError(f"{name} must be an array of numbers, got {shown(value)}")
    if array.shape not in (shape, shape[1:]):
        raise ArgumentError(f"{name} must have shape {shape} or {shape[1:]}, got {array.shape}")
    if isinstance(array, wp.array):
        return
    if not np.isfinite(array).all():
        bad = np.count_nonzero(~np.isfinite(array))
        raise ArgumentError(f"{name} must be finite; {bad} of its values are NaN or infinite")


def batch_of(problem: Problem, x0: Any, u0: Any) -> tuple[bool, int]:
    """Whether the batch axis is left out, and how many problems there are; the arrays are checked."""
    given = []
    for name, value in (("x0", x0), ("u0", u0)):
        array = value if isinstance(value, wp.array) else numeric(value)
        if isinstance(value, wp.array) and value.dtype is not problem.dynamics.dtype:
            need = problem.dynamics.dtype.__name__
            raise ArgumentError(f"{name} is a Warp array of {value.dtype.__name__}; {need} is needed")
        if array is None:
            raise ArgumentError(f"{name} must be an array of numbers, got {shown(value)}")
        given.append(array)
    x, u = given
    single = x.ndim == 1 and u.ndim == 2
    batch = 1 if single or not (x.ndim == 2 or u.ndim == 3) else len(x if x.ndim == 2 else u)
    _check_array("x0", x, (batch, problem.nx))
    _check_array("u0", u, (batch, problem.horizon, problem.nu))
    return single, batch


def solve(
    problem: Problem,
    x0: Any,
    u0: Any,
    options: Options | None = None,
    *,
    xs0: Any = None,
    K0: Any = None,
    k0: Any = None,
) -> Result:
    """Solve a batch of problems, or one where the batch axis is left out.

    Args:
        problem: what to minimise.
        x0: initial states (B, nx) or (nx,).
        u0: initial controls (B, N, nu) or (N, nu).
        options: see `Options`; with ``sigma_schedule`` this is `solve_continuation`.
        xs0: states of a policy to start from, with ``K0`` (see `Workspace.run`).
        K0: its gains.
        k0: its open-loop step.
    """
    options = Options() if options is None else options
    if not isinstance(problem, Problem) or not isinstance(options, Options):
        raise ArgumentTypeError(
            f"problem and options are a {type(problem).__name__} and a {type(options).__name__}; "
            "a ddp.Problem and a ddp.Options are needed"
        )
    if options.sigma_schedule is not None:
        from .continuation import solve_continuation  # they need each other

        return solve_continuation(problem, x0, u0, options.sigma_schedule, options, xs0=xs0, K0=K0, k0=k0)[-1]
    single, batch = batch_of(problem, x0, u0)
    result = Workspace(problem, batch, options).solve(x0, u0, xs0, K0, k0)
    return result.select(0) if single else result
