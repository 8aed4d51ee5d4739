"""The conditions of a step, from their formulas: (3), (15), (17) and footnote 3, in NumPy float64."""

import math
from typing import Any

import numpy as np

from slcp_warp.description.kinematics import Array
from slcp_warp.kernels.method import Method


def expected_square_slopes(a: Array, b: Array, sigma: Array, method: Method) -> tuple[Array, Array]:
    """Derivatives by a and b of E[min(a, b + noise)^2], (15): 2 a P(B > a) and 2 E[B; B < a]."""
    z = (a - b) / sigma
    small = np.exp(-np.abs(z))
    if method.residual == "erm-logistic":
        above = np.where(z > 0.0, small, 1.0) / (1.0 + small)
        excess = sigma * np.log1p(small)  # E[(a - B)+] - (a - b)+
    else:
        tail = normal_tail(np.abs(z))
        above = np.where(z > 0.0, tail, 1.0 - tail)
        excess = sigma * (np.exp(-0.5 * z * z) / math.sqrt(2 * math.pi) - np.abs(z) * tail)
    below = np.where(z > 0.0, b - a * above, a * (1.0 - above)) - excess
    return 2.0 * a * above, 2.0 * below


def complementarity(a: Array, b: Array, sigma: Array, method: Method) -> Array:
    """min(a, b) - s(-|a - b|): 0 where (3), (17) or footnote 3's REM-normal holds; nan for other methods."""
    if method.hard:
        return np.minimum(a, b)
    gap = np.abs(a - b) / sigma
    if method.residual == "rem-logistic":
        return np.minimum(a, b) - sigma * np.log1p(np.exp(-gap))
    if method.residual == "rem-normal":
        tail = np.exp(-0.5 * gap**2) / math.sqrt(2 * math.pi) - gap * normal_tail(gap)
        return np.minimum(a, b) - sigma * tail
    return np.full(np.broadcast_shapes(a.shape, b.shape), np.nan)


def partner(a: Array, sigma: Array, method: Method) -> Array:
    """b such that complementarity(a, b) = 0, which is symmetric in both, by bisection; inf where a <= 0."""
    low, high = np.zeros(a.shape), 1e3 * sigma + np.zeros(a.shape)
    for _ in range(64):
        middle = 0.5 * (low + high)
        below = complementarity(a, middle, sigma, method) < 0.0
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    out: Array = np.where(a > 0.0, high, np.inf)
    return out


def rubbed(impulse: Any, speed: Any, diagonal: Any, bound: Any) -> Array:
    """The tangential impulse that Coulomb's law asks for: the projection on [-bound, bound] of `impulse` less
    speed / diagonal; `impulse` itself where the law holds. `diagonal`: of A, positive.
    """
    return np.clip(impulse - speed / diagonal, -bound, bound)


def normal_tail(x: Array) -> Array:
    """1 - Phi(x) for x >= 0."""
    return 0.5 * np.vectorize(math.erfc, otypes=[float])(x / math.sqrt(2.0))
