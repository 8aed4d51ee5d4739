"""Summaries, quantiles and comparisons of a sweep's parts, from their blocks in order."""

import functools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ...options import Status
from ...results.overlaps import OVERLAP
from .intervals import Interval, share_interval, shares_interval
from .moments import Moments
from .quantiles import quantile_intervals
from .source import BLOCK, NOTED, Columns, Key, Source

STATUSES = len(Status)
START = NOTED[0]  # how deep rows overlap where a world begins


def summary_of_part(source: Source, key: Key, measures: Sequence[str]) -> dict[str, Any]:
    """Worlds, success with its interval (Wilson), mean of every measure, where it is finite, statuses, and
    how many begin in overlap.
    """
    names = [name for name in measures if name in source.names(key)]
    worlds, successes, statuses = 0, 0, np.zeros(STATUSES, np.int64)
    overlapping, deepest, known = 0, 0.0, START in source.names(key)
    means = dict.fromkeys(measures, Moments())
    for block in source.blocks(key, ("success", "status", *([START] if known else []), *names)):
        worlds += len(block["world"])
        successes += int(np.count_nonzero(block["success"]))
        statuses += np.bincount(block["status"].astype(np.int64), minlength=STATUSES)
        if known:
            overlapping += int(np.count_nonzero(block[START] > OVERLAP))
            deepest = float(np.fmax.reduce(block[START], initial=deepest))
        for name in names:
            means[name] += Moments.of(block[name])
    row: dict[str, Any] = {"worlds": worlds, "success": share_interval(successes, worlds)}
    row |= {name: moments.interval() for name, moments in means.items()}
    row["finite"] = {name: moments.count for name, moments in means.items()}
    row["overlapping"] = {"worlds": overlapping, "deepest": deepest} if known else {}
    return row | {"statuses": {status.name: int(statuses[status]) for status in Status}}


def quantiles_of_part(
    source: Source, key: Key, measures: Sequence[str], probabilities: Sequence[float]
) -> dict[str, dict[float, Interval]]:
    """Quantiles of every measure with their intervals, by probability."""

    def column(name: str) -> Iterator[np.ndarray]:
        return (block[name] for block in source.blocks(key, (name,)))

    return {
        name: dict(zip(probabilities, quantile_intervals(functools.partial(column, name), probabilities)))
        for name in measures
    }


def differences(
    source: Source, first: Key, second: Key, names: Sequence[str], other: Source | None = None
) -> dict[str, Interval]:
    """Mean differences first - second of columns of the same worlds, with 95 % intervals; `other`: what the
    second part is of.

    Over the worlds that both have, where both columns are finite; that of success is one of shares.
    """
    out = dict.fromkeys(names, Moments())
    one, two, worlds = 0, 0, 0
    for a, b in paired_blocks(source, first, second, names, other):
        for name in names:
            change = difference(a[name], b[name])
            out[name] += Moments.of(change)
            if name == "success":
                one, two = one + int((change > 0.0).sum()), two + int((change < 0.0).sum())
                worlds += len(change)
    found = {name: moments.interval() for name, moments in out.items()}
    return found | ({"success": shares_interval(one, two, worlds)} if "success" in found else {})


def difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The finite ones of the differences a - b; True and False count as 1 and 0."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    both = np.isfinite(a) & np.isfinite(b)
    return a[both] - b[both]


def paired_blocks(
    source: Source, first: Key, second: Key, names: Sequence[str], other: Source | None = None
) -> Iterator[tuple[Columns, Columns]]:
    """The blocks of two parts, with the worlds that both have; `other`: what the second one is of."""
    streams = [source.blocks(first, names), (other or source).blocks(second, names)]
    a, b = (next(stream, None) for stream in streams)
    while a is not None and b is not None:
        ahead = int(a["world"][0]) // BLOCK - int(b["world"][0]) // BLOCK
        if ahead == 0:
            yield _shared(a, b)
        if ahead <= 0:
            a = next(streams[0], None)
        if ahead >= 0:
            b = next(streams[1], None)


def _shared(a: Columns, b: Columns) -> tuple[Columns, Columns]:
    """The rows of the worlds that both have."""
    if np.array_equal(a["world"], b["world"]):
        return a, b
    _, rows, others = np.intersect1d(a["world"], b["world"], assume_unique=True, return_indices=True)
    left = {name: column[rows] for name, column in a.items()}
    return left, {name: column[others] for name, column in b.items()}
