"""The loop of DDP: linearise, pass backwards, try all step sizes, choose."""

import functools
import threading
import weakref
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.inputs.checks import function, instance, shown, whole
from slcp_warp.inputs.copies import NotCopied
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.kernels.control.backward.riccati_parts import WEIGHED
from slcp_warp.kernels.control.backward.weights import make_weight_kernel
from slcp_warp.kernels.control.costs import make_cost_kernel
from slcp_warp.kernels.device.launch import Prepared, together
from slcp_warp.kernels.device.tables import copy_table

from .batches import fill
from .dynamics import dynamics_of
from .options import Options, of_one_level
from .parts.arrays import Arrays
from .parts.gaps import close_gaps
from .parts.passes import Passes
from .parts.rounds import Rounds
from .parts.starts import held_states, no_controls, start_automatically
from .problem import Problem
from .results.result import Result
from .results.status import Status
from .results.trace import Trace


class Workspace(NotCopied):
    """Arrays and launches of one problem and batch size, made once and used for any number of solves.

    The device arrays ``xs``, ``us``, ``K``, ``k``, ``Vx``, ``Vxx``, ``cost``, ``status``, ``passes``,
    ``gradient`` and ``pivot`` hold the last solution; the next solve overwrites them.
    """

    def __init__(self, problem: Problem, batch: int, options: Options | None = None) -> None:
        instance("problem", problem, Problem, "a ddp.Problem")
        instance("options", options, Options | None, "a ddp.Options")
        self.problem, self.batch, self.options = problem, whole("batch", batch, 0), options or Options()
        of_one_level(self.options)
        self.dynamics = dynamics_of(problem.dynamics)
        self.device, self.dtype = self.dynamics.device, self.dynamics.dtype
        self.numpy_dtype = wp.dtype_to_numpy(self.dtype)
        self.second_order = self.options.method == "second-order"
        default = float(np.sqrt(np.finfo(self.numpy_dtype).eps))
        tolerance = self.options.gradient_tolerance
        self.gradient_tolerance = default if tolerance is None else float(tolerance)
        self._using = threading.RLock()
        with together():
            self._allocate()
            self._prepare()

    def _allocate(self) -> None:
        """Arrays in the structs that the kernels share."""
        self._make = Arrays(self.problem, self.dynamics, self.batch, self.options)
        self.x0 = self._make.zeros(self.batch, self.problem.nx)
        self.params = copy_table(self.problem.param_array(self.batch))
        self._policy = self._make.policy()
        self._derivatives = self._make.derivatives(self.params, self.second_order)
        self._candidates = self._make.candidates()
        self._state = self._make.solver_state()
        self._limits = self._make.state_limits()
        p, s = self._policy, self._state
        self.xs, self.us, self.K, self.k, self.Vx, self.Vxx = p.xs, p.us, p.K, p.k, p.Vx, p.Vxx
        self.cost, self.status, self.passes = s.cost, s.status, s.passes
        self.gradient, self.pivot = s.gradient, s.pivot
        self._behind = np.zeros(self.batch, dtype=bool)
        self._stopped = False  # by who is told
        self._tell: Callable[[int, int, float], bool | None] | None = None
        self._all = wp.ones(self.batch, dtype=wp.int32, device=self.device)

    def _prepare(self) -> None:
        """Kernels, and their launches with arguments packed."""
        problem, dtype = self.problem, self.dtype
        self._functions = problem.cost.functions(dtype, problem.nx, problem.nu)
        rows = problem.cost.rows(self.batch)
        self._weights: Any = wp.array(rows.astype(self.numpy_dtype), dtype=dtype, device=self.device)
        self._prepare_derivatives(rows)
        self._passes = Passes(weakref.proxy(self), self._policy)  # its parts go with a workspace at once
        first = self._make.first_candidate(self._candidates)
        self._run_first = self._passes.rollouts.run(self.batch, first, self._all)
        self._rounds = None if problem.state_limits is None else Rounds(weakref.proxy(self))

    def _prepare_derivatives(self, rows: np.ndarray) -> None:
        """Derivatives of the dynamics, and of the cost: where it gives none, differences in float64."""
        problem, B, N, dtype = self.problem, self.batch, self.problem.horizon, self.dtype
        policy, d, fresh = self._policy, self._derivatives, self._state.fresh
        second = d.second if self.second_order else None
        arrays = (policy.xs, policy.us, self.params, d.fx, d.fu, second, d.status, fresh)
        self._weigh: tuple[Callable[[], None], ...] = ()
        if self.second_order and self.dynamics.nw == WEIGHED:
            weights, asked = self._make.zeros(B, N + 1, problem.nx), self._make.zeros(B, dtype=wp.int32)
            kernel = make_weight_kernel(problem.nx, dtype)
            run = Prepared(kernel, B, [d, policy, self._state, asked, weights], self.device)
            first, weighed = self.dynamics.prepare_weighed(*arrays, weights, asked)
            self._run_linearize, self._weigh = first, (run, weighed)
        elif hasattr(self.dynamics, "prepare_linearize"):
            self._run_linearize = self.dynamics.prepare_linearize(*arrays)
        else:
            self._run_linearize = functools.partial(self.dynamics.linearize_into, *arrays)

        functions = self._functions
        differences = functions.running_derivatives is None or functions.final_derivatives is None
        inner = wp.float64 if differences else dtype
        exact = self._weights if inner == dtype else wp.array(rows, dtype=inner, device=self.device)
        self._priced = (self._weights,) if exact is self._weights else (self._weights, exact)
        kernel = make_cost_kernel(
            problem.cost.functions(inner, problem.nx, problem.nu), problem.nx, problem.nu, dtype
        )
        inputs = [policy.xs, policy.us, exact, fresh, d]
        grain = 16 if differences else 512
        self._run_cost = Prepared(kernel, B * (N + 1), inputs, self.device, grain=grain)

    @functools.cached_property
    def _shooting(self) -> "Passes":
        """Passes with gaps between the steps; made when first needed."""
        return Passes(weakref.proxy(self), self._make.shooting_policy(self._policy))

    def set_params(self, params: Any) -> None:
        """Use other numbers for the dynamics from now on, of the same number of rows."""
        array = params if isinstance(params, wp.array) else self.dynamics.parameter_array(params, self.batch)
        if array.shape != self.params.shape:
            raise ArgumentError(f"params must have shape {self.params.shape} as before, got {array.shape}")
        wp.copy(self.params, array)
        self.dynamics.lift_into(self.params, self._derivatives.lift)

    def set_cost(self, problem: Problem) -> None:
        """The numbers of the cost of a problem that differs by them alone."""
        self.problem, rows = problem, problem.cost.rows(self.batch)
        for weights in self._priced:
            weights.assign(rows.astype(weights.numpy().dtype))

    def run(
        self,
        x0: Any,
        us0: Any,
        xs0: Any = None,
        K0: Any = None,
        k0: Any = None,
        max_iterations: int | None = None,
        rungs: Sequence[tuple[int, int]] = (),
        progress: Callable[[int, int, float], bool | None] | None = None,
    ) -> int:
        """Solve and leave the solution in the workspace's arrays; returns the most passes of a problem.

        Args:
            x0: initial states (B, nx), or one (nx,) for all.
            us0: controls to start from (B, N, nu) or (N, nu); None: zeros, or what ``options.start`` makes.
            xs0: states (B, N+1, nx) or (N+1, nx). With K0, the warm start (19) is rolled out with feedback:
                u = us0 + k0 + K0 (x - xs0). Alone: multiple shooting (M43) from these states, with
                gaps between the steps that the passes close; xs0[0] is taken to be x0.
            K0: gains (B, N, nu, nx).
            k0: (B, N, nu), default 0.
            max_iterations: fewer line searches than the options allow.
            rungs: pairs of passes and problems, where all are of one start state: after so many passes only
                so many of lowest cost go on, and the others end with MAX_ITERATIONS (successive halving,
                Jamieson & Talwalkar 2016). What is kept comes out as without rungs, bit for bit.
            progress: called after every pass with the passes made, how many problems go on and the lowest
                cost; where it returns True, passes end.
        """
        left = _by_passes(rungs)
        tell = function("progress", progress, 3, optional=True)
        limit = self.options.max_iterations
        limit = limit if max_iterations is None else min(whole("max_iterations", max_iterations, 0), limit)
        with self._using:
            self._tell = tell
            done = self.start(x0, us0, xs0, K0, k0, limit)
            self._behind[:], self._stopped = False, False
            self._descend(done, limit, left)
            if self._rounds is not None:
                self._hold_limits(self._rounds, limit)
            self._without_regularization()
            return int(self.passes.numpy().max(initial=0))

    def start(
        self, x0: Any, us0: Any, xs0: Any = None, K0: Any = None, k0: Any = None, limit: int = 0
    ) -> int:
        """The trajectory that passes start from, as of `run`, and where the problems stand with it.

        Limits of states have their first weight. With gaps it takes passes to close them, at most ``limit``;
        returns how many.
        """
        if self._rounds is not None:
            self._rounds.start()
        B, N, nx, nu = self.batch, self.problem.horizon, self.problem.nx, self.problem.nu
        if xs0 is None and K0 is not None:
            raise ArgumentError("K0 is given without xs0, the states that its feedback is about")
        if k0 is not None and K0 is None:
            raise ArgumentError("k0 is given without K0 and xs0, the rest of a closed-loop warm start")
        fill(self.x0, x0, "x0", (B, nx))
        way = self.options.start
        if xs0 is None and way == "automatic" and us0 is None:
            return start_automatically(self, limit)
        controls = no_controls(self.problem, self.batch) if us0 is None else us0
        fill(self.us, controls, "us0", (B, N, nu))
        if xs0 is None and way in ("hold", "goal"):
            xs0 = held_states(self, way)
        for target, value, name, shape in (
            (self.xs, xs0, "xs0", (B, N + 1, nx)),
            (self.K, K0, "K0", (B, N, nu, nx)),
            (self.k, k0, "k0", (B, N, nu)),
        ):
            if value is None:
                target.zero_()
            else:
                fill(target, value, name, shape)
        if xs0 is not None and K0 is None:
            return close_gaps(self, limit)
        self._run_first()
        self._passes.start()
        return 0

    def _hold_limits(self, rounds: Rounds, limit: int) -> None:
        """Rounds of new multipliers and passes until the state limits hold."""
        while not self._stopped and (due := rounds.due(limit)).any():
            rounds.next(due)
            self._descend(int(self.passes.numpy()[due].max()), limit)
        rounds.judge()

    def beyond_limits(self) -> np.ndarray:
        """(B,) how far a state is at most beyond its limits, relative to max(1, |limit|); 0: nowhere."""
        return np.zeros(self.batch) if self._rounds is None else self._rounds.beyond()

    def own_cost(self) -> np.ndarray:
        """(B,) the cost without the penalties of the state limits (M46), which can be so large that a
        difference tells nothing.
        """
        cost: np.ndarray = self.cost.numpy().copy()
        return cost if self._rounds is None else np.where(np.isfinite(cost), self._rounds.own_cost(), cost)

    def _descend(self, done: int, limit: int, rungs: Mapping[int, int] = MappingProxyType({})) -> None:
        """Passes until no problem goes on, or has made as many as it may.

        Args:
            done: the most that one which goes on has made so far.
        """
        while True:
            self.differentiate()
            if done in rungs:
                self._leave_behind(rungs[done])
            if done >= limit:
                self._end((self._state.active.numpy() == 1) & (self.passes.numpy() >= limit))
                if not self.active():
                    return
            self._passes.backward()
            if not self.active():
                return
            before = None if self._rounds is None else self.cost.numpy().copy()
            self._passes.search()
            done += 1
            if self._rounds is not None and before is not None:
                self._rounds.cut_short(before - self.cost.numpy(), limit)
            if self._tell is not None:
                going, cost = int(self._state.active.numpy().sum()), self.cost.numpy()
                most = int(self.passes.numpy().max())
                if self._tell(most, going, float(np.nanmin(np.append(cost, np.inf)))) is True:
                    self._stopped = True
                    break
        self.differentiate()
        self._passes.backward(last=True)

    def _leave_behind(self, count: int) -> None:
        """End all problems but `count` of lowest cost, with gains about the trajectories that they have."""
        cost = self.cost.numpy()
        best = np.argsort(np.where(np.isnan(cost), np.inf, cost), kind="stable")[:count]
        behind = self._state.active.numpy() == 1
        behind[best] = False
        self._end(behind)
        self._behind |= behind

    def _end(self, which: np.ndarray) -> None:
        """A last backward pass of these problems (B,) alone; the others go on after it."""
        if which.any():
            going = (self._state.active.numpy() == 1) & ~which
            self._state.active.assign(which.astype(np.int32))
            self._passes.backward(last=True)
            self._state.active.assign(going.astype(np.int32))

    def _without_regularization(self) -> None:
        """Once more the gains of what converged while it was regularised, as far as Q_uu does without."""
        mu = self._state.mu.numpy()
        which = (self.status.numpy() == Status.CONVERGED) & (mu > 0.0)
        if which.any():
            self._state.mu.assign(np.where(which, 0.0, mu))
            self._end(which)

    def differentiate(self) -> None:
        """Derivatives of dynamics and cost where trajectories changed."""
        self._run_linearize()
        self._run_cost()
        if self._rounds is not None:
            self._rounds.add_penalties()
        for run in self._weigh:
            run()

    def backward(self, last: bool = False) -> None:
        """A backward pass of the problems that go on: K, k, Vx, Vxx; with ``last`` they end with it."""
        self._passes.backward(last)

    def search(self) -> None:
        """A line search of the problems that go on, and the choice of a step size."""
        self._passes.search()

    def active(self) -> bool:
        """Whether any problem goes on."""
        return bool(self._state.active.numpy().any())

    def solve(
        self,
        x0: Any,
        us0: Any,
        xs0: Any = None,
        K0: Any = None,
        k0: Any = None,
        max_iterations: int | None = None,
        rungs: Sequence[tuple[int, int]] = (),
        progress: Callable[[int, int, float], bool | None] | None = None,
    ) -> Result:
        """`run`, with the solution copied into a `Result`; other threads wait meanwhile."""
        with self._using:
            return self.result(self.run(x0, us0, xs0, K0, k0, max_iterations, rungs, progress))

    def result(self, passes: int | None = None) -> Result:
        """Copy of the solution that the workspace holds."""
        if passes is None:
            passes = int(self.passes.numpy().max(initial=0))
        names = ("xs", "us", "K", "k", "Vx", "Vxx", "status", "gradient")
        lower, upper = (np.tile(a, (self.batch // len(a), 1)) for a in self.problem.limit_rows())
        return Result(
            **{name: getattr(self, name).numpy().copy() for name in names},
            cost=self.own_cost(),
            iterations=self.passes.numpy().copy(),
            min_pivot=self.pivot.numpy().copy(),
            lower=lower,
            upper=upper,
            trace=Trace.from_rows(self._state.trace.numpy()[:, : passes + 1]),
            simulated=self.problem.simulated(),
            state_limits=None if self._rounds is None else self.problem.state_limit_rows(),
        )


def _by_passes(rungs: Any) -> dict[int, int]:
    """Problems by the passes after which they are left."""
    try:
        pairs = [(passes, count) for passes, count in rungs]
    except (TypeError, ValueError):
        raise ArgumentError(
            f"rungs is {shown(rungs)}; pairs of passes and of problems that go on are needed"
        ) from None
    return {whole("passes of rungs", n, 0): whole("problems of rungs", count) for n, count in pairs}
