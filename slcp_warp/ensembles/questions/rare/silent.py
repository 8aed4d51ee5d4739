"""Conditions of a margin that say nothing until a world fails by them: no level leads there."""

import numpy as np

from ....measures.reductions import Measure
from ....tasks.task import Task
from .margin import Margin


class Silent:
    """Measures of a margin, and whether each was the same in all worlds that succeeded.

    The time of what never happens there is infinite in all of them: its distance from failing does not fall
    before the world fails, and a failure by it is met by chance alone.

    Args:
        task: a `failure` of it is silent, too, under a margin of the success.
        judge: whose measures are looked at; those of a comparison.
    """

    def __init__(self, task: Task, judge: Margin) -> None:
        self._measures = judge.measures
        self._parts = [] if isinstance(judge.given, Measure) else judge.joined.parts()
        self._more = ("failure",) if judge.given is None and task.failure is not None else ()
        self._low = np.full(len(judge.measures), np.inf)
        self._high = np.full(len(judge.measures), -np.inf)

    def look(self, values: np.ndarray, succeeded: np.ndarray) -> None:
        """Look at (B, M) values of the measures of worlds, of which some succeeded."""
        if succeeded.any():
            self._low = np.fmin(self._low, np.fmin.reduce(values[succeeded]))
            self._high = np.fmax(self._high, np.fmax.reduce(values[succeeded]))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the conditions that said nothing so far."""
        same = {each for each, low, high in zip(self._measures, self._low, self._high) if not low < high}
        return (*(repr(each) for each in self._parts if each in same), *self._more)
