"""What candidates are compared by: success, or a measure or a number of theirs that is to be small."""

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np

from ....inputs import checks
from ....inputs.errors import ArgumentError
from ....measures.reductions import Measure
from ....tasks.task import Task
from ...statistics import mean_interval
from ...statistics.intervals import Interval
from ..axes import ITSELF

Cost = tuple[float, float, float]  # the first number counts most; less is better
SUCCESS = "success"


class Outcome(NamedTuple):
    """How B worlds went under a candidate.

    Attributes:
        success: (B,).
        margin: (B,) how far each is from failing, in no unit; 0 where a task has no success.
        value: (B,) what is to be small or large; NaN where a world has none.
    """

    success: np.ndarray
    margin: np.ndarray
    value: np.ndarray

    @property
    def share(self) -> float:
        """Of the worlds that succeed."""
        return float(self.success.mean())

    @property
    def middle(self) -> float:
        """A median of the margins: it says something where some are infinite (not solved)."""
        return float(np.sort(self.margin)[len(self.margin) // 2])


class Wanted:
    """The aim of a search.

    Attributes:
        name: of the measure or number that is to be small or large; None: success alone counts.
        measure: of that name; None: it is a number of the candidates' own.
        least: the share of worlds that have to succeed; None: any.
    """

    def __init__(
        self, task: Task, numbers: Collection[str], minimise: str | None, maximise: str | None, success: Any
    ) -> None:
        for label, given in (("minimise", minimise), ("maximise", maximise)):
            checks.instance(label, given, str | None, "a name, or None,")
        if minimise is not None and maximise is not None:
            raise ArgumentError("minimise and maximise are both given; one is needed")
        label, self.name = ("minimise", minimise) if maximise is None else ("maximise", maximise)
        if label == "maximise" and maximise == SUCCESS:
            self.name = None
        self._sign, self.measure = 1.0 if label == "minimise" else -1.0, self._measure(label, task, numbers)
        self.least = None if success is None else checks.number("success", success, 0.0, 1.0, above=True)
        judged = task.success is not None or task.failure is not None
        if self.least is not None and self.name is None:
            raise ArgumentError(
                "success is a share that is to be kept; minimise or maximise says what beside it"
            )
        if not judged and (self.name is None or self.least is not None):
            raise ArgumentError(
                f"task {task.name!r} has neither success nor failure, so that its worlds differ by measures "
                "alone; minimise or maximise, without success, is needed"
            )

    def _measure(self, label: str, task: Task, numbers: Collection[str]) -> Measure | None:
        if self.name is None:
            return None
        known = (*task.measures, *numbers)
        checks.choice(label, self.name, known)
        if known.count(self.name) > 1:
            raise ArgumentError(
                f"{label} is {self.name!r}, which is a measure and a number; other names are needed"
            )
        return task.measures.get(self.name)

    def cost(self, found: Outcome) -> Cost:
        """What is better costs less: with a least share first of all what keeps it, next what comes near;
        else worlds without a value cost most.
        """
        lost = 1.0 - found.share
        if self.name is None:
            return lost, -found.middle, 0.0
        value = self.value(found)[0]
        value = np.inf if np.isnan(value) else self._sign * value
        if self.least is None:
            return float(np.isnan(found.value).mean()), value, 0.0
        if found.share < self.least:
            return 1.0, lost, -found.middle
        return 0.0, value, lost

    def value(self, found: Outcome) -> Interval:
        """Mean of what is to be small or large, with a 95 % interval; NaN where success alone counts."""
        if self.name is None:
            return (float("nan"),) * 3
        return mean_interval(found.value)

    def words(self) -> str:
        """What is wanted, for people."""
        if self.name is None:
            return "most success"
        size = "least" if self._sign > 0.0 else "largest"
        kept = "" if self.least is None else f" with success in {100.0 * self.least:g} % of the worlds"
        return f"{size} {self.name.rstrip(ITSELF)}{kept}"


def ranks(costs: list[Cost]) -> list[float]:
    """Places of candidates, those that cost the same share one."""
    places = {cost: float(place) for place, cost in enumerate(sorted(set(costs)))}
    return [places[cost] for cost in costs]
