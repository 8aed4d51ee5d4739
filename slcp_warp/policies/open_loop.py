"""Controls that do not look: a sequence, or a function of time."""

import copy
import math
from typing import Any

import numpy as np

from slcp_warp.kernels.policies.contract import PolicyKernel
from slcp_warp.kernels.policies.sequence import SEQUENCE, make_sequence

from ..inputs.checks import array, number
from ..inputs.errors import ArgumentError
from ..simulator import Simulator
from .arrays import put
from .saved import Content

SAME = 1e-6  # of a step: times that differ by less are the same


class OpenLoop:
    """u = us_k in step k, (M36) without feedback; beyond the end the last controls are held.

    A function of time is its values at the steps: `OpenLoop(np.sin(w * h * np.arange(N))[:, None], h)`.

    Args:
        us: controls (N, nu), or (B, N, nu) for one sequence per world.
        step_size: of the sequence [s]: where steps of another size are made it is followed in time, each
            control held; None: step by step, whatever their size.

    Raises:
        ArgumentError: another shape, or numbers that are not finite.
    """

    def __init__(self, us: Any, step_size: float | None = None) -> None:
        given = array("us", us)
        if given.ndim not in (2, 3) or not given.shape[-2]:
            raise ArgumentError(f"us has shape {given.shape}; (N, nu) or (B, N, nu) is needed")
        self.us = given if given.ndim == 3 else given[None]
        self.worlds = len(self.us)
        self.step_size = None if step_size is None else number("step_size", step_size, 0.0, above=True)

    @property
    def alike(self) -> bool:
        """Whether it acts by state and time alone in all worlds."""
        return self.worlds == 1

    def kernel(self, sim: Simulator) -> tuple[PolicyKernel, Any]:
        """Kernel and struct for a simulator."""
        if self.us.shape[2] != sim.nu:
            raise ArgumentError(
                f"us has {self.us.shape[2]} controls; scene {sim.scene.name!r} needs {sim.nu}"
            )
        struct = make_sequence(sim.nx, sim.nu, sim.dtype).Struct()
        struct.us = put(sim, self.us)
        return SEQUENCE, struct

    def at(self, step_size: float) -> "OpenLoop":
        """The same for steps of another size [s]: the controls at the times at which these begin.

        Raises:
            ArgumentError: a sequence without a step size.
        """
        h = number("step_size", step_size, 0.0, above=True)
        if self.step_size is None:
            raise ArgumentError(f"the sequence has no step size; it is followed step by step, not with {h} s")
        steps = self.us.shape[1]
        count = max(1, math.ceil(steps * self.step_size / h - SAME))
        row = np.floor(np.arange(count) * (h / self.step_size) + SAME).astype(int)
        out = copy.copy(self)
        out.us, out.step_size = self.us[:, np.minimum(row, steps - 1)], h
        return out

    def content(self) -> Content:
        """What it is made from, see `saved`."""
        return Content({"step_size": self.step_size}, {"us": self.us})

    @classmethod
    def of_content(cls, content: Content) -> "OpenLoop":
        """From what `content` gave."""
        return cls(content.arrays["us"], content.values.get("step_size"))
