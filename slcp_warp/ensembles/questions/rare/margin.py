"""How far a world is from failing: a continuous number of its measures, above 0 where it succeeds."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ....inputs.checks import shown
from ....inputs.errors import ArgumentError, ArgumentTypeError
from ....measures.reductions import Measure, Success
from ....measures.signals import Within
from ....tasks.task import Task

LEAST = np.finfo(float).tiny  # margin of a world that succeeds, at least


class Margin:
    """The margin of a task's worlds, from its success or from what a user names.

    Of a comparison it is the distance to the nearer bound, of comparisons joined by & the smallest, by | the
    largest. Where several are joined, each distance is in standard deviations of its measure (`fit`).
    A world that fails has a margin of at most 0, one that succeeds a margin above 0, whatever is given.

    Args:
        task: whose success says which worlds fail.
        given: None: the task's success; another comparison of measures; or a measure, which falls towards
            failing.

    Attributes:
        measures: what is to be measured, the success's first.
        fitted: whether standard deviations were taken.

    Raises:
        ArgumentError: a task without a success: no margin leads to what fails then.
    """

    def __init__(self, task: Task, given: Success | Measure | None = None) -> None:
        if given is not None and not isinstance(given, Success | Measure):
            raise ArgumentTypeError(
                f"margin is {shown(given)}; a measure, or a comparison of measures, is needed"
            )
        if task.success is None:
            raise ArgumentError(
                f"task {task.name!r} has no success, so that no measure says how far a world is from failing"
            )
        self.success, self.given = task.success, given
        own = given if isinstance(given, Success) else task.success
        self.measures: list[Measure] = list(
            dict.fromkeys([*task.success.parts(), *([given] if isinstance(given, Measure) else own.parts())])
        )
        self._scale: dict[Measure, float] = {}
        self.fitted = False

    def fit(self, values: np.ndarray) -> None:
        """Take standard deviations from (B, M) values of the measures."""
        self.fitted = True
        joined = self.given if isinstance(self.given, Success) else self.success
        if sum(len(clause) for clause in joined.clauses) == 1:
            return
        for j, measure in enumerate(self.measures):
            finite = values[np.isfinite(values[:, j]), j]
            spread = float(finite.std()) if finite.size else 0.0
            self._scale[measure] = spread if spread > 0.0 else 1.0

    def __call__(self, values: np.ndarray, succeeded: np.ndarray) -> np.ndarray:
        """Margins (B,) of (B, M) values of the measures; `succeeded` (B,): by the task's success and status.

        A world without a number (not solved) has -inf.
        """
        own = {measure: values[:, j] for j, measure in enumerate(self.measures)}
        if isinstance(self.given, Measure):
            margin = own[self.given]
        else:
            margin = self._joined(self.success if self.given is None else self.given, own)
        margin = np.where(np.isnan(margin), -np.inf, margin)
        return np.where(succeeded, np.maximum(margin, LEAST), np.minimum(margin, 0.0))

    def active(self, values: dict[Measure, np.ndarray]) -> tuple[np.ndarray, list[tuple[Measure, float]]]:
        """Margins (K,) as the measures alone have them, and for each world the measure that it is of, with
        the margin's slope by it.
        """
        if isinstance(self.given, Measure):
            return values[self.given], [(self.given, 1.0)] * len(values[self.given])
        joined = self.success if self.given is None else self.given
        margin = self._joined(joined, values)
        found: list[tuple[Measure, float]] = []
        for k in range(len(margin)):
            own = {measure: values[measure][k : k + 1] for measure in values}
            clause = max(joined.clauses, key=lambda each: min(float(self._distance(w, own)[0]) for w in each))
            within = min(clause, key=lambda each: float(self._distance(each, own)[0]))
            low, high = within.distances(float(own[within.of][0]))
            lower, scale = low <= high, self._scale.get(within.of, 1.0)
            found.append((within.of, (1.0 if lower else -1.0) / scale))
        return margin, found

    def _distance(self, within: Within, own: dict[Any, np.ndarray]) -> np.ndarray:
        return np.asarray(np.minimum(*within.distances(own[within.of])) / self._scale.get(within.of, 1.0))

    def _joined(self, success: Success, own: dict[Any, np.ndarray]) -> np.ndarray:
        return over(success.clauses, lambda within: self._distance(within, own))


def over(clauses: Sequence[Sequence[Within]], distance: Callable[[Within], np.ndarray]) -> np.ndarray:
    """The largest over the clauses of the smallest of a clause's distances."""
    return np.max([np.min([distance(within) for within in clause], axis=0) for clause in clauses], axis=0)
