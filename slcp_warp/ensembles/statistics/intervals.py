"""Statistics of sweeps with confidence intervals (95 %)."""

import math

import numpy as np

from .moments import Z95, Moments

Interval = tuple[float, float, float]  # value, low, high


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


def quantile_interval(values: np.ndarray, q: float = 0.5) -> Interval:
    """A quantile and its distribution-free interval by order statistics.

    Infinite values count; NaN without values.
    """
    values = np.sort(values[~np.isnan(values)])
    if not len(values):
        return math.nan, math.nan, math.nan
    middle, low, high = (float(values[rank]) for rank in quantile_ranks(len(values), q))
    return middle, low, high


def quantile_ranks(n: int, q: float) -> tuple[int, int, int]:
    """Which of n sorted values are a quantile, and the ends of its interval."""
    half = Z95 * math.sqrt(n * q * (1.0 - q))
    middle, low, high = (
        min(n - 1, max(0, at)) for at in (int(n * q), math.floor(n * q - half), math.ceil(n * q + half))
    )
    return middle, low, high
