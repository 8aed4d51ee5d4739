"""Statistics of sweeps with confidence intervals (95 %)."""

import math

import numpy as np

Z95 = 1.959963984540054


def mean_interval(values: np.ndarray) -> tuple[float, float, float]:
    """Mean of finite values and its normal-theory interval: (mean, low, high); NaN without values."""
    values = values[np.isfinite(values)]
    if not len(values):
        return math.nan, math.nan, math.nan
    mean = float(values.mean())
    half = Z95 * float(values.std(ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else math.nan
    return mean, mean - half, mean + half


def share_interval(successes: int, total: int) -> tuple[float, float, float]:
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


def quantile_interval(values: np.ndarray, q: float = 0.5) -> tuple[float, float, float]:
    """A quantile and its distribution-free interval by order statistics.

    Infinite values count; NaN without values.
    """
    values = np.sort(values[~np.isnan(values)])
    n = len(values)
    if n == 0:
        return math.nan, math.nan, math.nan
    half = Z95 * math.sqrt(n * q * (1.0 - q))
    low = values[max(0, math.floor(n * q - half))]
    high = values[min(n - 1, math.ceil(n * q + half))]
    return float(values[min(n - 1, int(n * q))]), float(low), float(high)
