"""What a policy on the host feels of a step of a rollout."""

from dataclasses import dataclass

import numpy as np

from ..measures.signals import Signal
from ..results import Trajectory
from ..results.simulated import Simulated


@dataclass(frozen=True)
class Felt:
    """Signals of single steps of a rollout's worlds."""

    signals: tuple[Signal, ...]
    simulated: Simulated

    def __call__(
        self,
        x: np.ndarray,
        u: np.ndarray,
        after: np.ndarray,
        impulse: np.ndarray,
        gap: np.ndarray,
        status: np.ndarray,
    ) -> np.ndarray:
        """(B, F) in a step from states x (B, nx) under u (B, nu) to `after`; 0 where it was not solved.

        Args:
            impulse, gap: (B, nr) of the rows.
            status: (B,).
        """
        rows = u[:, None], impulse[:, None], gap[:, None]
        run = Trajectory(np.stack([x, after], axis=1), status, *rows, self.simulated)
        return np.nan_to_num(np.stack([run.series(each)[:, 0] for each in self.signals], axis=1))
