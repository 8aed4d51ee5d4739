"""What independent, unbiased estimates of a small share say together."""

import math

import numpy as np

# Student's t, two-sided 95 %, for 1, 2, ... degrees of freedom
T95 = (12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145,
       2.131, 2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048,
       2.045, 2.042)  # fmt: skip


def student(freedom: int) -> float:
    """The 97.5 % quantile of Student's t."""
    if freedom <= len(T95):
        return T95[freedom - 1]
    return 1.959964 + 2.3722 / freedom + 2.8225 / freedom**2


def island_interval(shares: np.ndarray) -> tuple[float, float, float]:
    """Mean of independent estimates and its 95 % interval: (mean, low, high).

    The interval is symmetric about the logarithm of the mean, with Student's factor on the relative standard
    error: products of many factors are skewed to the right, and a share is not negative. NaN without an
    estimate above 0, or of one alone.
    """
    mean, count = float(np.mean(shares)), len(shares)
    if count < 2 or mean <= 0.0:
        return mean, math.nan, math.nan
    relative = float(np.std(shares, ddof=1)) / math.sqrt(count) / mean
    factor = math.exp(student(count - 1) * relative)
    return mean, mean / factor, min(1.0, mean * factor)
