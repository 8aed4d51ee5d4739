"""Intervals that hold at all times at once: one may look after every world and stop when one likes.

A confidence sequence covers the value at every sample size together with the promised probability, so that a
comparison may stop as soon as its interval leaves zero. Two are here, for differences in paired worlds:

- of successes, differences of -1, 0 and 1: wealth of bets against a mean m, mixed over the sizes of the bets
  (Waudby-Smith and Ramdas 2024, "Estimating means of bounded random variables by betting"). It needs no
  approximation; at m = 0 it is Robbins's (1970) mixture for the sign of the pairs that differ.
- of means of measures, whose range nobody knows: the asymptotic confidence sequence of Waudby-Smith, Arbour,
  Sinha, Kennedy and Ramdas (2024), "Time-uniform central limit theory and asymptotic confidence sequences".

Those of `any_law.py`, of medians and of measures within bounds, hold whatever the law.
"""

import math

import numpy as np

from .any_law import RunningBoundedMean, RunningMedian
from .bets import log_wealth
from .intervals import Interval
from .moments import Moments
from .reductions import difference
from .source import Columns

EXPECTED = 1024  # worlds at which the interval of a measure is narrowest
STEPS = 40  # of a bisection
STATISTICS = ("mean", "median")


def paired_share_interval(gained: int, lost: int, worlds: int, error: float) -> Interval:
    """The difference of two shares of successes in the same worlds: (difference, low, high).

    Args:
        gained: worlds where the first succeeds alone.
        lost: worlds where the second does.
        worlds: in all.
        error: the probability that the true difference is ever outside.

    NaN without worlds.
    """
    if worlds == 0:
        return math.nan, math.nan, math.nan
    value = (gained - lost) / worlds
    low = _least(gained, lost, worlds, error)
    return value, low, -_least(lost, gained, worlds, error)


def _least(gained: int, lost: int, worlds: int, error: float) -> float:
    """The smallest mean that bets on a larger one have not made rich: their wealth falls with the mean."""
    low, high = -1.0, (gained - lost) / worlds
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        if log_wealth(middle, gained, lost, worlds) >= math.log(2.0 / error):
            low = middle
        else:
            high = middle
    return low


def running_mean_interval(moments: Moments, error: float, expected: int = EXPECTED) -> Interval:
    """The mean of independent values, from their moments so far: (mean, low, high).

    The coverage is asymptotic: it holds from some hundred worlds on where the values are not far from
    symmetric about their mean, and from later on the more of the mean is due to seldom, large values: before
    the first of these came nothing tells of them. Values that are all the same say nothing of their variance.

    Args:
        moments: of the values.
        error: the probability that the true mean is ever outside.
        expected: worlds at which the interval is narrowest in proportion.

    NaN for fewer than two values; infinitely wide where they do not vary.
    """
    if moments.count < 2:
        return moments.interval()
    if moments.squares == 0.0:
        return moments.mean, -math.inf, math.inf
    log = -2.0 * math.log(error)
    rho = (log + math.log(log + 1.0)) / expected  # the square of the paper's rho, its (2.9)
    t = moments.count
    inside = (t * rho + 1.0) / (t * t * rho) * (math.log(t * rho + 1.0) + log)
    half = math.sqrt(moments.squares / t * inside)
    return moments.mean, moments.mean - half, moments.mean + half


class RunningDifference:
    """The difference of two policies in the same worlds, looked at as often as one likes.

    Attributes:
        measure: its column; "success" counts as 0 and 1.
        error: the probability that the true difference is ever outside of `interval`.
        statistic: "mean", or "median": of the differences world by world.
        bounds: of the measure, for its mean: what is beyond counts as the bound. None: there are none.
        worlds: so far, where both are numbers; of a mean without bounds finite ones.
    """

    def __init__(
        self,
        measure: str,
        error: float,
        statistic: str = "mean",
        bounds: tuple[float, float] | None = None,
    ) -> None:
        self.measure, self.error, self.worlds = measure, error, 0
        self.statistic, self.bounds = statistic, bounds
        self._gained = self._lost = 0
        self._moments, self._median = Moments(), RunningMedian(error)
        width = 0.0 if bounds is None else bounds[1] - bounds[0]
        self._bounded = RunningBoundedMean(-width, width, error)

    def add(self, first: Columns, second: Columns) -> None:
        """Take the next worlds, the same rows of both."""
        a, b = first[self.measure], second[self.measure]
        if self.statistic == "median" or self.bounds is not None:
            self._add_any(np.asarray(a, float), np.asarray(b, float))
            return
        apart = difference(a, b)
        self.worlds += len(apart)
        if self.measure == "success":
            self._gained += int(np.count_nonzero(apart > 0.0))
            self._lost += int(np.count_nonzero(apart < 0.0))
        else:
            self._moments += Moments.of(apart)

    def _add_any(self, a: np.ndarray, b: np.ndarray) -> None:
        """Infinite values are numbers here: those of the same sign do not differ."""
        both = ~np.isnan(a) & ~np.isnan(b)
        a, b = a[both], b[both]
        self.worlds += len(a)
        if self.bounds is not None:
            a, b = np.clip(a, *self.bounds), np.clip(b, *self.bounds)
        with np.errstate(invalid="ignore"):
            apart = np.where(a == b, 0.0, a - b)
        known = self._median if self.statistic == "median" else self._bounded
        known.add(apart)

    def interval(self) -> Interval:
        """First less second: (mean or median, low, high)."""
        if self.statistic == "median":
            return self._median.interval()
        if self.bounds is not None:
            return self._bounded.interval()
        if self.measure == "success":
            return paired_share_interval(self._gained, self._lost, self.worlds, self.error)
        return running_mean_interval(self._moments, self.error)
