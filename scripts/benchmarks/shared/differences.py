"""Finite differences of a step, and their converged value with an estimate of how far it is settled."""

from collections.abc import Callable

import numpy as np

Step = Callable[[np.ndarray], np.ndarray]  # (M, nz) states and controls -> (M, nx) next states

SIXTH = {1: 0.75, 2: -0.15, 3: 1.0 / 60.0}  # weights of the central difference of sixth order
CENTRED = {1: 0.5}
SPANS = (3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6)  # tried by `converged`


def central(step: Step, z: np.ndarray, eps: float, weights: dict[int, float] = CENTRED) -> np.ndarray:
    """Jacobians (B, nx, nz) of step at z (B, nz) by central differences of spacing eps, in one call."""
    count, nz = z.shape
    moves = [(j, sign * k, sign * w / eps) for j in range(nz) for k, w in weights.items() for sign in (1, -1)]
    after = step(np.concatenate([z + k * eps * np.eye(nz, dtype=z.dtype)[j] for j, k, _ in moves]))
    out = np.zeros((count, after.shape[1], nz))
    for i, (j, _, weight) in enumerate(moves):
        out[:, :, j] += weight * after[i * count : (i + 1) * count]
    return out


def forward(step: Step, z: np.ndarray, eps: float) -> np.ndarray:
    """Jacobians (B, nx, nz) by forward differences, in one call of nz + 1 points a state."""
    count, nz = z.shape
    after = step(np.concatenate([z, *(z + eps * row for row in np.eye(nz, dtype=z.dtype))]))
    moved = after[count:].reshape(nz, count, -1).astype(float)
    return np.moveaxis((moved - after[:count]) / eps, 0, 2)


def relative(jacobian: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """Largest error of each Jacobian relative to the largest entry, (B,)."""
    return np.abs(jacobian - exact).max((1, 2)) / np.abs(exact).max((1, 2))


def converged(step: Step, z: np.ndarray, spans: tuple[float, ...] = SPANS) -> tuple[np.ndarray, np.ndarray]:
    """Jacobians (B, nx, nz) by differences of sixth order, and how far two neighbouring spans agree (B,).

    State by state the pair of spans that agree best counts, and of it the smaller; NaN where a step failed.
    """
    trials = [central(step, z, span, SIXTH) for span in spans]
    apart = np.stack([relative(a, b) for a, b in zip(trials, trials[1:])])
    best = np.argmin(np.where(np.isfinite(apart), apart, np.inf), axis=0)
    each = np.arange(len(z))
    return np.stack(trials[1:])[best, each], apart[best, each]
