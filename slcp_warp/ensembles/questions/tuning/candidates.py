"""A policy or a design with some numbers, in worlds that all candidates share."""

from typing import Any

import numpy as np

from ....options import Options, Status
from ....tasks.task import Task
from ...worlds import Worlds
from ..axes import ITSELF, changed
from ..made import made
from ..rare.margin import Margin
from ..rare.trial import Trial
from .ranges import Ranges
from .wanted import Outcome, Wanted


class Candidates:
    """Runs what numbers make of a task.

    Attributes:
        done: worlds that were run.
    """

    def __init__(
        self, task: Task, policy: Any, ranges: Ranges, wanted: Wanted, case: Options, choices: dict[str, Any]
    ) -> None:
        """Args:
        policy: made from numbers, if the ranges have any of a policy's.
        choices: as of a `Trial`: dtype, device, strategy.
        """
        self._task, self._given, self._ranges, self._wanted = task, policy, ranges, wanted
        self._case, self._choices, self.done = case, choices, 0
        self._margin = None if task.success is None else Margin(task)
        measures = [] if self._margin is None else list(self._margin.measures)
        measures += [] if wanted.measure is None else [wanted.measure]
        self._measures = list(dict.fromkeys(measures))

    def policy(self, numbers: np.ndarray) -> Any:
        """The policy of these numbers (n,)."""
        return made(self._given, self.by_name(numbers[: self._ranges.own]))

    def by_name(self, numbers: np.ndarray) -> dict[str, float]:
        """The first of the numbers by their names."""
        return {name: float(value) for name, value in zip(self._ranges.names, numbers)}

    def run(self, numbers: np.ndarray, worlds: Worlds, seed: int) -> Outcome:
        """How the worlds go with these numbers (n,); `seed`: of the noise of single steps."""
        how: dict[str, Any] = {"most": len(worlds), "seed": seed} | self._choices
        trial = Trial(self._task, self.policy(numbers), self._case, self._measures, **how)
        found = trial.run(self._with(numbers, worlds))
        self.done, self.starts = self.done + len(worlds), trial.starts
        own = {measure: found.values[:, j] for j, measure in enumerate(self._measures)}
        margin = np.zeros(len(worlds))
        if self._margin is not None:
            values = np.stack([own[measure] for measure in self._margin.measures], axis=1)
            if not self._margin.fitted:
                self._margin.fit(values)
            margin = np.where(found.status == Status.SOLVED, self._margin(values, found.success), -np.inf)
        return Outcome(found.success, margin, self._value(numbers, own, found.status))

    def _with(self, numbers: np.ndarray, worlds: Worlds) -> Worlds:
        """The worlds with the task's numbers among these; factors are on what is given itself."""
        design = zip(self._ranges.names[self._ranges.own :], numbers[self._ranges.own :])
        for name, value in sorted(design, key=lambda each: not each[0].endswith(ITSELF)):
            worlds = changed(self._task, worlds, name, np.full(len(worlds), value))
        return worlds

    def _value(self, numbers: np.ndarray, own: dict[Any, np.ndarray], status: np.ndarray) -> np.ndarray:
        if self._wanted.name is None:
            return np.full(len(status), np.nan)
        if self._wanted.measure is None:
            return np.full(len(status), numbers[self._ranges.names.index(self._wanted.name)])
        values = own[self._wanted.measure]
        return np.where((status == Status.SOLVED) & np.isfinite(values), values, np.nan)
