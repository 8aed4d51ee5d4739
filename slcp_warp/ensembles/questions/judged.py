"""Given worlds of a task under a policy, and what they are judged by."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ...inputs import checks
from ...inputs.errors import ArgumentError
from ...options import Options
from ...stepping.arguments import policy_arrays
from ...stepping.host import acts_on_host
from ...tasks.task import Task
from ..statistics.source import NOTED, Columns, joined
from ..statistics.starts import Starts
from ..tasks import TaskSweep, policies_by_name
from ..worlds import Worlds


class Judge:
    """Runs worlds of a task under one policy.

    Attributes:
        task: what is run.
        name: of the policy.
        done: worlds so far.
        starts: of these, which begin in overlap.
    """

    def __init__(
        self,
        task: Any,
        policy: Any,
        seed: int,
        case: Options | None,
        progress: Any,
        most: int | None = None,
        **choices: Any,
    ) -> None:
        """Args:
        seed: of the noise of single steps.
        case: options of the steps; None: the task's.
        progress: called with (worlds done, worlds in all).
        most: beyond every world's number; None: they may have any.
        choices: as of a `Simulator`.
        """
        self.task: Task = checks.instance("task", task, Task, "a slcp_warp.Task")
        named = policies_by_name(policy, self.task)
        if len(named) != 1:
            raise ArgumentError(f"policy is {checks.shown(policy)}; one is needed")
        ((self.name, self._policy),) = named.items()
        self._given = policy
        self._progress: Callable[[int, int], None] | None = checks.function("progress", progress, 2, True)
        self._choices = choices | {"seed": seed, "cases": task.options if case is None else case}
        self.done, self.starts, self._most = 0, Starts(), most
        self._check_policy()

    def use(self, policy: Any) -> None:
        """Go on with another policy, by the same name."""
        if policy is not self._given:
            self._given = policy
            ((_, self._policy),) = policies_by_name(policy, self.task).items()
            self._check_policy()

    def _check_policy(self) -> None:
        """Refuse what is no policy before anything is drawn."""
        one = TaskSweep(self.task, {self.name: self._policy}, worlds=1, **self._choices)
        if not acts_on_host(self._policy):
            policy_arrays(self._policy, next(iter(one.simulators.values())), self._most)

    def run(self, worlds: Worlds, total: int) -> Columns:
        """The rows of the worlds: what was drawn, measures, success, status; `total`: worlds in all."""
        work = TaskSweep(self.task, {self.name: self._policy}, worlds=worlds, **self._choices)
        part, pieces = work.chunks.parts[0], []  # the disturbed ones
        for world0 in range(0, part.worlds, part.at_once):
            pieces.append(work.rows(part, world0, min(part.at_once, part.worlds - world0)))
            self.done += len(pieces[-1]["world"])
            self.starts.add(pieces[-1][NOTED[0]], part.step_size)
            if self._progress is not None:
                self._progress(self.done, total)
        return joined(pieces)


def column(rows: Columns, measure: str) -> np.ndarray:
    """A measure's values, (B,); success as 0 and 1."""
    return np.asarray(rows[measure], float)
