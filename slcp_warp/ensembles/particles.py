"""The true stochastic system: many hard worlds under noise, and their means (paper, section VI).

What the smoothed step replaces by a fuzzy layer is here simulated: states are drawn around x, the original
hard problem (3) is solved for each, and the mean impulse and state are taken. For one row without friction
the smoothed impulse *is* that mean under inertia scaling; with friction and with several rows it is an
approximation, whose error `particles` measures for one step. `particle_rollout` draws anew before every
step: what a plan costs over the distribution of outcomes, without any smoothing.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from ..inputs import rules
from ..inputs.checks import array, flag, instance, memory, whole
from ..inputs.limits import limit_rows
from ..options import Status
from ..parameters import ParameterError, Parameters
from ..simulator import Simulator
from ..storage.printed import Arrays


@dataclass(frozen=True, repr=False)
class Particles(Arrays):
    """Means over the particles that were solved, with their standard errors.

    Attributes:
        state, impulse: means, (nx,) and (nr,).
        state_error, impulse_error: their standard errors.
        covariance: of the next state, (nx, nx).
        solved: how many particles were.
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
    """One step of `count` particles drawn around x (M9).

    Args:
        sim: a simulator with residual="hard".
        x: (nx,).
        u: (nu,), the same for all.
        params: as for `Simulator.step`.
        covariance: of the state x, (nx, nx) symmetric with no negative eigenvalue; Sigma_q and Sigma_v of
            (18) are its blocks.
        logistic: draw from the logistic instead of the normal distribution (of this covariance, along its
            principal axes).
        seed: of the random numbers.

    Raises:
        ParameterError: a simulator that is not hard, another shape, a covariance that is not one.
    """
    rng = _check(sim, count, logistic, seed)
    factor = _factor(sim, covariance)
    control = np.zeros(sim.nu) if u is None else array("u", u, (sim.nu,), error=ParameterError)
    states = array("x", x, (sim.nx,), error=ParameterError) + _noise(rng, count, factor, logistic)
    step = sim.step(states, np.broadcast_to(control, (count, sim.nu)), params)
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


@dataclass(frozen=True, repr=False)
class ParticleRollout(Arrays):
    """Every particle's trajectory: states (count, N+1, nx), controls (count, N, nu), status (count,)."""

    states: np.ndarray
    controls: np.ndarray
    status: np.ndarray


def particle_rollout(
    sim: Simulator,
    x0: Any,
    us: Any,
    params: Parameters | None = None,
    *,
    covariance: Any,
    count: int = 10000,
    xs: Any = None,
    K: Any = None,
    control_limits: Any = None,
    logistic: bool = False,
    seed: int = 0,
) -> ParticleRollout:
    """Roll out `count` particles of the hard system, with noise of its own on each state before every step.

    A particle that cannot be solved keeps its last valid state and its first failing status.

    Args:
        sim: a simulator with residual="hard".
        x0: (nx,), where all start.
        us: controls (N, nu).
        params: as for `Simulator.rollout`.
        covariance: of the noise on the state before each step, (nx, nx).
        xs, K: nominal states (N+1, nx) and gains (N, nu, nx): u = us + K (x - xs), x after the noise; both
            or none.
        control_limits: (lower, upper), each a number or (nu,): what u is held within.
        logistic, seed: as for `particles`.

    Raises:
        ParameterError: a simulator that is not hard, another shape, a covariance that is not one.
    """
    rng = _check(sim, count, logistic, seed)
    factor = _factor(sim, covariance)
    us = array("us", us, ("N", sim.nu), error=ParameterError)
    steps = len(us)
    if (xs is None) != (K is None):
        raise ParameterError("xs and K belong together; give both, or none for open loop")
    x0 = array("x0", x0, (sim.nx,), error=ParameterError)
    shape = (steps + 1, sim.nx)
    xs = np.zeros(shape) if xs is None else array("xs", xs, shape, error=ParameterError)
    wide = (steps, sim.nu, sim.nx)
    K = np.zeros(wide) if K is None else array("K", K, wide, error=ParameterError)
    memory(f"count = {count}: the states", count * (steps + 1) * sim.nx, 8, wp.get_device("cpu"))
    lower, upper = limit_rows(control_limits, sim.nu)
    if len(lower) != 1:
        raise ParameterError(f"control_limits are for {len(lower)} problems; one for all particles is needed")
    states = np.empty((count, steps + 1, sim.nx))
    controls = np.empty((count, steps, sim.nu))
    status = np.full(count, int(Status.SOLVED))
    states[:, 0] = x0
    for k in range(steps):
        x = states[:, k] + _noise(rng, count, factor, logistic)
        controls[:, k] = np.clip(us[k] + (x - xs[k]) @ K[k].T, lower, upper)
        step = sim.step(x, controls[:, k], params)
        status = np.where(status == Status.SOLVED, step.status, status)
        going = (status == Status.SOLVED)[:, None]
        states[:, k + 1] = np.where(going, step.state, states[:, k])
    return ParticleRollout(states, controls, status)


def _check(sim: Simulator, count: int, logistic: bool, seed: int) -> np.random.Generator:
    instance("sim", sim, Simulator, "a slcp_warp.Simulator")
    if not sim.options.hard:
        raise ParameterError(f"sim has residual {sim.options.residual!r}; particles need residual='hard'")
    whole("count", count, 2, error=ParameterError)
    memory(f"count = {count}: the states", count * sim.nx, 8, wp.get_device("cpu"))
    flag("logistic", logistic)
    return np.random.default_rng(whole("seed", seed, 0, 2**63 - 1))


def _factor(sim: Simulator, covariance: Any) -> np.ndarray:
    """L with L L' = covariance, from its principal axes: it may be singular."""
    spread = array("covariance", covariance, (sim.nx, sim.nx), error=ParameterError)
    values, axes = np.linalg.eigh(rules.covariance("covariance", spread, sim.nx, ParameterError))
    return np.asarray(axes * np.sqrt(np.maximum(values, 0.0)))


def _noise(rng: np.random.Generator, count: int, factor: np.ndarray, logistic: bool) -> np.ndarray:
    size = (count, len(factor))
    drawn = rng.logistic(scale=np.sqrt(3.0) / np.pi, size=size) if logistic else rng.standard_normal(size)
    return np.asarray(drawn @ factor.T)
