"""Random complementarity problems."""

import numpy as np


def problems(n, rank, count, seed=0):
    """Random feasible problems, (B, n, n) and (B, n)."""
    rng = np.random.default_rng(seed)
    g = rng.normal(size=(count, n, rank))
    a = g @ g.swapaxes(1, 2)
    b = np.einsum("bij,bj->bi", a, rng.normal(size=(count, n))) + 0.3 * np.abs(rng.normal(size=(count, n)))
    return a, b


def diagonal(a):
    return np.einsum("...ii->...i", a)
