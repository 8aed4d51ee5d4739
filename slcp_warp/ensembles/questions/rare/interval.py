"""What independent, unbiased estimates of a small share say together."""

import math

import numpy as np

# Student's t, two-sided 95 %, for 1, 2, ... degrees of freedom
T95 = (12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145,
       2.131, 2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048,
       2.045, 2.042)  # fmt: skip


def student(freedom: float) -> float:
    """The 97.5 % quantile of Student's t, between the table's by 1 / freedom."""
    if freedom < len(T95):
        below = int(freedom)
        share = (1.0 / below - 1.0 / freedom) * below * (below + 1)
        return (1.0 - share) * T95[below - 1] + share * T95[below]
    return 1.959964 + 2.3722 / freedom + 2.8225 / freedom**2


def freedom_of(values: np.ndarray) -> float:
    """Degrees of freedom of a sample's variance, fewer where the sample has a heavy tail; at least 2.

    The variance of a sample variance is s^4 (k / n - (n - 3) / (n (n - 1))), k the kurtosis; that of
    nu degrees of freedom has, 2 s^4 / nu, is set equal.
    """
    count = len(values)
    apart = (values - values.mean()) ** 2
    if not apart.any():
        return count - 1.0
    kurtosis = float((apart**2).mean() / apart.mean() ** 2)
    spread = kurtosis - (count - 3.0) / (count - 1.0)
    most = count - 1.0
    return most if spread * most <= 2.0 * count else max(min(2.0, most), 2.0 * count / spread)


def island_interval(shares: np.ndarray) -> tuple[float, float, float]:
    """Mean of independent estimates and its 95 % interval: (mean, low, high).

    The interval is symmetric about the logarithm of the mean, with Student's factor on the relative standard
    error: products of many factors are skewed to the right, and a share is not negative. A few islands that
    hold most of it tell less of their spread than as many equal ones (`freedom_of`). NaN without an estimate
    above 0, or of one alone.
    """
    mean, count = float(np.mean(shares)), len(shares)
    if count < 2 or mean <= 0.0:
        return mean, math.nan, math.nan
    relative = float(np.std(shares, ddof=1)) / math.sqrt(count) / mean
    factor = math.exp(student(freedom_of(np.asarray(shares, float))) * relative)
    return mean, mean / factor, min(1.0, mean * factor)
