"""Sobol indices: which share of the variance of a result comes from which of its independent inputs.

The first-order index of an input is the share of the variance that goes when the input is known, its total
index the share that stays when all others are. Between them are its interactions with others.
"""

from typing import NamedTuple

import numpy as np

from .intervals import Interval

RESAMPLES = 500
EVENTS = 10  # rows at least that tell two values apart: fewer say nothing of those unseen


class Indices(NamedTuple):
    """Indices of inputs: (value, low, high) of each, with 95 % intervals.

    Attributes:
        first: of first order.
        total: of total order.
        variance: of the result.
        samples: rows that they are from.
    """

    first: list[Interval]
    total: list[Interval]
    variance: float
    samples: int


def sobol_indices(a: np.ndarray, b: np.ndarray, ab: np.ndarray, seed: int = 0) -> Indices:
    """Indices by the estimators of Saltelli et al. (2010) of first order and of Jansen (1999) of total order.

    The intervals are the 2.5 and 97.5 % quantiles of a bootstrap over the rows; of results of two values, as
    success, NaN where an input changes fewer than `EVENTS` of them, of first order where fewer that have the
    rarer value in B. Rows in which any result is not finite are left out.

    Args:
        a, b: (n,) results of independent inputs A and B.
        ab: (d, n) results where input j is that of B and the others are those of A.
        seed: of the bootstrap.
    """
    count = len(ab)
    whole = np.isfinite(a) & np.isfinite(b) & np.isfinite(ab).all(axis=0)
    a, b, ab = (np.asarray(each, float)[..., whole] for each in (a, b, ab))
    nothing = [(np.nan,) * 3] * count
    if len(a) < 2:
        return Indices(nothing, nothing, np.nan, len(a))
    few = _few(a, b, ab)
    centre = 0.5 * (a.mean() + b.mean())
    a, b, ab = a - centre, b - centre, ab - centre
    rows = np.vstack([0.5 * (a + b), 0.5 * (a * a + b * b), b * (ab - a), 0.5 * (ab - a) ** 2])
    known = rows.mean(axis=1)
    if not known[1] > known[0] ** 2:
        return Indices(nothing, nothing, 0.0, len(a))
    rng = np.random.default_rng(seed)
    drawn = np.empty((RESAMPLES, len(rows)))
    for r in range(RESAMPLES):
        times = np.bincount(rng.integers(len(a), size=len(a)), minlength=len(a))
        drawn[r] = rows @ times / len(a)
    value, resampled = _ratios(known[None], count)[0], _ratios(drawn, count)
    low, high = np.nanquantile(resampled, (0.025, 0.975), axis=0)
    low, high = (np.where(few, np.nan, side) for side in (low, high))
    intervals = [(float(v), float(lo), float(hi)) for v, lo, hi in zip(value, low, high)]
    return Indices(intervals[:count], intervals[count:], float(known[1] - known[0] ** 2), len(a))


def _few(a: np.ndarray, b: np.ndarray, ab: np.ndarray) -> np.ndarray:
    """(2 d,) whether too few rows tell something of an index, of first and of total order."""
    values, counts = np.unique(np.concatenate([a, b]), return_counts=True)
    if len(values) != 2:
        return np.zeros(2 * len(ab), dtype=bool)
    changed = ab != a
    seen = changed & (b == values[counts.argmin()])
    return np.concatenate([seen.sum(axis=1), changed.sum(axis=1)]) < EVENTS


def _ratios(means: np.ndarray, count: int) -> np.ndarray:
    """(R, 2 count) indices of first and of total order from (R, 2 + 2 count) means of the rows."""
    variance = means[:, 1] - means[:, 0] ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(variance[:, None] > 0.0, means[:, 2:] / variance[:, None], np.nan)
