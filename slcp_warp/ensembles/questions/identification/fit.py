"""How well a mechanism explains recorded runs: whether it is surprised as little as it says."""

from typing import NamedTuple

import numpy as np

from .likelihood import Likelihood, Surprise, costs
from .logs import Logs
from .scoring import Search
from .unknowns import Unknowns

FAR = 3.0  # deviations
ROUNDS = 20  # for first states
CERTAIN = 4.0  # deviations of what is told as no chance


class Fit(NamedTuple):
    """What sensors were off by from what was foretold, in deviations that were foretold of it.

    Where numbers, noise and mechanism are right these are independent standard normal ones (M72).

    Attributes:
        cost: negative logarithm of the likelihood, without its constant; infinite where there is none.
        seen: numbers that were measured.
        rms: of the deviations; 1 is right.
        beyond: share beyond three; .0027 is right.
        echo: by sensor, correlation of a deviation with the one before; 0 is right.
        failures: steps of the model without a solution, or without derivatives.
    """

    cost: float
    seen: int
    rms: float
    beyond: float
    echo: dict[str, float]
    failures: int

    def told(self) -> list[str]:
        """What is no chance, in sentences without a stop."""
        out, sd = [], CERTAIN / np.sqrt(2.0 * self.seen)
        if abs(self.rms**2 - 1.0) > 2.0 * sd:
            out.append(
                f"sensors are off by {self.rms:.3g} of the deviations that are foretold, 1 is right: "
                f"its noise is too {'small' if self.rms > 1.0 else 'large'} (process_noise= and "
                "sensor_noise= look for it)"
            )
        echoes = [f"{name} {each:.2g}" for name, each in self.echo.items() if abs(each) > self._chance]
        if echoes:
            out.append(
                f"a deviation tells the next one (correlations: {', '.join(echoes)}): something acts that "
                "the mechanism has not got, or in another step"
            )
        return out

    @property
    def _chance(self) -> float:
        return CERTAIN / float(np.sqrt(max(1.0, self.seen / max(1, len(self.echo)))))


def fit_of(found: Surprise, names: tuple[str, ...]) -> Fit:
    """Of the first candidate's surprise, by the names of sensors."""
    known = np.isfinite(found.off[0])
    whitened = _whitened(np.where(known, found.off[0], 0.0), found.covariance[0])  # NaN: no filter went on
    seen = whitened[known]
    echo = {}
    for i, name in enumerate(names):
        both = known[:, 1:, i] & known[:, :-1, i]
        before, after = whitened[:, :-1, i][both], whitened[:, 1:, i][both]
        size = float(np.sqrt((before**2).sum() * (after**2).sum()))
        echo[name] = float((before * after).sum() / size) if size > 0.0 else 0.0
    data = float(costs(found)[0].sum())
    return Fit(
        data if np.isfinite(data) else np.inf,
        int(known.sum()),
        float(np.sqrt(np.mean(seen**2))),
        float(np.mean(np.abs(seen) > FAR)),
        echo,
        int(found.failures[0].sum()),
    )


def _whitened(off: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """L^-1 e with covariance L L'; not numbers where this is none."""
    if not np.isfinite(covariance).all():
        return np.full(off.shape, np.nan)
    return np.asarray(np.linalg.solve(np.linalg.cholesky(covariance), off[..., None])[..., 0])


def judged(unknowns: Unknowns, logs: Logs, z: np.ndarray) -> Fit:
    """How well numbers z (K,) explain logs, whose first states are looked for."""
    likelihood = Likelihood(unknowns, logs, z)
    search = Search(likelihood, likelihood.places(np.zeros((1, 0))))
    if len(likelihood.starts):
        search.run(ROUNDS)
    return fit_of(likelihood.surprise(search.minima[0].place[None]), unknowns.filter.sensors)
