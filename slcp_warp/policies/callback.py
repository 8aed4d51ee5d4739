"""Controls from a Python function, asked between launches."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..inputs.checks import function, number


class Callback:
    """A policy in Python: f(x, time) -> u of all worlds, held between two calls.

    It acts on the host (`HostPolicy`): a launch a period instead of one for a whole run, states copied to
    NumPy and controls back. For what cannot run in a kernel; it runs in rollouts and in sweeps.

    Args:
        f: gets x (B, nx), float64, and the time [s], and gives (B, nu) or (nu,); its exceptions go through.
        period: between two calls [s], rounded to whole steps; None: a step.
    """

    alike = True  # in all worlds: by state and time alone

    def __init__(self, f: Callable[[np.ndarray, float], Any], period: float | None = None) -> None:
        self.f = function("f", f, 2)
        self.period = None if period is None else number("period", period, 0.0, above=True)

    def act(self, x: np.ndarray, time: float, worlds: np.ndarray) -> Any:
        """What f gives."""
        return self.f(x, time)  # type: ignore[misc]
