"""Looking about where derivatives lead no further: the likelihood through contact has kinks and steps."""

import numpy as np

from .information import Information
from .likelihood import Likelihood

TRIED = 32  # places at once
WIDEST = 2.0  # of the spread's logarithm to base ten, in deviations that the information tells


def stirred(
    likelihood: Likelihood, place: np.ndarray, known: Information, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """A better place (size,) than one, or this, and its cost.

    First states are tried for every log by itself, by which what is best of one is not lost to what is bad of
    another; then numbers, which first states follow.
    """
    count, runs, starts = likelihood.count, likelihood.runs, len(likelihood.starts)
    numbers, own = known.deviations
    out = place.copy()
    if starts:
        tried = np.tile(place, (1 + TRIED, 1))
        wide = np.minimum(1.0, own * 10.0 ** rng.uniform(0.0, WIDEST, size=(TRIED, 1, 1)))
        tried[1:, count:] += (wide * rng.normal(size=wide.shape)).reshape(TRIED, -1)
        best = likelihood.costs(tried).argmin(axis=0)
        moved = tried[:, count:].reshape(-1, runs, starts)
        out[count:] = moved[best, np.arange(runs)].ravel()
    tried = np.tile(out, (1 + TRIED, 1))
    if count:
        scale = np.linalg.cholesky(np.linalg.inv(known.reduced))
        wide = 10.0 ** rng.uniform(0.0, WIDEST, size=(TRIED, 1))
        wide = np.minimum(wide, 1.0 / numbers.max())
        moves = (wide * rng.normal(size=(TRIED, count))) @ scale.T
        tried[1:, :count] += moves
        tried[1:, count:] += np.array([known.follows(each).ravel() for each in moves])
    costs = likelihood.cost(tried)
    best = int(costs.argmin())
    return tried[best], float(costs[best])
