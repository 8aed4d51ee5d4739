"""Limits of controls and states, as a plan, a library or a policy has them."""

from typing import Any

import numpy as np

from .checks import numeric, shown
from .errors import ArgumentError


def limit_rows(given: Any, size: int, name: str = "control_limits") -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper limits (1 or B, nu), infinite where there is none.

    Args:
        given: (lower, upper), each a number, (nu,) or (B, nu); None: no limits.
        size: number nu of what is limited.
        name: of the argument, for errors.

    Raises:
        ArgumentError: wrong shapes, NaN, or a lower limit above an upper one.
    """
    if given is None:
        return np.full((1, size), -np.inf), np.full((1, size), np.inf)
    several = isinstance(given, tuple | list) or isinstance(given, np.ndarray) and given.ndim > 0
    if not several or len(given) != 2:
        raise ArgumentError(f"{name} must be (lower, upper), got {shown(given)}")
    rows = []
    for side, value in zip(("lower", "upper"), given):
        array = numeric(value)
        if array is None:
            raise ArgumentError(f"{name}: {side} limit must be numbers, got {shown(value)}")
        if array.ndim > 2 or (array.ndim and array.shape[-1] != size) or array.shape[:-1] == (0,):
            raise ArgumentError(
                f"{name}: {side} limit must be a number, ({size},) or (B, {size}), got {array.shape}"
            )
        if np.isnan(array).any():
            raise ArgumentError(f"{name}: {side} limit is {shown(value)}; NaN is no limit")
        rows.append(np.atleast_2d(np.broadcast_to(array, (size,) if array.ndim == 0 else array.shape)))
    if len({len(row) for row in rows} - {1}) > 1:
        raise ArgumentError(f"{name} are for {len(rows[0])} and for {len(rows[1])} problems")
    low, high = np.broadcast_arrays(*rows)
    if not (low <= high).all():
        raise ArgumentError(f"{name}: a lower limit is above the upper one, got {shown(given)}")
    return np.ascontiguousarray(low), np.ascontiguousarray(high)


def any_limits(given: Any, name: str = "control_limits") -> Any:
    """Limits as they came, of however many controls.

    Raises:
        ArgumentError: as of `limit_rows`.
    """
    several = isinstance(given, tuple | list) or isinstance(given, np.ndarray) and given.ndim > 0
    sides = [numeric(value) for value in given] if several else []
    sizes = (each.shape[-1] for each in sides if each is not None and each.ndim)
    limit_rows(given, max(sizes, default=1), name)
    return given


def bounded(lower: np.ndarray, upper: np.ndarray) -> bool:
    """Whether any limit is finite."""
    return bool(np.isfinite(lower).any() or np.isfinite(upper).any())
