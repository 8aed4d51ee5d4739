"""Receding horizon off line (IV.C): chains of plans that leave a library of local controllers behind.

Every shift moves a chain d steps along its plan and plans again. The starts of one shift are one batch: the
shifted policy (19) rolled out with its feedback, the policies of earlier good plans near the state, and
smoothed noise. The best plan is kept. Without the last two a chain settles in passive plans, and a library
of passive plans attracts a controller to them.
"""

import functools
import json
import os
import warnings
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from slcp_warp import Simulator
from slcp_warp.inputs.checks import array, function, instance, shown, whole
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
from slcp_warp.runs.sequence import step_of
from slcp_warp.runs.stopping import Stop, on_signals
from slcp_warp.runs.store import Store

from ..options import Options
from ..problem import Problem
from ..workspace import Workspace
from .entries import scene_digest
from .kept import kept_shifts
from .library import Library
from .nearest import wrap
from .receding_options import RecedingOptions

STEP_SIZES = tuple(2.0 ** -np.arange(8.0))
LOST = 20  # shifts without a plan of any chain, after which there is none to hope for
STATE = ("x", "us", "xs", "K", "lower", "upper", "cost", "gain")


@dataclass
class Plans:
    """Plans kept for recall: policies (P, ...) with their gain over zero controls."""

    us: list[np.ndarray] = field(default_factory=list)
    xs: list[np.ndarray] = field(default_factory=list)
    K: list[np.ndarray] = field(default_factory=list)
    gain: list[float] = field(default_factory=list)

    def add(self, us: np.ndarray, xs: np.ndarray, K: np.ndarray, gain: float) -> None:
        """Keep a plan."""
        self.us.append(us)
        self.xs.append(xs)
        self.K.append(K)
        self.gain.append(gain)


def build_library(
    problem: Problem,
    x0: Any,
    count: int,
    options: RecedingOptions | None = None,
    progress: Callable[[int, int], None] | None = None,
    *,
    out: str | os.PathLike[str] | None = None,
    **changes: Any,
) -> Library:
    """Propagate receding-horizon chains until the library has `count` entries.

    With ``out`` every shift is kept in that folder as soon as it is planned. The same call goes on from
    there, after a kill too, and gives the same library bit for bit; so does one with another `count`.

    Args:
        problem: dynamics, cost and horizon of every plan; the dynamics is a `Simulator`.
        x0: (nx,) initial state of every chain, or (chains, nx).
        count: entries wanted.
        options: how; or single fields of it as keywords.
        progress: called with (entries so far, count) after every shift.
        out: a folder for the shifts (needs the extra `data`); one of another library is refused.
        changes: fields of `RecedingOptions` (offset=4, ...).

    Raises:
        ValueError: illegal options, or no plan from x0 with a finite cost in as many shifts as `LOST`; where
            there are entries by then, a RuntimeWarning, and these. A keyboard interrupt, and with ``out``
            SIGTERM too, returns what there is if there are entries, else is raised.
        FileError: the folder is of another library, damaged, full or gone.
    """
    whole("count", count)
    instance("options", options, RecedingOptions | None, "a ddp.RecedingOptions")
    function("progress", progress, 2, optional=True)
    if options is not None and changes:
        raise ArgumentError(f"give either options or its fields as keywords, not both: {sorted(changes)}")
    unknown = set(changes) - {f.name for f in fields(RecedingOptions)}
    if unknown:
        names = [f.name for f in fields(RecedingOptions)]
        raise ArgumentError(f"RecedingOptions has no {sorted(unknown)}; there are {names}")
    options = RecedingOptions(**changes) if options is None else options
    chains = _Chains(problem, array("x0", x0, finite=False), options)
    kept = None if out is None else kept_shifts(out, problem, chains.x, options)
    stop = Stop()
    with on_signals(stop) if out is not None else nullcontext():
        try:
            _propagate(chains, count, kept, stop, progress)
        except KeyboardInterrupt:
            stop()
    if stop and not chains.stored:
        raise KeyboardInterrupt
    return chains.library(count)


def _propagate(
    chains: "_Chains",
    count: int,
    kept: Store | None,
    stop: Stop,
    progress: Callable[[int, int], None] | None,
) -> None:
    """First plans, then shifts until there are enough entries; those that are kept are not planned again."""
    _plan(chains, kept, chains.first_plans)
    lost = 0  # shifts since one had a plan
    while chains.stored < count and not stop:
        if progress is not None:
            progress(min(chains.stored, count), count)
        before = chains.stored
        chains.store()
        lost = 0 if chains.stored > before else lost + 1
        if lost == LOST:
            _give_up(chains, count)
            return
        _plan(chains, kept, chains.shift)


def _give_up(chains: "_Chains", count: int) -> None:
    """Warn that no chain has a plan any more; or an error where none ever had one."""
    if not chains.stored:
        raise ArgumentError(
            f"x0 is {shown(chains.first_x.tolist())}, from where no plan of {LOST} has a finite cost: "
            "ddp.solve says why by its status"
        )
    warnings.warn(
        f"chains ended at {chains.stored} of {count} entries: no plan of the last {LOST} shifts has a finite "
        "cost",
        RuntimeWarning,
        stacklevel=2,
    )


def _plan(chains: "_Chains", kept: Store | None, plan: Callable[[], None]) -> None:
    if kept is None:
        plan()
        return

    def compute() -> dict[str, np.ndarray]:
        plan()
        return chains.columns()

    columns, found = step_of(kept, chains.index, compute)
    if found:
        chains.restore(columns)


class _Chains:
    """State of the chains: where each is, its plan, and what has been stored."""

    def __init__(self, problem: Problem, x0: np.ndarray, options: RecedingOptions) -> None:
        if not isinstance(problem, Problem) or not isinstance(problem.dynamics, Simulator):
            raise ArgumentTypeError("build_library needs a problem whose dynamics is a slcp_warp.Simulator")
        if problem.cost.follows_steps(problem.nx, problem.nu):
            raise ArgumentError(
                "problem.cost is another one from step to step; chains begin anew with every plan, and need "
                "a cost that is the same at every step"
            )
        if options.offset >= problem.horizon:
            raise ArgumentError(
                f"RecedingOptions.offset is {options.offset}; less than the horizon, {problem.horizon}, "
                "is needed"
            )
        if x0.shape not in ((problem.nx,), (options.chains, problem.nx)) or not np.isfinite(x0).all():
            raise ArgumentError(
                f"x0 has shape {x0.shape}; finite numbers of shape ({problem.nx},) or "
                f"({options.chains}, {problem.nx}) are needed, by RecedingOptions.chains"
            )
        self.problem, self.options, self.sim = problem, options, problem.dynamics
        shape = problem.horizon, problem.nu
        first = np.zeros(shape) if options.first is None else options.first
        self.first = np.clip(array("RecedingOptions.first", first, shape), *problem.limit_rows())
        self.period = self.sim.scene.state_period
        self.rng = np.random.default_rng(options.seed)
        self.x = np.broadcast_to(x0, (options.chains, problem.nx)).copy()
        self.starts = 1 + options.recalled + options.noisy
        self.first_x = self.x
        self.plans = Plans()
        self.entries: list[dict[str, Any]] = []
        self.stored = 0
        self.steps = 0
        self.index = 0

    @functools.cached_property
    def shifting(self) -> Workspace:
        """What plans a shift."""
        options = self.options
        return Workspace(self.problem, options.chains * self.starts, self._limited(options.passes))

    def _limited(self, passes: int) -> Options:
        """Options of the solver with so many passes."""
        own = self.options.solver
        if own is None:
            own = Options(method=self.problem.quick_method, step_sizes=STEP_SIZES)
        return replace(own, max_iterations=passes)

    def columns(self) -> dict[str, np.ndarray]:
        """What the next shift depends on, beside the plans kept so far: a row a chain."""
        random = json.dumps(self.rng.bit_generator.state)
        columns = {name: getattr(self, name) for name in STATE}
        return {"chain": np.arange(len(self.x)), **columns, "random": np.full(len(self.x), random)}

    def restore(self, columns: dict[str, np.ndarray]) -> None:
        """Be as when `columns` was called."""
        for name in STATE:
            setattr(self, name, columns[name])
        self.steps = self.index * self.options.offset
        self.rng.bit_generator.state = json.loads(str(columns["random"][0]))

    def first_plans(self) -> None:
        """The first plan of every chain: from zero, or controls given, and from noise, to convergence."""
        first = Workspace(self.problem, len(self.shifting_x()), self._limited(self.options.first_passes))
        starts = [start for _ in self.x for start in range(self.starts)]
        us = np.stack([self._noise() if start else self.first for start in starts])
        self._keep_best(first, first.solve(self.shifting_x(), us))

    def shifting_x(self) -> np.ndarray:
        """Initial states of the batch: every chain's, once per start."""
        return np.repeat(self.x, self.starts, axis=0)

    def shift(self) -> None:
        """Advance every chain by the offset, kick it if due, and plan again."""
        d = self.options.offset
        self.x = self.xs[:, d].copy()
        before, self.steps = self.steps, self.steps + d
        every = self.options.perturb_every
        if every and self.steps // every != before // every:
            kick = np.sqrt(self.options.perturb_variance) * self.rng.standard_normal(
                (len(self.x), self.problem.nx // 2)
            )
            kick[: self.options.unperturbed] = 0.0
            self.x[:, self.problem.nx // 2 :] += kick
        us, xs, K = self._starts()
        self._keep_best(self.shifting, self.shifting.solve(self.shifting_x(), us, xs, K))

    def _keep_best(self, workspace: Workspace, result: Any) -> None:
        groups = result.cost.reshape(len(self.x), self.starts)
        best = np.arange(len(self.x)) * self.starts + np.nanargmin(
            np.where(np.isfinite(groups), groups, np.inf), axis=1
        )
        self.us, self.xs, self.K = result.us[best], result.xs[best], result.K[best]
        self.lower, self.upper = result.lower[best], result.upper[best]
        self.cost = result.cost[best]
        with np.errstate(invalid="ignore"):  # of chains without a plan
            self.gain = self._passive_cost() - self.cost

    def _passive_cost(self) -> np.ndarray:
        """Cost of zero controls from every chain's state."""
        zero = np.zeros((len(self.x), self.problem.horizon, self.problem.nu))
        if not hasattr(self, "passive"):
            self.passive = Workspace(self.problem, len(self.x), Options(max_iterations=0))
        return self.passive.solve(self.x, zero).cost

    def _starts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Warm starts of the batch: policies (us, xs, K)."""
        d, N = self.options.offset, self.problem.horizon
        at = np.minimum(np.arange(N) + d, N - 1)  # (19): shifted, the last control repeated
        out = []
        for c in range(len(self.x)):
            gain = self.K[c][at].copy()
            gain[N - d :] = 0.0
            states = np.concatenate([self.xs[c][d:], np.repeat(self.xs[c][-1:], d, axis=0)])
            out.append((self.us[c][at], states, gain))
            for plan in self._recall(self.x[c]):
                turn = self.x[c] - self.plans.xs[plan][0]
                turn = turn - wrap(turn, self.period)
                out.append((self.plans.us[plan], self.plans.xs[plan] + turn, self.plans.K[plan]))
            while len(out) % self.starts:
                out.append(
                    (self._noise(), np.repeat(self.x[c][None], N + 1, axis=0), np.zeros_like(self.K[c]))
                )
        us, xs, K = (np.stack(part) for part in zip(*out, strict=True))
        return us, xs, K

    def _recall(self, x: np.ndarray) -> np.ndarray:
        """Plans of the better half that start nearest to x, in units of the spread of their starts."""
        if not self.options.recalled or len(self.plans.us) < 2:
            return np.zeros(0, int)
        starts, gain = np.stack([xs[0] for xs in self.plans.xs]), np.array(self.plans.gain)
        good = np.flatnonzero(gain >= np.median(gain))
        spread = wrap(starts, self.period).std(axis=0) + 1e-6
        distance = (wrap(starts[good] - x, self.period) / spread) ** 2
        return good[np.argsort(distance.sum(axis=1), kind="stable")[: self.options.recalled]]

    def _noise(self) -> np.ndarray:
        """Smoothed noise controls (N, nu)."""
        white = self.rng.standard_normal((self.problem.horizon, self.problem.nu))
        keep = np.exp(-1.0 / self.options.noise_time)
        out = np.empty_like(white)
        value = white[0]
        for k, step in enumerate(white):
            value = keep * value + np.sqrt(1.0 - keep**2) * step
            out[k] = value
        return self.options.noise * out

    def store(self) -> None:
        """Store the first controllers of the current plans."""
        for c in range(len(self.x)):
            if not np.isfinite(self.cost[c]):
                continue
            self.plans.add(self.us[c], self.xs[c], self.K[c], float(self.gain[c]))
            for k in range(self.options.entries):
                self.entries.append(
                    {
                        "x": self.xs[c, k], "u": self.us[c, k], "K": self.K[c, k], "cost": self.cost[c],
                        "gain": self.gain[c], "age": k, "chain": c, "plan": self.index,
                        "lower": self.lower[c], "upper": self.upper[c],
                    }
                )  # fmt: skip
                self.stored += 1
        self.index += 1

    def library(self, count: int) -> Library:
        """The first `count` entries."""
        rows = self.entries[:count]
        arrays = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        options = self.options
        made = {"offset": options.offset, "chains": options.chains, "seed": options.seed}
        header = library_header(self.problem) | made
        return Library(**arrays, period=self.period, header=header)


def library_header(problem: Problem) -> dict[str, Any]:
    """What a library says of the problem that it was built for."""
    sim = problem.dynamics
    return {
        "scene": sim.scene.name,
        "digest": scene_digest(sim.scene),
        "sigma": float(next(iter(problem.params["sigma"].flat), sim.scene.sigma)),
        "step_size": float(problem.params["step_size"].flat[0]),
        "horizon": problem.horizon,
        "scaling": sim.options.scaling,
        "residual": sim.options.residual,
        "integrator": sim.options.integrator,
    }
