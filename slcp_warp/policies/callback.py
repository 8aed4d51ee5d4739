"""Controls from a Python function, asked between launches."""

import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..inputs.checks import function, number
from ..measures.signals import Signal
from ..stepping.host import senses_of


class Callback:
    """A policy in Python: f(x, time) -> u of all worlds, or f(x, time, felt), held between two calls.

    It acts on the host (`HostPolicy`): a launch a period instead of one for a whole run, states copied to
    NumPy and controls back. For what cannot run in a kernel; it runs in rollouts and in sweeps.

    Args:
        f: gets x (B, nx), float64, and the time [s], and gives (B, nu) or (nu,); its exceptions go through.
        period: between two calls [s], rounded to whole steps; None: a step.
        senses: by name signals of contacts and tendons (`slcp_warp.measures`); with them f gets their values
            in the step that was made last, too, a dict of (B,), NaN before the first.
    """

    alike = True  # in all worlds: by state and time alone

    def __init__(
        self,
        f: Callable[..., Any],
        period: float | None = None,
        senses: Mapping[str, Signal] | None = None,
    ) -> None:
        self.senses = {} if senses is None else senses
        self.f = function("f", f, 3 if self.senses else 2)
        self.period = None if period is None else number("period", period, 0.0, above=True)
        self._felt: dict[int, dict[str, np.ndarray]] = {}  # by thread: runs may share a policy
        senses_of(self)

    def feel(self, shown: dict[str, np.ndarray]) -> None:
        """What is shown to f besides states."""
        self._felt[threading.get_ident()] = shown

    def act(self, x: np.ndarray, time: float, worlds: np.ndarray) -> Any:
        """What f gives."""
        if not self.senses:
            return self.f(x, time)  # type: ignore[misc]
        return self.f(x, time, self._felt[threading.get_ident()])  # type: ignore[misc]
