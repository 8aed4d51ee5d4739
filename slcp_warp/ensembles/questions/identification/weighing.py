"""What is known where it is not quite normal: draws are weighed, and the next ones drawn by their moments."""

from typing import NamedTuple

import numpy as np

from .likelihood import Likelihood
from .scoring import Minimum

TAILS = 5.0  # degrees of freedom of the draws, whose tails hold those of a normal distribution
ENOUGH, FEW = 0.4, 0.1  # share of the draws that count: at the end, and at least for moments
PASSES = 8  # at most


class Weighed(NamedTuple):
    """A normal distribution (K,), (K, K), and the share of its draws that count, (M73)."""

    mean: np.ndarray
    covariance: np.ndarray
    share: float


def weighed(likelihood: Likelihood, minimum: Minimum, draws: int, rng: np.random.Generator) -> Weighed:
    """What is known of the numbers, by adaptive importance sampling from a minimum and its information.

    A guess of which enough draws count stays as it is; in its place come the moments of weighed draws, whose
    weights are evened out where only few of them count. First states follow the numbers. Where noise is
    looked for they count as not known: as likely as they can be they leave too little of it.
    """
    noisy, moved = likelihood.unknowns.noisy and len(likelihood.starts) > 0, False
    count, found = likelihood.count, list[Weighed]()
    best = mean = minimum.place[:count]
    covariance = np.linalg.inv(minimum.known.reduced)
    for _ in range(PASSES):
        z, density = _drawn(mean, covariance, draws, rng)
        starts = [minimum.place[count:] + minimum.known.follows(each - best).ravel() for each in z]
        places = np.concatenate([z, np.array(starts)], axis=1)
        logarithm = -likelihood.cost(places) - density
        if noisy:
            logarithm -= likelihood.start_information(places)
        if not np.isfinite(logarithm).sum() > FEW * draws:
            break
        share = _counted(_weights(logarithm))
        found.append(Weighed(mean, covariance, share))
        if share >= ENOUGH and (moved or not noisy):
            return found[-1]
        power = 1.0
        while _counted(_weights(power * logarithm)) < FEW:
            power *= 0.5
        mean, covariance = _moments(z, _weights(power * logarithm), covariance)
        moved = True
    return max(found, key=lambda each: each.share, default=Weighed(best, covariance, 0.0))


def _drawn(
    mean: np.ndarray, covariance: np.ndarray, draws: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draws (draws, K) of Student's distribution, and the logarithm of its density but for a constant."""
    size = len(mean)
    wide = np.sqrt(TAILS / rng.chisquare(TAILS, size=(draws, 1)))
    scaled = wide * rng.normal(size=(draws, size))
    density = -0.5 * (TAILS + size) * np.log1p((scaled**2).sum(axis=1) / TAILS)
    return mean + scaled @ np.linalg.cholesky(covariance).T, density


def _weights(logarithm: np.ndarray) -> np.ndarray:
    """(draws,) that sum to 1."""
    weight = np.exp(np.where(np.isfinite(logarithm), logarithm, -np.inf) - np.nanmax(logarithm))
    return np.asarray(weight / weight.sum())


def _counted(weight: np.ndarray) -> float:
    """The effective share of weighed draws: 1 / (n sum of squares)."""
    return float(1.0 / (len(weight) * (weight**2).sum()))


def _moments(z: np.ndarray, weight: np.ndarray, before: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of weighed draws; what few draws do not tell of it stays as it was."""
    mean, size = weight @ z, z.shape[1]
    off = z - mean
    kept = size / (size + _counted(weight) * len(z))
    return mean, (1.0 - kept) * (off.T * weight) @ off + kept * before
