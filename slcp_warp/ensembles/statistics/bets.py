"""The wealth of bets against a mean, mixed over their sizes (Waudby-Smith and Ramdas 2024)."""

import math

import numpy as np

_NEAR = np.geomspace(1e-6, 0.5, 140)
BETS = np.concatenate([_NEAR, (1.0 - np.geomspace(0.5, 1e-7, 80))[1:]])  # of the most that may be lost
_LOG_PRIOR = np.log(
    np.diff(np.concatenate([[0.0], 0.5 * (BETS[1:] + BETS[:-1]), [1.0]]))
)  # evenly over (0, 1)


def log_wealth(mean: float, gained: int, lost: int, worlds: int) -> float:
    """Logarithm of the mixture's wealth after bets that the mean is larger, from 1 at the start."""
    if mean <= -1.0:
        return math.inf
    stake = BETS / (1.0 + mean)
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = (
            gained * np.log1p(stake * (1.0 - mean))
            + (worlds - gained - lost) * np.log1p(-stake * mean)
            + lost * np.log1p(-stake * (1.0 + mean))
        )
    terms = terms + _LOG_PRIOR
    most = float(terms.max())
    return most + math.log(float(np.exp(terms - most).sum()))
