"""Whether steps are short enough for the numbers that logs tell: what half as long ones make of these."""

import copy

import numpy as np

from ....policies import KalmanFilter
from .likelihood import Likelihood
from .logs import Logs
from .scoring import Search
from .unknowns import Unknowns

ROUNDS = 4  # of scoring, from what was found


def moved_by_halving(likelihood: Likelihood, place: np.ndarray) -> np.ndarray:
    """By how much the K numbers move, to a third of a deviation, in steps half as long; NaN: who knows.

    Args:
        likelihood: of the logs.
        place: (size,) its minimum.
    """
    unknowns = likelihood.unknowns
    filter, count = _half(unknowns.filter), likelihood.count
    finer = Likelihood(Unknowns(filter, **unknowns.given), _filled(likelihood.logs))
    search = Search(finer, place[None])
    if not np.isfinite(finer.cost(place[None])[0]):
        return np.full(count, np.nan)
    search.run(ROUNDS, roughly=True)
    return np.asarray(search.minima[0].place[:count] - place[:count])


def _half(filter: KalmanFilter) -> KalmanFilter:
    out = copy.copy(filter)
    out.step_size = 0.5 * filter.step_size
    out.params = filter.params.replace(step_size=out.step_size)
    return out


def _filled(logs: Logs) -> Logs:
    """With a step more between two times, in which nothing is read."""
    runs, times, sensors = logs.measured.shape
    measured = np.full((runs, 2 * times - 1, sensors), np.nan)
    measured[:, ::2] = logs.measured
    return Logs(measured, np.repeat(logs.controls, 2, axis=1), logs.x0)
