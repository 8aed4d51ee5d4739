"""Sensitivity from the rows of a sweep that is there: indices of first order, without running anything.

By what was drawn the worlds are sorted into bins, of equal size in the first block, and what the bins leave
of the variance is compared with the whole one (Plischke, Borgonovo and Smith 2013, "Global sensitivity
measures from given data"), less what they take by chance (epsilon squared, Kelley 1935). A bin takes a line,
not a mean alone: the slope of a function within the bins, widest at the ends of what is drawn, made the index
of what matters most too low (.600 for .631 with 400 worlds, and 81 intervals of a hundred held it). What
bends within a bin is missed: there are more bins where there are more worlds. The intervals are from a
jackknife over groups of worlds.
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
    middles = known[((np.arange(len(edges) + 1) + 0.5) * len(known) / (len(edges) + 1)).astype(int)]
    width = known[-1] - known[0] or 1.0
    centre = sum((Moments.of(block[measure]) for block in source.blocks(key, (measure,))), Moments()).mean
    sums = np.zeros((GROUPS, len(edges) + 1, 6))
    for block in source.blocks(key, (drawn, measure)):
        place = np.searchsorted(edges, block[drawn], side="left")
        along = (block[drawn] - middles[place]) / width
        sums += _sums(block["world"], place, along, np.asarray(block[measure], float) - centre, len(middles))
    value, low, high = _interval(sums)
    if measure == "success":
        good = sum(float(np.nansum(block[measure])) for block in source.blocks(key, (measure,)))
        if min(good, source.worlds(key) - good) < RARE:
            return value, math.nan, math.nan
    return value, low, high


def _sums(
    world: np.ndarray, place: np.ndarray, along: np.ndarray, values: np.ndarray, bins: int
) -> np.ndarray:
    """(GROUPS, bins, 6) of a block: counts, sums of the values y and of y^2, of x along the bin, x^2, x y."""
    finite = np.isfinite(values)
    place = ((world % GROUPS) * bins + place)[finite]
    x, y = along[finite], values[finite]
    size = GROUPS * bins
    columns = [np.bincount(place, minlength=size)]
    columns += [np.bincount(place, each, minlength=size) for each in (y, y * y, x, x * x, x * y)]
    return np.stack(columns, axis=-1).reshape(GROUPS, bins, 6)


def _interval(sums: np.ndarray) -> Interval:
    total = sums.sum(axis=0)
    value = _index(total)
    if not math.isfinite(value):
        return math.nan, math.nan, math.nan
    without = np.array([_index(total - group) for group in sums if group[:, 0].any()])
    half = Z95 * math.sqrt((len(without) - 1) * without.var())
    return value, value - half, value + half


def _index(sums: np.ndarray) -> float:
    """1 - variance beside the bins' lines / variance, both unbiased, of (bins, 6) sums."""
    sums = sums[sums[:, 0] > 0]
    n, y, yy, x, xx, xy = sums.T
    count, total, squares = n.sum(), y.sum(), yy.sum()
    spread, slope = xx - x**2 / n, xy - x * y / n
    leans = (spread > 1e-12 * xx) & (n > 2)  # of others, as of what is drawn from a few numbers, the mean
    free = count - len(sums) - leans.sum()
    if free <= 0:
        return math.nan
    within = (squares - (y**2 / n).sum() - (slope[leans] ** 2 / spread[leans]).sum()) / free
    variance = (squares - total**2 / count) / (count - 1)
    return float(1.0 - within / variance) if variance > 1e-12 * squares / count else math.nan
