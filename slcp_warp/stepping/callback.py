"""Controls from a Python function, asked between launches."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..inputs.arrays import ArrayError
from ..inputs.checks import function, number, numeric, shown
from ..inputs.errors import ArgumentError


class Callback:
    """A policy in Python, for rollouts: f(x, time) -> u of all worlds, held between two calls.

    A rollout makes one launch a step and copies states to NumPy and controls back once a period: for what
    cannot run in a kernel. Sweeps need a policy that can.

    Args:
        f: gets x (B, nx), float64, and the time [s], and gives (B, nu) or (nu,); its exceptions go through.
        period: between two calls [s], rounded to whole steps of the first world; None: a step.
    """

    def __init__(self, f: Callable[[np.ndarray, float], Any], period: float | None = None) -> None:
        self.f = function("f", f, 2)
        self.period = None if period is None else number("period", period, 0.0, above=True)

    def every(self, h: float) -> int:
        """Steps of h [s] between two calls."""
        return 1 if self.period is None else max(1, round(self.period / h))

    def controls(self, x: np.ndarray, time: float, nu: int) -> np.ndarray:
        """Controls (B, nu) of states (B, nx).

        Raises:
            ArgumentError, ArrayError: what came back is no such array of finite numbers.
        """
        given = self.f(x.astype(np.float64), time)  # type: ignore[misc]
        found = numeric(given)
        if found is None:
            raise ArgumentError(f"policy gave {shown(given)} at {time:g} s; an array of numbers is needed")
        if found.shape not in ((nu,), (len(x), nu)):
            raise ArrayError(
                f"policy gave shape {found.shape} at {time:g} s; ({len(x)}, {nu}) or ({nu},) is needed"
            )
        out = np.broadcast_to(found, (len(x), nu))
        still = np.isfinite(x).all(1)
        if not np.isfinite(out[still]).all():
            bad = out[still][~np.isfinite(out[still])][0]
            raise ArgumentError(f"policy gave {bad} at {time:g} s; finite numbers are needed")
        return out
