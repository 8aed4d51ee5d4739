"""One world's motion, as pictures take it."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from slcp_warp.kernels.ensembles.contacts import TOUCH

from ...description.scene import Scene


@dataclass(frozen=True)
class Motion:
    """One world over time, or a piece of it.

    Attributes:
        scene: its names and topology.
        numbers: value of every parameter by name, without a world axis.
        time: (T+1,) [s].
        states: (T+1, nx).
        pushes: (T,) normal impulse of all pairs together [N s], NaN of failed steps; None: not recorded.
        controls: (T, nu); None: not recorded.
        pulls: (T, tendons) forces of tendons [N, N m]; None: there are none, or they are not known.
    """

    scene: Scene
    numbers: dict[str, np.ndarray]
    time: np.ndarray
    states: np.ndarray
    pushes: np.ndarray | None = None
    controls: np.ndarray | None = None
    pulls: np.ndarray | None = None

    @property
    def impulse(self) -> np.ndarray:
        """(T,) normal impulse, zero where there is none: not recorded, or of steps that failed [N s]."""
        return np.zeros(len(self.time) - 1) if self.pushes is None else np.nan_to_num(self.pushes)

    @property
    def touches(self) -> bool:
        """Whether more than 1e-6 N s were recorded in a step, as `measures.contact` counts it."""
        return bool((self.impulse > TOUCH).any())

    @property
    def step_size(self) -> float:
        """[s]."""
        return float(self.numbers["step_size"])

    def since(self, step: int) -> "Motion":
        """The motion from a step on, its time from 0."""
        cut: dict[str, Any] = {"time": self.time[step:] - self.time[step], "states": self.states[step:]}
        for name in ("pushes", "controls", "pulls"):
            whole = getattr(self, name)
            cut[name] = None if whole is None else whole[step:]
        return replace(self, **cut)
