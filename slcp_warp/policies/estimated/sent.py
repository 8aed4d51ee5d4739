"""Controls that have been sent, by the times at which they act."""

from collections.abc import Iterator

import numpy as np


class Sent:
    """The controls of some worlds from when they act on, until the next one does.

    Args:
        before: (B, nu) that act until the first that is sent.
        late: from a control to its action [s].
        same: times that differ by less are one [s].
        past: for how long what acted is remembered [s].
    """

    def __init__(self, before: np.ndarray, late: float, same: float, past: float = 0.0) -> None:
        self._late, self._same, self._past = late, same, past
        self._acting: list[tuple[float, np.ndarray]] = [(-np.inf, before)]  # from when on, which

    def send(self, time: float, u: np.ndarray) -> None:
        """One more is sent."""
        begins = time + self._late
        old = [i for i, (at, _) in enumerate(self._acting) if at <= time - self._past + self._same]
        self._acting = [*self._acting[old[-1] if old else 0 :], (begins, u)]

    def acting(self, begin: float, end: float) -> Iterator[tuple[np.ndarray, float]]:
        """What acts between two times, and for how long [s]."""
        ends = [at for at, _ in self._acting[1:]] + [np.inf]
        for (at, u), until in zip(self._acting, ends):
            first, last = max(at, begin), min(until, end)
            if last > first + self._same:
                yield u, last - first
