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
    """A share and its Wilson score interval: (share, low, high); NaN for total = 0."""
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


def spin_statistics(
    samples: np.ndarray, interval: float, window: float, threshold: float, kicks: tuple[float, ...]
) -> dict[str, np.ndarray]:
    """Rates of one observed coordinate.

    Args:
        samples: (B, S) coordinate at times 0, interval, ...
        window: of a rate [s].
        threshold: of "spinning" [1/s].
        kicks: times of kicks [s]; time 0 counts as one (the perturbed start).

    Returns:
        Columns (B,): rate over the whole time; late_rate over its second half, or from the last kick on
        if that is later; spinning (late_rate above threshold); recovery_time after the last kick: first time
        from which the rate over the next window exceeds the threshold, inf if never.
    """
    count = samples.shape[1]
    total = (count - 1) * interval
    last = max((0.0, *kicks))
    half = max(count // 2, round(last / interval))
    span = max(1, min(count - 1, round(window / interval)))
    moving = (samples[:, span:] - samples[:, :-span]) / (span * interval)
    begin = min(round(last / interval), moving.shape[1] - 1)
    after = moving[:, begin:] > threshold
    first = np.argmax(after, axis=1)
    return {
        "rate": (samples[:, -1] - samples[:, 0]) / total,
        "late_rate": (samples[:, -1] - samples[:, half]) / ((count - 1 - half) * interval),
        "spinning": (samples[:, -1] - samples[:, half]) / ((count - 1 - half) * interval) > threshold,
        "recovery_time": np.where(after.any(axis=1), first * interval, np.inf),
    }
