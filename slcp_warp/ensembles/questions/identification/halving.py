"""Whether steps are short enough for the numbers that logs tell: what half as long ones make of these."""

import copy
from dataclasses import replace

import numpy as np

from ....policies import KalmanFilter
from .likelihood import Likelihood
from .logs import Logs
from .scoring import Minimum, Search
from .unknowns import Unknowns


def moved_by_halving(likelihood: Likelihood, minimum: Minimum) -> np.ndarray:
    """By how much the K numbers move in steps half as long, (K,), by one round of scoring; NaN: who knows.

    Args:
        likelihood: of the logs.
        minimum: where it is least.
    """
    unknowns = likelihood.unknowns
    filter, count = _half(unknowns.filter), likelihood.count
    finer = Likelihood(Unknowns(filter, **unknowns.given), _filled(likelihood.logs))
    here = replace(minimum)
    (gradient,) = Search(finer, minimum.place[None]).slopes([here])
    if not (np.isfinite(gradient).all() and all(np.isfinite(each).all() for each in here.known)):
        return np.full(count, np.nan)
    return here.known.step(gradient)[:count]


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
