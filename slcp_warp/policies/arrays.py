"""Numbers of policies as arrays of a simulator's precision, on its device."""

from typing import Any

import numpy as np
import warp as wp

from ..inputs.errors import ArgumentError
from ..inputs.limits import bounded
from ..simulator import Simulator


def put(sim: Simulator, values: Any, name: str = "a policy's array") -> wp.array:
    """Values of a policy as a Warp array of a simulator's precision, on its device; `name`: for errors."""
    if isinstance(values, wp.array):
        if values.dtype is not sim.dtype or values.device != sim.device or not values.is_contiguous:
            raise ArgumentError(
                f"{name} is a Warp array of {values.dtype.__name__} on {values.device}; a contiguous one of "
                f"{sim.dtype.__name__} on {sim.device} is needed"
            )
        return values
    return wp.array(np.ascontiguousarray(values), dtype=sim.dtype, device=sim.device)


def period_of(own: np.ndarray | None, sim: Simulator) -> np.ndarray:
    """The period (nx,) of a policy's states: its own, or the scene's."""
    return sim.scene.state_period if own is None else own


def kept_period(own: np.ndarray | None) -> np.ndarray:
    """A policy's own period as files keep it: nothing in an array where it has none."""
    return np.zeros(0) if own is None else own


def own_period(kept: np.ndarray) -> np.ndarray | None:
    """From what `kept_period` gave."""
    return kept if kept.size else None


def put_limits(sim: Simulator, struct: Any, limits: tuple[np.ndarray, np.ndarray]) -> None:
    """Limits of the controls in a policy's struct; a policy without any has none there."""
    if bounded(*limits):
        struct.lower, struct.upper = (put(sim, a) for a in limits)
