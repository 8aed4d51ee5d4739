"""Statistics of sweeps with confidence intervals (95 %)."""

import math

import numpy as np

from .moments import Z95, Moments

Interval = tuple[float, float, float]  # value, low, high
TAIL = 0.025  # probability beyond either end
WIDE, SPARE = 9.0, 60.0  # standard deviations, and counts, beyond which a binomial law is nothing


def mean_interval(values: np.ndarray) -> Interval:
    """Mean of finite values and its normal-theory interval: (mean, low, high); NaN without values."""
    return Moments.of(values).interval()


def share_interval(successes: int, total: int) -> Interval:
    """A share and its Wilson score interval (M42): (share, low, high); NaN for total = 0."""
    if total == 0:
        return math.nan, math.nan, math.nan
    p = successes / total
    z2 = Z95 * Z95 / total
    centre = (p + z2 / 2.0) / (1.0 + z2)
    half = Z95 * math.sqrt(p * (1.0 - p) / total + z2 / (4.0 * total)) / (1.0 + z2)
    low = 0.0 if successes == 0 else max(0.0, centre - half)
    high = 1.0 if successes == total else min(1.0, centre + half)
    return p, low, high


def shares_interval(first: int, second: int, total: int) -> Interval:
    """A difference of shares of the same worlds: (difference, low, high), after Agresti and Min (2005) (M51).

    Args:
        first, second: worlds that count for the first share alone, and for the second alone.
        total: worlds; NaN for 0.
    """
    if total == 0:
        return math.nan, math.nan, math.nan
    n = total + 2.0
    centre = (first - second) / n
    half = Z95 * math.sqrt((first + second + 1.0) / n - centre * centre) / math.sqrt(n)
    return (first - second) / total, max(-1.0, centre - half), min(1.0, centre + half)


def quantile_interval(values: np.ndarray, q: float = 0.5) -> Interval:
    """A quantile and its distribution-free interval by order statistics, as of `quantile_ranks`.

    Infinite values count; NaN without values.
    """
    values = np.sort(values[~np.isnan(values)])
    if not len(values):
        return math.nan, math.nan, math.nan
    ends = np.concatenate([[-math.inf], values, [math.inf]])
    middle, low, high = (float(ends[rank + 1]) for rank in quantile_ranks(len(values), q))
    return middle, low, high


def quantile_ranks(n: int, q: float) -> tuple[int, int, int]:
    """Which of n sorted values are a quantile, and the ends of its interval; -1 and n: no value is far enough
    out, that end is infinite.

    A value is too low an end with the probability that fewer than so many of n values are below the
    quantile, Bin(n, q), which is at most 2.5 % on either side.
    """
    low = _largest_below(n, q, TAIL)
    high = n - 1 - _largest_below(n, 1.0 - q, TAIL)
    return min(n - 1, int(n * q)), low, high


def _largest_below(n: int, q: float, tail: float) -> int:
    """The largest k with P(X <= k) <= tail for X of Bin(n, q); -1: there is none."""
    if q <= 0.0:
        return -1
    if q >= 1.0:
        return n - 1
    spread = WIDE * math.sqrt(n * q * (1.0 - q)) + SPARE
    first, last = max(0, math.floor(n * q - spread)), min(n, math.ceil(n * q + spread))
    k = np.arange(first, last, dtype=float)
    ratios = np.log((n - k) / (k + 1.0)) + math.log(q) - math.log1p(-q)  # of P(X = k + 1) and P(X = k)
    weights = np.concatenate([[0.0], np.cumsum(ratios)])
    shares = np.exp(weights - weights.max())
    below = np.cumsum(shares) / shares.sum()
    return first - 1 + int(np.count_nonzero(below <= tail))
