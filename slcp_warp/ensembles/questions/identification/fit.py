"""How well a mechanism explains recorded runs: whether it is surprised as little as it says."""

from typing import NamedTuple

import numpy as np

from .likelihood import Likelihood
from .logs import Logs
from .scoring import Search
from .unknowns import Unknowns

FAR = 3.0  # deviations
CERTAIN = 4.0  # deviations of what is told as no chance
FEWEST = 8  # pairs of readings, of which an echo is told
ROUNDS = 20  # for first states


class Fit(NamedTuple):
    """What sensors were off by from what was foretold, in deviations that were foretold of it.

    Where numbers, noise and mechanism are right these are independent standard normal ones (M72).

    Attributes:
        cost: negative logarithm of the likelihood, without its constant; infinite where there is none.
        seen: numbers that were measured.
        rms: of the deviations; 1 is right.
        beyond: share beyond three; .0027 is right.
        echo: by sensor, correlation of a deviation with the one before that was read; 0 is right.
        pairs: by sensor, how many that is told by.
        failures: steps of the model without a solution, or without derivatives.
    """

    cost: float
    seen: int
    rms: float
    beyond: float
    echo: dict[str, float]
    pairs: dict[str, int]
    failures: int

    def told(self) -> list[str]:
        """What is no chance, in sentences without a stop."""
        out, sd = [], CERTAIN * np.sqrt(2.0 / self.seen)
        if abs(self.rms**2 - 1.0) > sd:
            noise = "small" if self.rms > 1.0 else "large"
            out.append(
                f"sensors are off by {self.rms:.3g} of the deviations that are foretold, 1 is right: noise "
                f"is too {noise} (process_noise= and sensor_noise= look for it)"
            )
        echoes = [
            f"{name} {each:.2g}"
            for name, each in self.echo.items()
            if self.pairs[name] >= FEWEST and abs(each) > CERTAIN / np.sqrt(self.pairs[name])
        ]
        if echoes:
            out.append(
                f"a deviation tells the next one (correlations: {', '.join(echoes)}): something acts that "
                "the mechanism has not got, or in another step"
            )
        return out


def fit_of(likelihood: Likelihood, place: np.ndarray) -> Fit:
    """At a place (size,)."""
    known, deviations, failures = deviations_of(likelihood, place)
    names, seen = likelihood.unknowns.filter.sensors, deviations[known]
    echo, pairs = {}, {}
    for i, name in enumerate(names):
        rows = [each[mine] for each, mine in zip(deviations[:, :, i], known[:, :, i])]
        before = np.concatenate([each[:-1] for each in rows])
        after = np.concatenate([each[1:] for each in rows])
        size = float(np.sqrt((before**2).sum() * (after**2).sum()))
        echo[name] = float((before * after).sum() / size) if size > 0.0 else 0.0
        pairs[name] = len(before)
    cost = float(likelihood.data(place[None]).sum())
    rms, beyond = float(np.sqrt(np.mean(seen**2))), float(np.mean(np.abs(seen) > FAR))
    return Fit(cost, int(known.sum()), rms, beyond, echo, pairs, failures)


def deviations_of(likelihood: Likelihood, place: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """What was read, and deviations (R, N + 1, sensors) of it, (M72), and steps without a solution.

    First states were fitted to what is looked at. So each is believed as it was before the logs, and learned
    from one time to the next, to first order about what was found.
    """
    found, slopes = likelihood.by_starts(place[None])
    known, failures = np.isfinite(found.off[0]), int(found.failures.sum())
    if not np.isfinite(found.covariance).all():
        return known, np.full(known.shape, np.nan), failures
    off = np.where(known, found.off[0], 0.0)
    both = np.moveaxis(np.concatenate([off[None], slopes[0]]), 0, -1)
    both = np.linalg.solve(np.linalg.cholesky(found.covariance[0]), both)
    mean = place[likelihood.count :].reshape(likelihood.runs, len(likelihood.starts))
    return known, _learned(both[..., 0], both[..., 1:], mean), failures


def _learned(off: np.ndarray, slopes: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Deviations (R, T, sensors) where starts (R, n) are N(0, 1) and learned from one time to the next.

    Args:
        off: at the starts that were found.
        slopes: (R, T, sensors, n) by the starts.
        found: (R, n).
    """
    runs, times, sensors, starts = slopes.shape
    mean, covariance = np.zeros((runs, starts)), np.tile(np.eye(starts), (runs, 1, 1))
    out = np.zeros_like(off)
    for k in range(times):
        H = slopes[:, k]
        here = off[:, k] + (H @ (mean - found)[..., None])[..., 0]
        size = np.eye(sensors) + H @ covariance @ H.swapaxes(1, 2)
        out[:, k] = np.linalg.solve(np.linalg.cholesky(size), here[..., None])[..., 0]
        gain = np.linalg.solve(size, H @ covariance).swapaxes(1, 2)
        mean = mean - (gain @ here[..., None])[..., 0]
        covariance = covariance - gain @ H @ covariance
    return out


def judged(unknowns: Unknowns, logs: Logs, z: np.ndarray) -> Fit:
    """How well numbers z (K,) explain logs, whose first states are looked for."""
    likelihood = Likelihood(unknowns, logs, z)
    search = Search(likelihood, likelihood.places(np.zeros((1, 0))))
    if len(likelihood.starts):
        search.run(ROUNDS)
    return fit_of(likelihood, search.minima[0].place)
