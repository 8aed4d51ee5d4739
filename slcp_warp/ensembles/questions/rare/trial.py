"""Given worlds of a task under a policy: how they end."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ....inputs.checks import number, shown
from ....inputs.errors import ArgumentTypeError
from ....inputs.times import nearest_steps
from ....measures.reductions import Measure, first_time
from ....options import Options
from ....simulator import Simulator
from ....stepping.arguments import at_step_size, policy_arrays
from ....stepping.by_world import alike
from ....stepping.host import acts_on_host
from ....tasks.task import Task
from ...launch import worlds_at_once
from ...statistics.source import NOTED
from ...statistics.starts import Starts
from ...tasks import case_of, policy_of, succeeded
from ...worlds import Worlds
from ...worlds.between import observed
from ...worlds.draws import Given


class Ends(NamedTuple):
    """How B worlds ended.

    Attributes:
        values: (B, M) of the measures.
        success: (B,).
        status: (B,) as `slcp_warp.Status`.
        overlap: (B,) how deep rows overlap at the start, NaN: not known [m, rad].
    """

    values: np.ndarray
    success: np.ndarray
    status: np.ndarray
    overlap: np.ndarray


class Trial:
    """A task under a policy, in whatever worlds are asked for, in launches of bounded memory.

    Attributes:
        sim: whose steps they make.
        step_size: [s].
        worlds: run so far.
        starts: of these, which begin in overlap.
        alike: whether the policy acts by state and time alone in all worlds.

    Raises:
        ArrayError: a policy that has not got what any world's number asks for.
    """

    def __init__(
        self,
        task: Task,
        policy: Any,
        options: Options,
        measures: Sequence[Measure],
        *,
        seed: int = 0,
        step_size: float | None = None,
        dtype: str = "float32",
        device: Any = None,
        strategy: str = "auto",
        most: int | None = None,
    ) -> None:
        """Args:
        most: beyond every world's number; None: they may have any.
        """
        assert task.duration is not None
        size = task.scene.step_size if step_size is None else step_size
        self.step_size = number("step_size", size, 0.0, above=True)
        nearest_steps("Task.duration", task.duration, self.step_size)
        self.task, self.worlds, self.starts = task, 0, Starts()
        self.sim = Simulator(task.scene, options, device=device, dtype=dtype, strategy=strategy)
        judged = [*measures, *(() if task.success is None else task.success.parts())]
        judged += [] if task.failure is None else [first_time(task.failure)]
        self._judged, self._measures = list(dict.fromkeys(judged)), len(measures)
        policy = policy_of(task, policy)
        self.alike = alike(policy)
        if not acts_on_host(policy):
            policy_arrays(observed(at_step_size(policy, self.step_size), task), self.sim, most)
        given = Given(self.sim, task, Worlds(task.start[:1]), self.step_size)
        at_once = worlds_at_once(self.sim, (0, 0), len(self._judged), given.numbers)
        self._case = case_of(
            task, self.sim, policy, given, self._judged, self.step_size, worlds=1, seed=seed, chunk=at_once
        )

    def run(self, worlds: Worlds) -> Ends:
        """Run these worlds to their end."""
        case, count = self._case, len(worlds)
        case.draws = Given(self.sim, self.task, worlds, self.step_size)
        found = [case.launch(i, min(case.chunk, count - i)) for i in range(0, count, case.chunk)]
        values = np.concatenate([part["measures"] for part in found])
        status = np.concatenate([part["status"] for part in found])
        own = {measure: values[:, j] for j, measure in enumerate(self._judged)}
        self.worlds += count
        overlap = np.concatenate([part[NOTED[0]] for part in found])
        self.starts.add(overlap, self.step_size)
        return Ends(values[:, : self._measures], succeeded(self.task, own, status), status, overlap)


def checked_options(task: Task, case: Any) -> Options:
    """Options of the steps; None: the task's, of the hard problem."""
    if case is None:
        return task.options.with_residual("hard")
    if not isinstance(case, Options):
        raise ArgumentTypeError(f"case is {shown(case)}; slcp_warp.Options are needed")
    return case
