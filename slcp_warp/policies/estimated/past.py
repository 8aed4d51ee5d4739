"""Readings that come late: what was believed is looked at again from when they were taken."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .extended import Belief


@dataclass
class Taken:
    """What sensors took at a time.

    Attributes:
        time: [s].
        before: what was believed then, before any of it.
        seen: (B, S), NaN where one was not read.
        there: (S,) which have come.
    """

    time: float
    before: Belief
    seen: np.ndarray
    there: np.ndarray


class Past:
    """Readings of the last while, of sensors some of which are late.

    Args:
        late: (S,) from a reading to when it is there [s].
        same: times that differ by less are one [s].
    """

    def __init__(self, late: np.ndarray, same: float) -> None:
        self._late, self._same = late, same
        self._taken: list[Taken] = []

    def believed(
        self,
        time: float,
        before: Belief,
        seen: np.ndarray,
        correct: Callable[[Belief, np.ndarray], Belief],
        until: Callable[[Belief, float, float], Belief],
    ) -> Belief:
        """What is believed at a time, with all that has come by then.

        Args:
            before: without what was taken now, and without what comes now.
            seen: (B, S) what is taken now, NaN where one is not read.
            correct, until: a filter's correction, and what it foretells between two times.
        """
        self._taken.append(Taken(time, before, seen, np.full(len(self._late), False)))
        first = len(self._taken) - 1
        for i, each in reversed(list(enumerate(self._taken))):
            there = self._late <= time - each.time + self._same
            there |= np.isnan(each.seen).all(axis=0)
            first = i if (there != each.there).any() else first
            each.there = there
        belief = before
        for i in range(first, len(self._taken)):
            each = self._taken[i]
            belief = correct(each.before, np.where(each.there, each.seen, np.nan))
            if i + 1 < len(self._taken):
                after = self._taken[i + 1]
                after.before = until(belief, each.time, after.time)
        while len(self._taken) > 1 and self._taken[0].there.all():
            self._taken.pop(0)
        return belief
