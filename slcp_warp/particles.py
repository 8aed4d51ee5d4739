"""The true stochastic system, one step: many hard worlds around a state, and their mean (paper, section VI).

What the smoothed step replaces by a fuzzy layer is here simulated: states are drawn around x, the original
hard problem (3) is solved for each, and the mean impulse and state are taken. For one row without friction
the smoothed impulse *is* that mean under inertia scaling; with friction and with several rows it is an
approximation, whose error this measures.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .options import Status
from .parameters import ParameterError, Parameters
from .simulator import Simulator


@dataclass(frozen=True)
class Particles:
    """Means over the particles that were solved, with their standard errors.

    Attributes:
        state (nx,), impulse (nr,): means. state_error, impulse_error: their standard errors.
        covariance: of the next state, (nx, nx). solved: how many particles were.
    """

    state: np.ndarray
    state_error: np.ndarray
    impulse: np.ndarray
    impulse_error: np.ndarray
    covariance: np.ndarray
    solved: int


def particles(
    sim: Simulator,
    x: Any,
    u: Any = None,
    params: Parameters | None = None,
    *,
    covariance: Any,
    count: int = 10000,
    logistic: bool = False,
    seed: int = 0,
) -> Particles:
    """One step of `count` particles drawn around x.

    Args:
        sim: a simulator with residual="hard". x: (nx,). u: (nu,), the same for all.
        covariance: of the state x, (nx, nx) symmetric with no negative eigenvalue; Sigma_q and Sigma_v of
            (18) are its blocks.
        logistic: draw from the logistic instead of the normal distribution (of this covariance, along its
            principal axes).

    Raises:
        ParameterError: a simulator that is not hard, a covariance of another shape or not one.
    """
    if not sim.options.hard:
        raise ParameterError(f"sim has residual {sim.options.residual!r}; particles need residual='hard'")
    if count < 2:
        raise ParameterError(f"count is {count}; two particles or more are needed")
    centre = np.asarray(x, float)
    spread = np.asarray(covariance, float)
    if spread.shape != (sim.nx, sim.nx) or not np.allclose(spread, spread.T):
        raise ParameterError(
            f"covariance has shape {spread.shape}; ({sim.nx}, {sim.nx}) and symmetric is needed"
        )
    values, axes = np.linalg.eigh(spread)
    if values.min() < -1e-12 * max(values.max(), 1e-300):
        raise ParameterError(f"covariance has the eigenvalue {values.min()}; none below 0 is needed")
    rng = np.random.default_rng(seed)
    drawn = rng.standard_normal((count, sim.nx))
    if logistic:
        drawn = rng.logistic(scale=np.sqrt(3.0) / np.pi, size=drawn.shape)
    states = centre + (drawn * np.sqrt(np.maximum(values, 0.0))) @ axes.T
    control = None if u is None else np.broadcast_to(np.asarray(u, float), (count, sim.nu))
    step = sim.step(states, control, params)
    solved = step.status == Status.SOLVED
    after, impulse = np.asarray(step.state, float)[solved], np.asarray(step.impulse, float)[solved]
    n = max(len(after), 1)
    return Particles(
        after.mean(0),
        after.std(0) / np.sqrt(n),
        impulse.mean(0),
        impulse.std(0) / np.sqrt(n),
        np.cov(after.T),
        len(after),
    )
