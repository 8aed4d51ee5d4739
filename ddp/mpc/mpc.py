"""Model predictive control as a policy: it plans from every state that it meets, and acts by the plan."""

import functools
import time as clock
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from slcp_warp import Simulator
from slcp_warp.inputs import checks
from slcp_warp.inputs.checks import instance, number, shown, whole
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.stepping.arguments import policy_arrays

from ..library.entries import scene_digest
from ..library.nearest import wrap
from ..options import Options, of_one_level
from ..problem import Problem
from ..results.result import Result
from .planner import Planner
from .sent import OnTheWay
from .starts import Planned, Policy, Situation, chosen_starts, read_only

SHARE = 0.2  # of the control limits: noise of starts
KEPT = 10_000  # cycles whose times are kept
OF_RUN = ("_ahead", "_numbers", "_way", "_newest", "_begun", "_active", "_coming")  # attributes


class MPC:
    """Plans over a receding horizon (IV.C, (19)): a policy of rollouts, sweeps and `slcp watch`.

    Every `replan` steps of the problem, from the state x of every world: the starts are rolled out on the
    model, the one of lowest cost goes through `passes` passes of DDP, and its first control is applied; until
    the next plan u = us_j + K_j (x - xs_j). Where no start or pass gives a finite cost the last plan goes on;
    `failures` counts that. It acts on the host (`policies.HostPolicy`), once a step of the problem; where the
    worlds make steps of another size, plans are followed in time, to the nearest of their steps. Limits of
    states are soft, at the first weight of the options.

    Args:
        problem: dynamics, cost, horizon and limits of the plans: the model, which may differ from what is
            controlled in residual, sigma, parameters and precision, not in its mechanism. What a cost has by
            time, node or step is of the run's; beyond the last node of a target that one is held.
        library: a `ddp.Library`, or any policy that runs in kernels, for the start "library".
        plan: a `ddp.Result` of one problem from the run's beginning, for the start "plan".
        end: steps of a run. Plans look no further than to its end, with the problem's final cost there;
            after it, and where it is None, they always have the problem's horizon.
        passes: of DDP a cycle. 0: real-time iteration; what arrives is rolled out with the last backward
            pass, and the next one is made after the control is given (`prepare`).
        replan: steps between two plans.
        delay: steps for which a new plan is not there yet, less than `replan`; the last one acts meanwhile.
        lag: steps after which a control acts that is sent, as of a task's delay. Plans begin with the state
            that the controls sent before lead to on the model, none before the first; so does feedback.
        starts: of "shift", "keep", "plan", "library", "noise", "zero", a `ddp.Sampling`, or functions of a
            `ddp.Situation` that give controls (B, N, nu), a `ddp.StartPolicy`, or None.
        improved: starts of lowest cost that go through the passes; the best of them is taken.
        sigma: noise level of the model's smoothing; None: the problem's.
        noise: standard deviation of the start "noise" [control units]; None: a fifth of the limits, or 1.
        seed: of that noise.
        options: of DDP; `passes` stand in the place of its max_iterations. None: those of `ddp.solve`, but
            Gauss-Newton where second derivatives take most of a cycle's time (`Problem.quick_method`).
        block: worlds that are planned at once.

    Attributes:
        failures: plans that were kept for want of a better one.
        chosen: how often each start was chosen.
        seconds: of the last 10,000 cycles, from the states to the controls, one number a cycle (of all its
            worlds).
    """

    sees_states = True  # whatever else a task's policies see

    def __init__(
        self,
        problem: Problem,
        library: Any = None,
        passes: int = 2,
        replan: int = 1,
        delay: int = 0,
        starts: Sequence[Any] | None = None,
        improved: int = 1,
        sigma: float | None = None,
        noise: Any = None,
        seed: int = 0,
        options: Options | None = None,
        block: int = 256,
        plan: Result | None = None,
        end: int | None = None,
        lag: int = 0,
    ) -> None:
        instance("problem", problem, Problem, "a ddp.Problem")
        if not isinstance(problem.dynamics, Simulator):
            raise ArgumentError("problem.dynamics must be a slcp_warp.Simulator for a policy of its worlds")
        rows = [problem.limit_rows()[0], problem.state_limit_rows()[0]]
        own = {len(a) for a in rows} | {getattr(problem.params, "worlds", None) or 1}
        if own != {1}:
            raise ArgumentError(f"problem has numbers of {max(own)} worlds; one for all is needed")
        if sigma is not None:
            problem = problem.with_params(sigma=number("sigma", sigma, 0.0, above=True))
        self.problem, self.model, self.passes = problem, problem.dynamics, whole("passes", passes, 0)
        self.replan, self.delay = whole("replan", replan), whole("delay", delay, 0)
        self.block, self.lag = whole("block", block), whole("lag", lag, 0)
        if self.delay >= self.replan and self.delay:
            raise ArgumentError(f"delay is {delay}; less than replan, {replan} steps, is needed")
        if self.replan > problem.horizon:
            raise ArgumentError(f"replan is {replan}; at most the horizon, {problem.horizon}, is needed")
        self.end = None if end is None else whole("end", end)
        self._timed_cost = problem.cost.follows_steps(problem.nx, problem.nu)
        problem.cost.check_moves(problem.nx, problem.nu, "problem.cost is planned with from later steps, too")
        given = {"plan": plan is not None, "library": library is not None}
        ahead = [name for name, there in given.items() if there] or ["zero"]
        default = ("shift", *(("keep",) if passes == 0 else ()), *ahead)
        self.starts = chosen_starts(default if starts is None else starts)
        for name, there in given.items():
            if name in self.starts and not there:
                raise ArgumentError(f"starts names {name!r}; a {name} is needed")
        if plan is not None:
            made = Planned(instance("plan", plan, Result, "a ddp.Result of one problem"), problem)
            self.starts |= {"plan": made} if "plan" in self.starts else {}
        self.improved, self.seed = whole("improved", improved), whole("seed", seed, 0)
        if self.improved > len(self.starts):
            raise ArgumentError(f"improved is {improved}; at most the {len(self.starts)} starts are there")
        instance("options", options, Options | None, "a ddp.Options")
        self.options = of_one_level(options or Options(method=problem.quick_method))
        self.noise = self._noise(noise)
        self.period = float(np.ravel(problem.params["step_size"])[0])
        self._wrap = problem.dynamics.scene.state_period
        policy = library.policy() if hasattr(library, "policy") else library
        self._library = None if policy is None else _Kept(policy, problem)
        self.failures, self.chosen = 0, dict.fromkeys(self.starts, 0)
        self.seconds: deque[float] = deque(maxlen=KEPT)
        self._planners: list[Planner] = []

    def __repr__(self) -> str:
        how = f"{self.passes} passes" if self.passes else "real-time iteration"
        return (
            f"<MPC of {self.model.scene.name!r}: {self.problem.horizon} steps ahead, {how} every "
            f"{self.replan}; starts {', '.join(self.starts)}>"
        )

    def __getstate__(self) -> dict[str, Any]:
        """Of no run: copies and pickles begin anew."""
        return {name: value for name, value in vars(self).items() if name not in OF_RUN} | {"_planners": []}

    @property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the controls, (1, nu)."""
        return self.problem.limit_rows()

    def _noise(self, given: Any) -> np.ndarray:
        """(nu,) standard deviation."""
        nu = self.problem.nu
        if given is None:
            reach = np.abs(np.concatenate(self.problem.limit_rows())).max(axis=0)
            return np.where(np.isfinite(reach), SHARE * np.where(np.isfinite(reach), reach, 0.0), 1.0)
        found = checks.numeric(given)
        if found is None or found.shape not in ((), (nu,)) or not (found >= 0.0).all():
            raise ArgumentError(f"noise is {shown(given)}; numbers of at least 0, one or ({nu},), are needed")
        return np.broadcast_to(found, (nu,)).astype(np.float64)

    def begin(self, sim: Any, worlds: np.ndarray) -> None:
        """Worlds to control, from their beginning; see `policies.HostPolicy`.

        Raises:
            ArgumentError: another mechanism than the problem's.
        """
        if scene_digest(sim.scene) != scene_digest(self.model.scene):
            raise ArgumentError(
                f"the problem is of scene {self.model.scene.name!r}, and scene {sim.scene.name!r} is to be "
                "controlled; the same mechanism is needed"
            )
        count = len(worlds)
        sizes = [min(self.block, count - first) for first in range(0, count, self.block)]
        if [p.worlds for p in self._planners] != sizes:
            how = self.problem, self.options, self.passes
            self._planners = [Planner(*how, n, len(self.starts), self.improved) for n in sizes]
        for planner in self._planners:
            planner.forget()
        self._ahead = self.problem
        self._numbers = np.asarray(worlds)
        self._way = [OnTheWay(self.problem, self.lag, n) for n in sizes] if self.lag else []
        self._newest: int | None = None  # steps at which the newest plans were made, and those that act
        self._begun = 0
        self._active: list[Policy | None] = [None] * len(sizes)
        self._coming: list[Policy | None] = [None] * len(sizes)

    def act(self, x: np.ndarray, time: float, worlds: np.ndarray) -> np.ndarray:
        """Controls (B, nu) of states (B, nx); a world that is not finite gets none."""
        if "_newest" not in vars(self):
            raise ArgumentError("this policy is in no run yet; begin(sim, worlds) comes before act")
        began = clock.perf_counter()
        out, first = np.zeros((len(x), self.problem.nu)), 0
        now = round(time / self.period)
        passed = 0 if self._newest is None else now - self._newest
        due, late = self._newest is None or passed >= self.replan, self.delay > 0 and self._newest is not None
        if self._newest is not None and passed >= self.delay:
            self._active, self._begun = list(self._coming), self._newest
        if due:
            self._newest = now
            self._look_ahead(now)
            self._begun = self._begun if late else now
        for i, planner in enumerate(self._planners):
            own = slice(first, first + planner.worlds)
            first = own.stop
            alive = np.isfinite(x[own]).all(1)
            states = np.where(alive[:, None], x[own], self.model.scene.x0)
            if self.lag:
                states = self._way[i].arrive(now, states)
            planner.prepare()
            if due:
                self._plan(i, planner, states, time, (now, passed), self._numbers[own])
                self._active[i] = self._active[i] if late else self._coming[i]
            out[own] = np.where(alive[:, None], self._controls(i, now - self._begun, states), 0.0)
            if self.lag:
                self._way[i].send(out[own])
        if due:
            self.seconds.append(clock.perf_counter() - began)
        return out

    def prepare(self) -> None:
        """What can be computed before the next states come: the backward passes of real-time iteration.

        `act` does it where nobody did; called between two cycles it is not in their time.
        """
        for planner in self._planners:
            planner.prepare()

    def _look_ahead(self, now: int) -> None:
        """The problem of what is left of the run, or of the whole horizon."""
        left = self.problem.horizon if self.end is None else self.end - now
        if self.end is not None and left > 0:  # what is sent in the last `lag` steps acts after the end
            left = max(left - self.lag, min(left, self.replan))
        horizon = self.problem.horizon if left <= 0 else min(left, self.problem.horizon)
        if self._timed_cost:  # times of the run
            cost = self.problem.cost.from_step(now + self.lag, horizon)
            self._ahead = replace(self.problem, horizon=horizon, cost=cost)
        elif horizon != self._ahead.horizon:
            self._ahead = replace(self.problem, horizon=horizon)

    def _plan(
        self,
        i: int,
        planner: Planner,
        x: np.ndarray,
        time: float,
        steps: tuple[int, int],
        numbers: np.ndarray,
    ) -> None:
        """A new plan of a block of worlds, in a step, so many after the last; it acts after the delay."""
        (now, passed), ahead = steps, self.lag * self.period
        now += self.lag  # plans begin when the first of their controls acts
        last = planner.policy
        if last is not None:
            last = last.shifted(passed, self._ahead.horizon).near(x, self._wrap)
        cycle = self.seed, now
        rolled = None if self._library is None else functools.partial(self._library.controls, now)
        last = None if last is None else last.read_only()
        x, numbers, noise = (read_only(a) for a in (x, numbers, self.noise))
        situation = Situation(self._ahead, x, time + ahead, numbers, last, cycle, noise, rolled)
        made = planner.plan(situation, self.starts)
        self.failures += made.failures
        for name, count in made.chosen.items():
            self.chosen[name] += count
        self._coming[i] = planner.acting

    def _controls(self, i: int, age: int, x: np.ndarray) -> np.ndarray:
        """u = us_j + K_j (x - xs_j) of the plan that acts, within the limits."""
        policy = self._active[i]
        assert policy is not None
        j = min(age, policy.us.shape[1] - 1)
        from_plan = wrap(x - policy.xs[:, j], self._wrap)
        lower, upper = self.problem.limit_rows()
        return np.clip(policy.us[:, j] + np.einsum("bux,bx->bu", policy.K[:, j], from_plan), lower, upper)

    def plans(self) -> tuple[Problem, Policy]:
        """The newest plans of all worlds, with their gains, and their problem: near the end of a run its
        horizon is what is left.
        """
        self.prepare()
        made = [planner.acting for planner in self._planners]
        if not made or any(each is None for each in made):
            raise ArgumentError("there are no plans yet: act, or a run, makes them")
        return self._ahead, Policy.join([each for each in made if each is not None])

    def met(self) -> np.ndarray:
        """(B, lag + 1, nx) the states from that which was met last on, up to where the next control acts, of
        all worlds; the last ones are those that plans begin with.
        """
        if not self.lag:
            return self.plans()[1].xs[:, :1]
        return np.concatenate([way.path for way in self._way])

    def intended(self, world: int = 0) -> np.ndarray:
        """(N+1, nx) the states that the plan of a world passes through; for pictures."""
        first = 0
        for planner in self._planners:
            if world < first + planner.worlds:
                if planner.acting is None:
                    break
                return np.asarray(planner.acting.xs[world - first])
            first += planner.worlds
        raise ArgumentError(f"world is {world}; there is no plan of it")


class _Kept:
    """A policy in kernels whose arrays are made once, rolled out on a model."""

    def __init__(self, policy: Any, problem: Problem) -> None:
        self.policy, self.problem = policy, problem
        self._found = policy_arrays(policy, problem.dynamics, None)
        self._timed = getattr(policy, "timed", False)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.policy, self.problem)

    def kernel(self, sim: Simulator) -> tuple[Any, Any]:
        """What was made."""
        return self._found

    def controls(self, step: int, x: np.ndarray) -> np.ndarray:
        """Controls (B, N, nu) from states x (B, nx) at a step of the run."""
        p = self.problem
        if self._timed:
            self._found[1].begin = float(step)
        run = p.dynamics.rollout(x, params=p.params, policy=self, steps=p.horizon, record="controls")
        return np.nan_to_num(run.controls)  # of worlds that fail on the way: none
