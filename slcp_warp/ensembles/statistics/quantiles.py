"""Quantiles of a stream, exactly and in constant memory: the digits of the wanted values, 16 bits a pass."""

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from .intervals import Interval, quantile_ranks

DIGITS, BITS = 4, 16  # passes, and bits of a double that each finds
SIZE = 1 << BITS
_SIGN = np.uint64(1 << 63)

Stream = Callable[[], Iterable[np.ndarray]]


def quantile_intervals(stream: Stream, probabilities: Sequence[float]) -> list[Interval]:
    """Quantiles and their intervals by order statistics, as `quantile_interval` of all values at once.

    Args:
        stream: gives the values, in pieces of any length; it is asked four times.
        probabilities: in [0, 1].

    Returns:
        (value, low, high) for each: values of the stream, without any error; infinite ones count, NaN do not.
        An end is infinite where too few values are beyond the quantile.
    """
    first = _counts(stream, np.zeros(1, np.uint64), 0)
    count = int(first.sum())
    if not count:
        return [(math.nan, math.nan, math.nan)] * len(probabilities)
    ranks = np.array([quantile_ranks(count, q) for q in probabilities])
    found = _values(stream, first, np.clip(ranks, 0, count - 1).ravel()).reshape(-1, 3)
    found[ranks < 0], found[ranks >= count] = -math.inf, math.inf
    return [(float(value), float(low), float(high)) for value, low, high in found]


def _values(stream: Stream, first: np.ndarray, ranks: np.ndarray) -> np.ndarray:
    """The sorted values at some ranks, given the counts of their first digit."""
    prefixes, rest = _next_digit(np.zeros(len(ranks), np.uint64), ranks, first[None], np.zeros(1, np.uint64))
    for place in range(1, DIGITS):
        known = np.unique(prefixes)
        counts = _counts(stream, known, place)
        prefixes, rest = _next_digit(prefixes, rest, counts.reshape(-1, SIZE), known)
    return _doubles(prefixes)


def _next_digit(
    prefixes: np.ndarray, ranks: np.ndarray, counts: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The prefixes with one more digit, and the ranks among the values that begin with them."""
    ends = np.cumsum(counts, axis=1)
    rows = np.searchsorted(known, prefixes)
    digits = np.array([np.searchsorted(ends[row], rank, side="right") for row, rank in zip(rows, ranks)])
    before = np.array([ends[row, d - 1] if d else 0 for row, d in zip(rows, digits)])
    return (prefixes << np.uint64(BITS)) | digits.astype(np.uint64), ranks - before


def _counts(stream: Stream, known: np.ndarray, place: int) -> np.ndarray:
    """How often each digit follows each of some prefixes of `place` digits, (len(known) SIZE,)."""
    counts = np.zeros(len(known) * SIZE, np.int64)
    for values in stream():
        upper = _keys(values) >> np.uint64(BITS * (DIGITS - 1 - place))
        prefixes, digits = upper >> np.uint64(BITS), (upper & np.uint64(SIZE - 1)).astype(np.int64)
        rows = np.minimum(np.searchsorted(known, prefixes), len(known) - 1)
        mine = known[rows] == prefixes
        np.add.at(counts, rows[mine] * SIZE + digits[mine], 1)
    return counts


def _keys(values: np.ndarray) -> np.ndarray:
    """Whole numbers in the order of the values; without NaN."""
    values = np.asarray(values, np.float64)
    bits = values[~np.isnan(values)].view(np.uint64)
    return np.where(bits & _SIGN, ~bits, bits | _SIGN)


def _doubles(keys: np.ndarray) -> np.ndarray:
    """The values of whole numbers that `_keys` gave."""
    return np.where(keys & _SIGN, keys ^ _SIGN, ~keys).view(np.float64)
