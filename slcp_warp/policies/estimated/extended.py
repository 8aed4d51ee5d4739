"""A step of an extended Kalman filter in many worlds at once: what is foretold, and what is corrected."""

from typing import Any, NamedTuple

import numpy as np

from ...options import Status
from ...parameters import Parameters
from ...simulator import Simulator
from .forces import Forces, Shown

FARTHEST = 1e100  # of a variance


class Belief(NamedTuple):
    """What is known of the states of some worlds.

    Attributes:
        mean: (B, nx).
        covariance: (B, nx, nx).
        failures: (B,) predictions so far in which the model's step had no solution, or no derivatives.
        shown: what sensors of a step's forces show of the last one, where there are such; None before it.
    """

    mean: np.ndarray
    covariance: np.ndarray
    failures: np.ndarray
    shown: Shown | None = None


def foretold(
    model: Simulator,
    belief: Belief,
    u: Any,
    params: Parameters,
    h: float,
    strayed: np.ndarray,
    forces: Forces | None = None,
) -> Belief:
    """What is known after a step of size h [s], (M66).

    Where the step is not solved bodies go on at their velocities; where it has no derivatives, or nothing is
    known any more (errors beyond `FARTHEST`), errors do.

    Args:
        strayed: (nx, nx) or (B, nx, nx) covariance of what the noise does meanwhile.
        forces: sensors of the step's forces, which are foretold, too; None: none.
    """
    mean, covariance, failures, _ = belief
    nv = model.nx // 2
    free = np.eye(2 * nv)
    free[:nv, nv:] = h * np.eye(nv)
    if model.options.method.state_noise:
        params = params.replace(**_noise(covariance, h))
    after = model.step(mean, u, params)
    known = solved = after.status == Status.SOLVED
    A, grown, shown = np.broadcast_to(free, covariance.shape), covariance, None
    if covariance.any():
        linear = model.linearize(mean, u, params)
        known = solved & (linear.status == Status.SOLVED)
        A = np.where(known[:, None, None], linear.A.astype(float), free)
        with np.errstate(all="ignore"):
            grown = A @ covariance @ A.swapaxes(1, 2)
            lost = ~(np.abs(grown) < FARTHEST).all(axis=(1, 2))
        if lost.any():
            A, known = np.where(lost[:, None, None], free, A), known & ~lost
            grown = A @ covariance @ A.swapaxes(1, 2)
    if forces is not None:
        shown = forces.foretold(mean, covariance, A, u, params)
    mean = np.where(solved[:, None], after.state.astype(float), mean @ free.T)
    return Belief(mean, _symmetric(grown) + strayed, failures + ~known, shown)


def corrected(
    belief: Belief, off: np.ndarray, slopes: np.ndarray, variance: np.ndarray, of_step: np.ndarray
) -> tuple[Belief, np.ndarray, np.ndarray]:
    """What is known when sensors have been read, (M68), what they were off by, and its covariance.

    Args:
        off: (B, sensors) by what they were off; NaN where one was not read.
        slopes: (B, sensors, nx) of what they show by states.
        variance: (sensors,) or (B, sensors) of their noise.
        of_step: (F,) which of them show forces of the step before, (M75); read they have been only where
            belief.shown says what they show.

    Returns:
        The belief, `off`, and (B, sensors, sensors): of a sensor that was not read its noise alone.
    """
    mean, covariance, failures, shown = belief
    nx, known = mean.shape[1], np.isfinite(off)
    by = np.where(known, off, 0.0)
    noise = variance[..., None] * np.eye(by.shape[1])
    C = slopes
    if shown is not None:
        across = shown.across
        covariance = np.block([[covariance, across], [across.swapaxes(1, 2), shown.covariance]])
        itself = np.tile(np.eye(by.shape[1])[:, of_step], (len(mean), 1, 1))
        C = np.concatenate([C, itself], axis=2)
    C = C * known[:, :, None]
    to_sensors = C @ covariance
    both = to_sensors @ C.swapaxes(1, 2) + noise
    gain = solved(both, to_sensors).swapaxes(1, 2)
    left = np.eye(covariance.shape[1]) - gain @ C
    covariance = left @ covariance @ left.swapaxes(1, 2) + gain @ noise @ gain.swapaxes(1, 2)
    mean = mean + (gain @ by[:, :, None])[:, :nx, 0]
    return Belief(mean, _symmetric(covariance[:, :nx, :nx]), failures), off, both


def solved(matrix: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """matrix^-1 rows (.., n, m); where sensors repeat each other beyond rounding, by the pseudo-inverse."""
    try:
        return np.linalg.solve(matrix, rows)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(matrix, hermitian=True) @ rows)


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
