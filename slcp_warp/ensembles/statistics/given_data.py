"""Sensitivity from the rows of a sweep that is there: indices of first order, without running anything.

By what was drawn the worlds are sorted into bins, of equal size in the first block, and the variance of the
bins' means is compared with the whole one (Plischke, Borgonovo and Smith 2013, "Global sensitivity measures
from given data"), less what the means vary by chance (epsilon squared, Kelley 1935). What a function varies
within a bin is missed: there are more bins where there are more worlds. The intervals are from a jackknife
over groups of worlds.
"""

import math

import numpy as np

from .intervals import Interval
from .moments import Z95, Moments
from .source import Key, Source

GROUPS = 64
MOST = 256  # bins
FEWEST = 8  # worlds of the first block in a bin
RARE = 50  # worlds that succeed, or fail, at least for an interval


def first_order(source: Source, key: Key, drawn: str, measure: str) -> Interval:
    """The index of a drawn column for a column of results: (value, low, high), a 95 % interval.

    Over the worlds where the result is finite; NaN where it does not vary, or with too few worlds; an
    interval of NaN for success where fewer than `RARE` worlds succeed or fail.
    """
    known = np.sort(next(source.blocks(key, (drawn,)), {drawn: np.zeros(0)})[drawn])
    bins = min(MOST, int(0.5 * math.sqrt(source.worlds(key))), len(known) // FEWEST)
    if bins < 2:
        return math.nan, math.nan, math.nan
    edges = np.unique(known[np.arange(1, bins) * len(known) // bins])
    centre = sum((Moments.of(block[measure]) for block in source.blocks(key, (measure,))), Moments()).mean
    sums = np.zeros((GROUPS, len(edges) + 1, 3))
    for block in source.blocks(key, (drawn, measure)):
        sums += _sums(block["world"], block[drawn], np.asarray(block[measure], float) - centre, edges)
    value, low, high = _interval(sums)
    if measure == "success":
        good = sum(float(np.nansum(block[measure])) for block in source.blocks(key, (measure,)))
        if min(good, source.worlds(key) - good) < RARE:
            return value, math.nan, math.nan
    return value, low, high


def _sums(world: np.ndarray, drawn: np.ndarray, values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """(GROUPS, bins, 3) count, sum and sum of squares of a block's values."""
    finite = np.isfinite(values)
    place = (world % GROUPS) * (len(edges) + 1) + np.searchsorted(edges, drawn, side="left")
    place, values = place[finite], values[finite]
    size = GROUPS * (len(edges) + 1)
    columns = [np.bincount(place, minlength=size)]
    columns += [np.bincount(place, each, minlength=size) for each in (values, values * values)]
    return np.stack(columns, axis=-1).reshape(GROUPS, -1, 3)


def _interval(sums: np.ndarray) -> Interval:
    total = sums.sum(axis=0)
    value = _index(total)
    if not math.isfinite(value):
        return math.nan, math.nan, math.nan
    without = np.array([_index(total - group) for group in sums if group[:, 0].any()])
    half = Z95 * math.sqrt((len(without) - 1) * without.var())
    return value, value - half, value + half


def _index(sums: np.ndarray) -> float:
    """1 - variance within the bins / variance, both unbiased, of (bins, 3) sums."""
    sums = sums[sums[:, 0] > 0]
    count, total, squares = sums.sum(axis=0)
    if count <= len(sums):
        return math.nan
    within = (squares - (sums[:, 1] ** 2 / sums[:, 0]).sum()) / (count - len(sums))
    variance = (squares - total**2 / count) / (count - 1)
    return float(1.0 - within / variance) if variance > 1e-12 * squares / count else math.nan
