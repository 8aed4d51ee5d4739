"""Sampled controls for a batch of problems: arrays made once, searches without allocation."""

import threading
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.inputs.checks import instance, number, whole
from slcp_warp.inputs.copies import NotCopied
from slcp_warp.kernels.control.candidate_costs import make_candidate_cost_kernel
from slcp_warp.kernels.control.generic_rollouts import GIVEN
from slcp_warp.kernels.control.rollouts import make_candidate_arrays
from slcp_warp.kernels.control.sampling import (
    METHODS,
    SUPPORT,
    make_play_kernels,
    make_sample_arrays,
    make_sample_kernel,
    make_update_kernel,
)
from slcp_warp.kernels.device.launch import Prepared, together
from slcp_warp.kernels.device.tables import copy_table
from slcp_warp.storage.printed import Printed

from ..batches import batch_of, fill
from ..dynamics import dynamics_of
from ..options import Options
from ..parts.arrays import Arrays
from ..problem import Problem
from .options import Sampling
from .spline import knots_of, spline_weights


@dataclass(frozen=True, repr=False)
class Sampled(Printed):
    """What sampling came to; NumPy arrays, batch first, without that axis for one problem.

    Attributes:
        us: controls of the best sample (B, N, nu).
        xs: its states (B, N+1, nx).
        cost: its cost (B,), with the soft penalties of state limits; +inf where every rollout failed.
        best: lowest cost so far after every iteration (B, iterations).
    """

    us: np.ndarray
    xs: np.ndarray
    cost: np.ndarray
    best: np.ndarray

    def _line(self) -> str:
        many = f"{len(self.cost)} problems, " if self.us.ndim == 3 else ""
        return (
            f"{many}{self.us.shape[-2]} steps, {self.best.shape[-1]} iterations; cost {np.min(self.cost):.6g}"
        )


class _StepPlays:
    """Rollouts of samples and of the best one, by a kernel that holds the dynamics' step and the cost."""

    def __init__(self, sampler: "Sampler") -> None:
        problem, B, dtype = sampler.problem, sampler.batch, sampler.dtype
        functions, dynamics = problem.cost.functions(dtype, problem.nx, problem.nu), sampler.dynamics
        kernel = make_sample_kernel(
            dynamics.step_function(),
            dynamics.initial_carry(),
            functions.running,
            functions.final,
            problem.nx,
            problem.nu,
            problem.state_limits is not None,
            dtype,
        )
        shared = [sampler.x0, sampler._samples, sampler._limits, sampler.params, sampler._weights]
        many = B * sampler.options.samples
        self._samples = Prepared(kernel, many, [B, 0, 0, *shared], sampler.device, grain=1)
        self.best = Prepared(kernel, B, [B, 0, -1, *shared], sampler.device, grain=1)

    def samples(self, seed: int, iteration: int) -> None:
        """Draw and roll out."""
        self._samples.set_input(1, seed)
        self._samples.set_input(2, iteration)
        self._samples()


class _OwnPlays:
    """The same by kernels of the dynamics, and costs after them."""

    def __init__(self, sampler: "Sampler") -> None:
        problem, B, dtype, device = sampler.problem, sampler.batch, sampler.dtype, sampler.device
        functions, S = problem.cost.functions(dtype, problem.nx, problem.nu), sampler.options.samples
        make, N = sampler._make, problem.horizon
        c = make_candidate_arrays(dtype)()
        c.step_sizes = wp.ones(1, dtype=wp.float64, device=device)
        c.xs, c.us = make.zeros(B, S, N + 1, problem.nx), make.zeros(B, S, N, problem.nu)
        c.cost, c.status = sampler._samples.cost, make.zeros(B, S, dtype=wp.int32)
        c.size = make.zeros(B, S, dtype=wp.float64)
        everything = wp.ones(B, dtype=wp.int32, device=device)
        play, keep = make_play_kernels(problem.nx, problem.nu, dtype)
        kept = problem.state_limits is not None
        cost = make_candidate_cost_kernel(
            functions.running, functions.final, problem.nx, problem.nu, kept, dtype
        )

        def prepare(items: int) -> list[Any]:
            priced = [B, c, sampler._limits, sampler._weights, everything]
            return [
                Prepared(play, items, [B, 0, -1, sampler._samples, c], device, grain=16),
                sampler.dynamics.prepare_candidates(
                    B,
                    items,
                    0,
                    make.policy(),
                    c,
                    sampler.params,
                    x0=sampler.x0,
                    active=everything,
                    mode=GIVEN,
                ),
                Prepared(cost, items, priced, device, grain=16),
            ]

        self._samples, self._best = prepare(B * S), prepare(B)
        self._best.append(Prepared(keep, B, [sampler._samples, c], device, grain=16))

    def samples(self, seed: int, iteration: int) -> None:
        """Draw and roll out."""
        self._samples[0].set_input(1, seed)
        self._samples[0].set_input(2, iteration)
        for run in self._samples:
            run()

    def best(self) -> None:
        """Roll the best one out, and keep it."""
        for run in self._best:
            run()


class Sampler(NotCopied):
    """Arrays and launches of one problem and batch size; as `Workspace` is of DDP.

    The device arrays ``us``, ``xs`` and ``cost`` hold the best sample of every problem; the next search
    overwrites them. An iteration is one launch of rollouts and one of the update.
    """

    def __init__(
        self, problem: Problem, batch: int, options: Sampling | None = None, wider: float = 1.0
    ) -> None:
        """`wider`: a factor of the deviations."""
        instance("problem", problem, Problem, "a ddp.Problem")
        instance("options", options, Sampling | None, "a ddp.Sampling")
        self.problem, self.batch, self.options = problem, whole("batch", batch), options or Sampling()
        self.wider = number("wider", wider, 0.0, above=True)
        self.dynamics = dynamics_of(problem.dynamics)
        self.device, self.dtype = self.dynamics.device, self.dynamics.dtype
        self._using = threading.RLock()
        with together():
            self._allocate()
            self._prepare()

    def _allocate(self) -> None:
        problem, options, B = self.problem, self.options, self.batch
        make = self._make = Arrays(problem, self.dynamics, B, Options(limit_rounds=0))
        N, nx, nu, S = problem.horizon, problem.nx, problem.nu, options.samples
        M = knots_of(N, options.knots)
        rows = M + SUPPORT - 1
        s = self._samples = make_sample_arrays(self.dtype)()
        first, weights = spline_weights(options.spline, N, M)
        s.first = wp.array(first, dtype=wp.int32, device=self.device)
        s.spline = wp.array(weights.astype(make.numpy_dtype), dtype=self.dtype, device=self.device)
        s.base, s.us, s.xs = make.zeros(B, N, nu), make.zeros(B, N, nu), make.zeros(B, N + 1, nx)
        s.mean, s.best, s.deviation = (make.zeros(B, rows, nu) for _ in range(3))
        s.knots, s.cost = make.zeros(B, S, rows, nu), make.zeros(B, S, dtype=wp.float64)
        s.best_cost = make.zeros(B, dtype=wp.float64)
        s.lower, s.upper = make.rows("control_limits", *problem.limit_rows())
        scale = self.wider * options.deviations(problem.control_limits, nu)
        least = np.broadcast_to(options.least * scale, (B, nu)).astype(make.numpy_dtype)
        s.least = wp.array(least, dtype=self.dtype, device=self.device)
        wide = np.zeros((B, rows, nu), dtype=make.numpy_dtype)
        wide[:, :M] = scale[:, None]
        self._wide: Any = wp.array(wide, dtype=self.dtype, device=self.device)
        self.x0, self.params = make.zeros(B, nx), copy_table(problem.param_array(B))
        self._limits = make.state_limits()
        self.trace = make.zeros(B, options.iterations, dtype=wp.float64)
        rows_of_weights = problem.cost.rows(B).astype(make.numpy_dtype)
        self._weights: Any = wp.array(rows_of_weights, dtype=self.dtype, device=self.device)
        self.us, self.xs, self.cost = s.us, s.xs, s.best_cost

    def _prepare(self) -> None:
        options, B, dtype, device = self.options, self.batch, self.dtype, self.device
        make = _OwnPlays if hasattr(self.dynamics, "prepare_candidates") else _StepPlays
        self._plays = make(self)
        elites = max(2, round(options.elites * options.samples))
        numbers = [METHODS.index(options.method), elites, options.temperature, dtype(options.decay)]
        update = make_update_kernel(self.problem.nu, dtype)
        self._run_update = Prepared(update, B, [*numbers, self._samples, self.trace, 0], device, grain=1)

    def set_cost(self, problem: Problem) -> None:
        """The numbers of the cost of a problem that differs by them alone."""
        self.problem = problem
        self._weights.assign(problem.cost.rows(self.batch).astype(self._make.numpy_dtype))

    def run(self, x0: Any, us0: Any = None, seed: int = 0) -> None:
        """Search, and leave the best sample in the arrays.

        Args:
            x0: initial states (B, nx), or one (nx,) for all.
            us0: controls (B, N, nu) or (N, nu) that the splines are added to, a warm start; None: zeros. They
                are among what is tried, so that the best is never worse.
            seed: of the noise; the same seed gives the same samples.
        """
        B, N, nx, nu = self.batch, self.problem.horizon, self.problem.nx, self.problem.nu
        s = self._samples
        with self._using:
            fill(self.x0, x0, "x0", (B, nx))
            if us0 is None:
                s.base.zero_()
            else:
                fill(s.base, us0, "us0", (B, N, nu))
            s.mean.zero_()
            s.best.zero_()
            wp.copy(s.deviation, self._wide)
            s.best_cost.fill_(np.inf)
            seed = whole("seed", seed, 0)
            for iteration in range(self.options.iterations):
                self._plays.samples(seed, iteration)
                self._run_update.set_input(6, iteration)
                self._run_update()
            self._plays.best()

    def result(self) -> Sampled:
        """Copy of what the last search found."""
        arrays = (self.us, self.xs, self.cost, self.trace)
        return Sampled(*(a.numpy().copy() for a in arrays))


def sample(
    problem: Problem, x0: Any, us0: Any = None, options: Sampling | None = None, *, seed: int = 0
) -> Sampled:
    """Search for controls by sampling splines; no derivatives are asked for.

    `ddp.solve(problem, x0, ddp.sample(problem, x0).us)` goes on with DDP from what it finds.

    Args:
        problem: what is minimised; limits of states are soft.
        x0: initial states (B, nx) or (nx,).
        us0: controls that the splines are added to (B, N, nu) or (N, nu); None: zeros.
        options: see `Sampling`.
        seed: of the noise.
    """
    instance("problem", problem, Problem, "a ddp.Problem")
    single, batch = batch_of(problem, x0, us0, "us0")
    sampler = Sampler(problem, batch, options)
    sampler.run(x0, us0, seed)
    found = sampler.result()
    return Sampled(found.us[0], found.xs[0], found.cost[0], found.best[0]) if single else found
