"""A step of an extended Kalman filter in many worlds at once: what is foretold, and what is corrected."""

from typing import Any, NamedTuple

import numpy as np

from ...options import Status
from ...parameters import Parameters
from ...simulator import Simulator


class Belief(NamedTuple):
    """What is known of the states of some worlds.

    Attributes:
        mean: (B, nx).
        covariance: (B, nx, nx).
        failures: (B,) predictions so far in which the model's step had no solution, or no derivatives.
    """

    mean: np.ndarray
    covariance: np.ndarray
    failures: np.ndarray


def foretold(
    model: Simulator, belief: Belief, u: Any, params: Parameters, h: float, strayed: np.ndarray
) -> Belief:
    """What is known after a step of size h [s], (M66).

    Where the step is not solved bodies go on at their velocities; where it has no derivatives errors do.

    Args:
        strayed: (nx, nx) or (B, nx, nx) covariance of what the noise does meanwhile.
    """
    mean, covariance, failures = belief
    nv = model.nx // 2
    free = np.eye(2 * nv)
    free[:nv, nv:] = h * np.eye(nv)
    if model.options.method.state_noise:
        params = params.replace(**_noise(covariance, h))
    after = model.step(mean, u, params)
    known = solved = after.status == Status.SOLVED
    if covariance.any():
        linear = model.linearize(mean, u, params)
        known = solved & (linear.status == Status.SOLVED)
        A = np.where(known[:, None, None], linear.A.astype(float), free)
        covariance = _symmetric(A @ covariance @ A.swapaxes(1, 2))
    mean = np.where(solved[:, None], after.state.astype(float), mean @ free.T)
    return Belief(mean, covariance + strayed, failures + ~known)


def difference(measured: np.ndarray, expected: np.ndarray, period: np.ndarray) -> np.ndarray:
    """What was measured less what was expected, (B, sensors), angles modulo their period; NaN stays."""
    off = measured - expected
    turns = np.round(np.divide(off, period, out=np.zeros_like(off), where=period > 0.0))
    return np.asarray(off - turns * period)


def corrected(
    belief: Belief, off: np.ndarray, places: np.ndarray, variance: np.ndarray
) -> tuple[Belief, np.ndarray]:
    """What is known when sensors have been read, (M68), and the covariance of what they were off by.

    Args:
        off: (B, sensors) by what they were off; NaN where one was not read.
        places: (sensors,) of their states.
        variance: (sensors,) or (B, sensors) of their noise.

    Returns:
        The belief, and (B, sensors, sensors): of a sensor that was not read its noise alone.
    """
    mean, covariance, failures = belief
    known = np.isfinite(off)
    off = np.where(known, off, 0.0)
    noise = variance[..., None] * np.eye(len(places))
    to_sensors = covariance[:, places] * known[:, :, None]
    both = to_sensors[:, :, places] * known[:, None, :] + noise
    gain = np.linalg.solve(both, to_sensors).swapaxes(1, 2)
    left = np.tile(np.eye(mean.shape[1]), (len(mean), 1, 1))
    left[:, :, places] -= gain
    covariance = left @ covariance @ left.swapaxes(1, 2) + gain @ noise @ gain.swapaxes(1, 2)
    return Belief(mean + (gain @ off[:, :, None])[:, :, 0], _symmetric(covariance), failures), both


def spread(process: np.ndarray, h: float) -> np.ndarray:
    """Covariance (nx, nx) of what noise of variances `process` (nx,) a second has done after h [s], (M67)."""
    nv = len(process) // 2
    of_q, of_v = np.diag(process[:nv]), np.diag(process[nv:])
    across = 0.5 * h**2 * of_v
    return np.block([[h * of_q + h**3 / 3.0 * of_v, across], [across, h * of_v]])


def _noise(covariance: np.ndarray, h: float) -> dict[str, np.ndarray]:
    """Parameters with which J (Sigma_q/h^2 + Sigma_v) J' is the variance of J (v + q/h), (M69)."""
    nv = covariance.shape[1] // 2
    both = np.concatenate([np.eye(nv) / h, np.eye(nv)], axis=1)
    of_speed = _symmetric(both @ covariance @ both.T)
    return {"position_covariance": np.zeros_like(of_speed), "velocity_covariance": of_speed}


def _symmetric(a: np.ndarray) -> np.ndarray:
    return 0.5 * (a + a.swapaxes(1, 2))
