"""When the running terms of a cost count: times of a plan, and the steps that they are."""

import math
from dataclasses import dataclass

import numpy as np

from slcp_warp.kernels.control.cost_terms import FIELDS, TIMED

from ..inputs.errors import ArgumentError

NEVER_ENDS = 1e9  # steps
ROUNDING = 1e-6  # of a step: times that are whole steps but for it


@dataclass(frozen=True)
class Windows:
    """Windows of running terms, in the order of the weights.

    Attributes:
        spans: (start, end) of each [s]; end None: to the last step. A term counts at the steps k with start
            <= k h < end.
        step_size: h of the weights [s].
        begun: time of the plan that is over before the weights' step 0 [s].
    """

    spans: tuple[tuple[float, float | None], ...]
    step_size: float
    begun: float = 0.0

    def into(self, weights: np.ndarray) -> np.ndarray:
        """Weights (P,) or (B, P) with these windows.

        Raises:
            ArgumentError: a window without a step.
        """
        out = weights.copy()
        for i, (start, end) in enumerate(self.spans):
            place = 1 + TIMED * i + FIELDS
            first, last = self._step(start), NEVER_ENDS if end is None else self._step(end)
            if first == last:
                raise ArgumentError(
                    f"Term.start is {start:g} s, Term.end {end:g} s; a step of {self.step_size:g} s between "
                    "them is needed"
                )
            out[..., place], out[..., place + 1] = first, last
        return out

    def check(self, duration: float) -> None:
        """Raise ArgumentError for a term that counts only after a time [s]."""
        for start, _ in self.spans:
            if start > duration - ROUNDING * self.step_size:
                raise ArgumentError(
                    f"Term.start is {start:g} s; less is needed, as plans and runs end at {duration:g} s"
                )

    def _step(self, time: float) -> float:
        """The first step at a time of the plan or after it, counted from the weights' step 0."""
        return math.ceil((time - self.begun) / self.step_size - ROUNDING)
