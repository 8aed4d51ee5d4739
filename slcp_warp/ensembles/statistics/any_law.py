"""Intervals that hold at all times at once, whatever the law of the values: of a median, of a truncated mean.

No interval holds for the mean of values of which nothing is known: a world in a million may decide it. A
median is not decided by few worlds, and a mean is known once its values are kept within bounds:

- the median lies where neither too many values are below it nor above it, judged by bets on one side of it,
  as of successes (`bets.py`); Howard and Ramdas (2022), "Sequential estimation of quantiles with applications
  to A/B testing and best-arm identification", has the principle;
- of values within bounds the predictable plug-in empirical-Bernstein sequence of Waudby-Smith and Ramdas
  (2024), "Estimating means of bounded random variables by betting", their theorem 2.
"""

import math

import numpy as np

from .bets import log_wealth
from .intervals import Interval

SURE = 0.5  # the largest weight of a value, their c


class RunningMedian:
    """The median of values that keep coming; infinite ones count, NaN do not.

    Attributes:
        error: the probability that the true median is ever outside of `interval`.
    """

    def __init__(self, error: float) -> None:
        self.error = error
        self._values: list[np.ndarray] = []

    def add(self, values: np.ndarray) -> None:
        """Take the next ones."""
        self._values.append(values[~np.isnan(values)])

    def interval(self) -> Interval:
        """(median, low, high); infinitely wide before there are enough, NaN without values."""
        values = np.sort(np.concatenate([np.empty(0), *self._values]))
        count = len(values)
        if not count:
            return math.nan, math.nan, math.nan
        rank = rank_above(count, self.error)
        low, high = (values[count - rank], values[rank - 1]) if rank <= count else (-math.inf, math.inf)
        return float(0.5 * (values[(count - 1) // 2] + values[count // 2])), float(low), float(high)


def rank_above(count: int, error: float) -> int:
    """How many of so many values, if they are below a number, prove the median to be; count + 1: none do."""
    low, high = count // 2, count + 1
    while high - low > 1:
        middle = (low + high) // 2
        if log_wealth(0.0, middle, count - middle, count) >= math.log(2.0 / error):
            high = middle
        else:
            low = middle
    return high


class RunningBoundedMean:
    """The mean of values within bounds that keep coming.

    Attributes:
        low, high: the bounds; values beyond count as the bound, NaN do not count.
        error: the probability that the true mean (of the values so bounded) is ever outside of `interval`.
        count: values so far.
    """

    def __init__(self, low: float, high: float, error: float) -> None:
        self.low, self.high, self.error, self.count = low, high, error, 0
        self._sum = self._squares = 0.0  # of the values in [0, 1], and of their distances from the means
        self._weights = self._weighted = self._spent = 0.0

    def add(self, values: np.ndarray) -> None:
        """Take the next ones; each is weighted by what those before it say."""
        values = values[~np.isnan(values)]
        if not len(values):
            return
        x = (np.clip(values, self.low, self.high) - self.low) / (self.high - self.low)
        i = self.count + np.arange(1, len(x) + 1)
        sums = self._sum + np.cumsum(x)
        before, after = (0.5 + sums - x) / i, (0.5 + sums) / (i + 1)
        squares = self._squares + np.cumsum((x - after) ** 2)
        variance = (0.25 + np.concatenate([[self._squares], squares[:-1]])) / i
        weight = np.minimum(np.sqrt(2.0 * math.log(2.0 / self.error) / (variance * i * np.log1p(i))), SURE)
        self._weights += float(weight.sum())
        self._weighted += float((weight * x).sum())
        self._spent += float(((x - before) ** 2 * (-np.log1p(-weight) - weight)).sum())
        self.count, self._sum, self._squares = int(i[-1]), float(sums[-1]), float(squares[-1])

    def interval(self) -> Interval:
        """(mean, low, high): the plain mean, and an interval about the weighted one; NaN without values."""
        if not self.count:
            return math.nan, math.nan, math.nan
        width = self.high - self.low
        middle = self._weighted / self._weights
        half = (math.log(2.0 / self.error) + self._spent) / self._weights
        low, high = (self.low + width * min(1.0, max(0.0, end)) for end in (middle - half, middle + half))
        return self.low + width * self._sum / self.count, low, high
