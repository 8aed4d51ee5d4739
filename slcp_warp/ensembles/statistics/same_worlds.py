"""Whether two parts of reports are of the same worlds, by what their tables say was drawn."""

import numpy as np

from .reductions import paired_blocks
from .source import DRAWN, Key, Source

SAME = 1e-4  # of what is drawn, by which roundings of single precision make ratios and differences others


def unlike(source: Source, first: Key, other: Source, second: Key) -> list[str]:
    """What was drawn otherwise, of the columns that both have, in the first worlds that both have.

    What two designs have about numbers of their own is alike where its ratio, or its difference, is one.
    """
    there = set(other.names(second))
    names = [name for name in source.names(first) if name.startswith(DRAWN) and name in there]
    for a, b in paired_blocks(source, first, second, names, other):
        if len(a["world"]):
            return [name.removeprefix(DRAWN) for name in names if not _alike(a[name], b[name])]
    return []


def _alike(a: np.ndarray, b: np.ndarray) -> bool:
    a, b = a.astype(float), b.astype(float)
    known = np.isfinite(a) & np.isfinite(b)
    a, b = a[known], b[known]
    if len(a) < 2 or not np.ptp(a) > 0.0:
        return bool(np.allclose(a, b, rtol=SAME, atol=0.0))
    if np.ptp(b - a) <= SAME * np.ptp(a):
        return True
    return bool(np.ptp(a * (b @ a) / (a @ a) - b) <= SAME * np.ptp(b))
