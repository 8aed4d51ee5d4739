"""How far states are beyond their limits: which of them, when and by how much."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Limits = tuple[np.ndarray, np.ndarray]  # lower and upper, (1 or B, nx), infinite where there is none


def excess(xs: np.ndarray, limits: Limits) -> tuple[np.ndarray, np.ndarray]:
    """(B, N, nx) how far states (B, N + 1, nx) after the first are beyond their limits, as they are and
    relative to max(1, |limit|); 0: not at all.
    """
    lower, upper = (a[:, None] for a in limits)
    after = xs[:, 1:].astype(np.float64)
    below, above = np.maximum(lower - after, 0.0), np.maximum(after - upper, 0.0)
    relative = (gap / np.maximum(1.0, np.abs(a)) for gap, a in ((below, lower), (above, upper)))
    return below + above, np.maximum(*relative)


@dataclass(frozen=True)
class Worst:
    """The state of one problem that is furthest beyond its limit, relative to max(1, |limit|).

    Attributes:
        state: which one.
        step: when.
        by: how far.
    """

    state: int
    step: int
    by: float

    def text(self, names: Sequence[str] | None, step_size: float | None) -> str:
        """For people; without names and a step size by numbers."""
        name = f"x[{self.state}]" if names is None else names[self.state]
        when = f"in step {self.step}" if step_size is None else f"at {self.step * step_size:.4g} s"
        return f"{name} by {self.by:.3g} {when}"


def worst(xs: np.ndarray, limits: Limits) -> list[Worst | None]:
    """Of every problem of a batch; None: where no state is beyond its limits."""
    apart, relative = excess(xs, limits)
    found: list[Worst | None] = []
    for own, share in zip(apart, np.nan_to_num(relative)):
        step, state = np.unravel_index(int(share.argmax()), share.shape)
        by = float(own[step, state])
        found.append(Worst(int(state), int(step) + 1, by) if share[step, state] > 0.0 else None)
    return found
