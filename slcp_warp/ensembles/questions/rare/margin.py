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
LOWEST = np.finfo(float).min  # the same where a margin goes on falling below 0


class Margin:
    """The margin of a task's worlds, from its success or from what a user names.

    Of a comparison it is the distance to the nearer bound, of comparisons joined by & the smallest, by | the
    largest. Where several are joined, each distance is in standard deviations of its measure (`fit`).
    A world that fails has a margin of at most 0, one that succeeds a margin above 0, whatever is given. As a
    `score` what is given goes on falling below 0 in worlds that succeed.

    Args:
        task: whose success says which worlds fail.
        given: None: the task's success; another comparison of measures; or a measure, which falls towards
            failing.

    Attributes:
        measures: what is to be measured, the success's first.
        fitted: whether standard deviations were taken.
        event: scores at or below it are of worlds that fail.
        joined: the comparisons whose distances count, where no measure is given.

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
        self.event = 0.0 if given is None else -np.inf
        self.joined: Success = given if isinstance(given, Success) else task.success
        more = [given] if isinstance(given, Measure) else self.joined.parts()
        self.measures: list[Measure] = list(dict.fromkeys([*task.success.parts(), *more]))
        self._scale: dict[Measure, float] = {}
        self.fitted = False

    def fit(self, values: np.ndarray) -> None:
        """Take standard deviations from (B, M) values of the measures."""
        self.fitted = True
        if sum(len(clause) for clause in self.joined.clauses) == 1:
            return
        for j, measure in enumerate(self.measures):
            finite = values[np.isfinite(values[:, j]), j]
            spread = float(finite.std()) if finite.size else 0.0
            self._scale[measure] = spread if spread > 0.0 else 1.0

    def __call__(self, values: np.ndarray, succeeded: np.ndarray) -> np.ndarray:
        """Margins (B,) of (B, M) values of the measures; `succeeded` (B,): by the task's success and status.

        A world without a number (not solved) has -inf.
        """
        return np.where(succeeded, np.maximum(self._of(values), LEAST), np.minimum(self._of(values), 0.0))

    def score(self, values: np.ndarray, succeeded: np.ndarray) -> np.ndarray:
        """Margins (B,) that levels can descend: at most `event` where a world fails, above it elsewhere.

        The bound of what is given need not be where the task fails, and what is beyond it is not all alike.
        """
        if self.given is None:
            return self(values, succeeded)
        return np.where(succeeded, np.maximum(self._of(values), LOWEST), self.event)

    def _of(self, values: np.ndarray) -> np.ndarray:
        own = {measure: values[:, j] for j, measure in enumerate(self.measures)}
        margin = own[self.given] if isinstance(self.given, Measure) else self._joined(own)
        return np.where(np.isnan(margin), -np.inf, margin)

    def active(self, values: dict[Measure, np.ndarray]) -> tuple[np.ndarray, list[tuple[Measure, float]]]:
        """Margins (K,) as the measures alone have them, and for each world the measure that it is of, with
        the margin's slope by it.
        """
        if isinstance(self.given, Measure):
            return values[self.given], [(self.given, 1.0)] * len(values[self.given])
        margin = self._joined(values)
        found: list[tuple[Measure, float]] = []
        for k in range(len(margin)):
            own = {measure: values[measure][k : k + 1] for measure in values}
            clause = max(
                self.joined.clauses, key=lambda each: min(float(self._distance(w, own)[0]) for w in each)
            )
            within = min(clause, key=lambda each: float(self._distance(each, own)[0]))
            low, high = within.distances(float(own[within.of][0]))
            lower, scale = low <= high, self._scale.get(within.of, 1.0)
            found.append((within.of, (1.0 if lower else -1.0) / scale))
        return margin, found

    def _distance(self, within: Within, own: dict[Any, np.ndarray]) -> np.ndarray:
        return np.asarray(np.minimum(*within.distances(own[within.of])) / self._scale.get(within.of, 1.0))

    def _joined(self, own: dict[Any, np.ndarray]) -> np.ndarray:
        return over(self.joined.clauses, lambda within: self._distance(within, own))


def over(clauses: Sequence[Sequence[Within]], distance: Callable[[Within], np.ndarray]) -> np.ndarray:
    """The largest over the clauses of the smallest of a clause's distances."""
    return np.max([np.min([distance(within) for within in clause], axis=0) for clause in clauses], axis=0)
