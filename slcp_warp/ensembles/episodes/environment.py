"""A task as an environment of reinforcement learning: many worlds, each in an episode of its own."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.ensembles.arrival import OVERLAP, STOPPED

from ...inputs import checks
from ...inputs.errors import ArgumentError
from ...inputs.limits import limit_rows
from ...inputs.times import nearest_steps
from ...measures.signals import Signal
from ...options import Options, Status
from ...simulator import Simulator
from ...storage.printed import Printed
from ...tasks.task import Task
from ..by_periods import OnHost, Running
from ..launch import nothing_noted
from ..tasks import case_of, columns_of, judged_of
from ..worlds.draws import draws_of_task
from ..worlds.events import Written
from ..worlds.placed import placed
from .reward import reward_of
from .rows import begin_anew


@dataclass(frozen=True)
class Moment:
    """What a step of an `Environment` gives.

    Attributes:
        observation: (B, ny) of what the next controls are given for: where an episode ended, the start of the
            next one ("same_step"), or where it ended, and whatever control comes next begins another one
            without a reward ("next_step").
        reward: (B,) of the step; in one that was not solved 0 where it is not finite.
        terminated: (B,) whose episode ended by the task's failure.
        truncated: (B,) whose episode ended by its duration, or as a step was not solved.
        last: (B, ny) what was observed of the step itself: `observation`, but of the n episodes that ended
            where they did. Its value counts behind `truncated`.
        ended: columns (n,) of these: slot (place among the B), world (number), the task's measures, success,
            status, as in a sweep's report, steps, and return (the sum of rewards).
    """

    observation: np.ndarray
    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    last: np.ndarray
    ended: dict[str, np.ndarray]


AUTORESETS = ("same_step", "next_step")


class Echo:
    """A policy on the host that shows what it is given, and feels what a run's kernels then keep."""

    def __init__(self, period: float | None, senses: Mapping[str, Signal]) -> None:
        self.period, self.senses = period, senses

    def feel(self, shown: dict[str, np.ndarray]) -> None:
        """An environment reads what is felt itself."""

    def act(self, x: np.ndarray, time: float, worlds: np.ndarray) -> np.ndarray:
        """The observation itself."""
        return x


class Environment(Printed):
    """A task in B worlds that a learner steps: x is observed, u given, a reward paid; who ends begins anew.

    The worlds are those of a sweep: disturbed as the task says (parameters, start, noise, delays, kicks),
    behind its observation, sensor noise and control limits, judged by its measures and its success. Episode
    e of slot i is world i + e B, whatever is learnt and whatever the other slots do, so that a sweep of the
    same seed and precision, and `slcp.replay`, meet the same worlds.

    Args:
        task: with a cost, or see `reward`.
        worlds: B, how many at once.
        seed: of all that is drawn.
        case: options of the steps; None: the task's.
        reward: a measure that adds up over the steps (`measures.total`, `integral`, `impulse`), whose growth
            is paid; None: the task's cost, negative, the final cost with the last step.
        period: between two controls [s], rounded to whole steps; None: a step, or the task's hold.
        senses: by name signals of contacts and tendons (`slcp_warp.measures`), whose values in the step that
            was made last are observed behind the states, 0 at an episode's start.
        autoreset: when the next episode of a slot begins: "same_step", with the step that ends the last one,
            or "next_step", with the one after it, which makes no step in this slot.
        step_size: [s]; None: the scene's.
        dtype, device, strategy: as of a `Simulator`.

    Raises:
        ArgumentError: a scene without controls, a task without a cost where no reward is given, a reward that
            does not add up, step sizes that are drawn.

    Attributes:
        task, worlds, seed, autoreset: as given.
        sim: the simulator of its steps.
        observations, controls: ny and nu, numbers of an observation and of a control.
        limits: (lower, upper) of the controls, (nu,) each, infinite where there is none; what is beyond acts
            as the limit.
        period: between two controls [s].
        dtype: of observations.
    """

    def __init__(
        self,
        task: Task,
        worlds: int = 1,
        *,
        seed: int = 0,
        case: Options | None = None,
        reward: Any = None,
        period: float | None = None,
        senses: Mapping[str, Signal] | None = None,
        autoreset: str = "same_step",
        step_size: float | None = None,
        dtype: str = "float32",
        device: Any = None,
        strategy: str = "auto",
    ) -> None:
        self.task = checks.instance("task", task, Task, "a slcp_warp.Task")
        self.worlds, self.seed = checks.whole("worlds", worlds), checks.whole("seed", seed, 0)
        options = (
            task.options if case is None else checks.instance("case", case, Options, "slcp_warp.Options")
        )
        if not task.scene.nu:
            raise ArgumentError(f"task {task.name!r} has a scene without controls; nothing can be learnt")
        if "step_size" in task.disturbances.parameters:
            raise ArgumentError("task draws step_size; worlds that are stepped together need one")
        self._reward = reward_of(task, reward)
        h = task.scene.step_size if step_size is None else step_size
        self._h = checks.number("step_size", h, 0.0, above=True)
        assert task.duration is not None
        nearest_steps("Task.duration", task.duration, self._h)
        task.disturbances.check_kicks(self._h, task.duration)
        if period is not None:
            checks.number("period", period, 0.5 * self._h, above=True)
        self._echo = Echo(period, {} if senses is None else senses)
        self.autoreset = checks.choice("autoreset", autoreset, AUTORESETS)
        self.sim = Simulator(task.scene, options, device=device, dtype=dtype, strategy=strategy)
        self.dtype = np.dtype(wp.dtype_to_numpy(self.sim.dtype))
        lower, upper = limit_rows(task.control_limits, task.scene.nu)
        self.limits = lower[0], upper[0]
        for side in self.limits:
            side.flags.writeable = False
        self._judged = [*judged_of(task), self._reward.measure]
        each = self.sim.params.layout.width + self.sim.nx + task.disturbances.numbers(task.scene.nv)
        checks.memory("worlds: their numbers", self.worlds * each, 16, self.sim.device)
        self._begin(self.seed)
        self._begun, self._nobody = False, self._ended(np.zeros(0, int))
        self.observations, self.controls = self._observe().shape[1], task.scene.nu
        self.period = self._policy.every * self._h

    def _line(self) -> str:
        return (
            f"of task {self.task.name!r}, {self.worlds} worlds: {self.observations} numbers observed, "
            f"{self.controls} controls every {self.period:g} s, episodes of {self.task.duration:g} s"
        )

    def _begin(self, seed: int) -> None:
        """All slots at the start of their first episodes."""
        self.seed, sim, task, count = seed, self.sim, self.task, self.worlds
        self._draws = draws_of_task(sim, task, task.disturbances, seed, self._h)
        case = case_of(task, sim, self._echo, self._draws, self._judged, self._h, worlds=count, seed=seed)
        self._case, self._numbers = case, np.arange(count)
        self._worlds = placed(sim, task.disturbances, self._draws.of_numbers(self._numbers))
        self._policy = OnHost(sim, case.policy, case.conditions, self._worlds)
        records: wp.array = wp.zeros((count, 0, 0), dtype=wp.float32, device=sim.device)
        self._noted = nothing_noted(sim, count)
        self._running = Running(
            sim, self._policy, case.conditions, case.table, self._worlds, Written(records, self._noted)
        )
        self._sum = self._running.kept[:, len(self._judged) - 1, 0]  # of the reward's measure, in a step
        self._paid = np.zeros(count)

    def reset(self, seed: int | None = None) -> np.ndarray:
        """All worlds at the start of an episode: of the next one, or with a seed of the first.

        Returns:
            Observations (B, ny).
        """
        seed = None if seed is None else checks.whole("seed", seed, 0)
        if seed is not None:
            self._begin(seed)
        elif self._begun:
            self._renew(np.arange(self.worlds))
        self._waiting = np.zeros(self.worlds, bool)
        self._begun = True
        return self._observe()

    def step(self, controls: Any) -> Moment:
        """A period of every world under controls (B, nu).

        Raises:
            ArgumentError: controls of another shape, or that are not finite.
        """
        if not self._begun:
            raise ArgumentError("step came before reset; call reset() first")
        u = checks.array("controls", controls, (self.worlds, self.controls))
        with np.errstate(over="ignore"):
            if not np.isfinite(single := u.astype(self.dtype)).all():
                raise ArgumentError(f"controls holds {u[~np.isfinite(single)][0]:g}, beyond {self.dtype}")
        self._policy.held.us.assign(single)
        self._sum.zero_()
        self._running.go(checks.MOST)
        over, unsolved = self._over()
        paid = self._reward.sign * self._sum.numpy()
        paid[unsolved & ~np.isfinite(paid)] = 0.0
        self._paid += paid
        ended = self._ended(np.flatnonzero(over)) if over.any() else dict(self._nobody)
        failed = np.zeros(self.worlds, bool)
        failed[ended["slot"]] = np.isfinite(ended.get("failure_time", np.inf))
        observation, last = self._seen_on(over)
        return Moment(observation, paid, failed, over & ~failed, last, ended)

    def _over(self) -> tuple[np.ndarray, np.ndarray]:
        """(B,) slots whose episode ended with the step just made, and those that were not solved in it."""
        p = self._running.span.p
        status, steps, next = (each.numpy() for each in (p.status, p.steps, self._running.next))
        unsolved = status != Status.SOLVED
        over = ((next >= steps) | unsolved) & ~self._waiting
        if (stopped := over & (next < steps)).any():  # no kick meets them any more
            p.steps.assign(np.where(stopped, next, steps))
        return over, unsolved

    def _seen_on(self, over: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is observed, and what was of the step itself (B, ny), with the episodes that begin now."""
        last = self._observe()
        waited, self._waiting = self._waiting, over
        begin = waited
        if self.autoreset == "same_step":
            begin, self._waiting = over, waited
        if not begin.any():
            return last, last
        self._renew(np.flatnonzero(begin))
        observation = np.where(begin[:, None], self._observe(), last)
        return observation, np.where(waited[:, None], observation, last)

    def _ended(self, slots: np.ndarray) -> dict[str, np.ndarray]:
        """Columns of episodes that ended."""
        kept = self._running.kept.numpy()[slots]
        seen = self._noted.numpy()[slots]
        found = {
            "measures": self._case.table.values(kept),
            "status": self._running.span.p.status.numpy()[slots],
            "start_overlap": seen[:, OVERLAP],
            "unsolved_time": seen[:, STOPPED],
        }
        judged = self._judged[:-1]  # the last one is of a step alone
        columns = columns_of(self.task, judged, found, self._numbers[slots])
        steps = self._running.next.numpy()[slots]
        return {"slot": slots, **columns, "steps": steps, "return": self._paid[slots]}

    def _renew(self, slots: np.ndarray) -> None:
        """The next episodes of some slots."""
        if len(slots) and self._numbers[slots].max() > checks.MOST - self.worlds:
            raise ArgumentError(
                f"{checks.MOST} worlds were drawn, and there are no more numbers; reset(seed=...)"
            )
        self._numbers[slots] += self.worlds
        self._paid[slots] = 0.0
        fresh = placed(self.sim, self.task.disturbances, self._draws.of_numbers(self._numbers[slots]))
        begin_anew(self.sim, self._case.conditions, self._running, self._worlds, self._noted, slots, fresh)

    def _observe(self) -> np.ndarray:
        """(B, ny) as the task's policies see it."""
        state = self._running.meet().numpy().astype(np.float64)
        policy: Any = self._case.policy
        seen: np.ndarray = policy.act(state, 0.0, self._numbers)
        felt = np.nan_to_num(self._running.felt()) if self._echo.senses else np.zeros((len(seen), 0))
        return np.concatenate([seen, felt], axis=1).astype(self.dtype)

    def __reduce__(self) -> Any:
        raise TypeError("an Environment cannot be copied or pickled; make another one of its task")

    def gymnasium(self) -> Any:
        """A `gymnasium.vector.VectorEnv` of it; some of Gymnasium's wrappers need autoreset="next_step".

        Raises:
            ImportError: Gymnasium is missing (extra `gym`).
        """
        from .gym import TaskVectorEnv  # it cannot be imported without Gymnasium

        return TaskVectorEnv(self)
