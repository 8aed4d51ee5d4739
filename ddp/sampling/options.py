"""How controls are sampled."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from slcp_warp.inputs.checks import number, numeric, shown, whole
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.inputs.limits import limit_rows
from slcp_warp.kernels.control.sampling import METHODS

from .spline import SPLINES

SHARE = 0.2  # of the limits: standard deviation of what is drawn


@dataclass(frozen=True)
class Sampling:
    """A search by sampled controls (see `sample`).

    Attributes:
        method: "predictive": the best sample is the next mean (Howell et al. 2022); "cem", the cross-entropy
            method: mean and deviation of the elites (Rubinstein 1999); "mppi", model predictive path
            integrals: the mean weighed by e^(-(J - J_min) / temperature) (Williams et al. 2017), (M48).
        samples: rollouts an iteration and problem.
        iterations: how many.
        knots: of the spline that is drawn, at most a plan's steps; None: one for about eight steps, and at
            least 4.
        spline: "constant", "linear" or "cubic" (Catmull and Rom's) between knots.
        scale: standard deviation of the first knots, a number or (nu,); None: a fifth of the control limits,
            and 1 where there are none.
        elites: share of the samples that are elites ("cem").
        temperature: relative to the mean of J - J_min ("mppi").
        decay: factor of the deviations after an iteration ("predictive", "mppi").
        least: share of ``scale`` that deviations do not fall below.
    """

    method: str = "cem"
    samples: int = 128
    iterations: int = 20
    knots: int | None = None
    spline: str = "cubic"
    scale: Any = None
    elites: float = 0.1
    temperature: float = 0.1
    decay: float = 0.9
    least: float = 0.05

    def __post_init__(self) -> None:
        for name, known in (("method", METHODS), ("spline", SPLINES)):
            value = getattr(self, name)
            if not isinstance(value, str) or value not in known:
                raise ArgumentError(f"{name} must be one of {', '.join(known)}; got {shown(value)}")
        whole("samples", self.samples, 3)
        whole("iterations", self.iterations)
        if self.knots is not None:
            whole("knots", self.knots)
        for name in ("elites", "temperature", "decay"):
            number(name, getattr(self, name), 0.0, above=True)
        number("least", self.least, 0.0)
        if self.elites > 1.0:
            raise ArgumentError(
                f"elites is {shown(self.elites)}; a share of the samples, at most 1, is needed"
            )
        if self.scale is not None:
            given = numeric(self.scale)
            if given is None or given.ndim > 1 or not (np.isfinite(given) & (given >= 0.0)).all():
                raise ArgumentError(
                    f"scale must be a number of at least 0, or one per control; got {shown(self.scale)}"
                )

    def deviations(self, control_limits: Any, nu: int) -> np.ndarray:
        """(1 or B, nu) standard deviations of the first knots.

        Raises:
            ArgumentError: `scale` is for another number of controls.
        """
        if self.scale is None:
            return limit_share(control_limits, nu)
        given = np.asarray(self.scale, dtype=np.float64)
        if given.shape not in ((), (nu,)):
            raise ArgumentError(f"scale has shape {given.shape}; a number or ({nu},) is needed")
        return np.broadcast_to(given, (1, nu)).copy()


def limit_share(control_limits: Any, nu: int, share: float = SHARE) -> np.ndarray:
    """(1 or B, nu) a share of the larger limit of every control, and 1 where it has none."""
    reach = np.maximum(*np.abs(limit_rows(control_limits, nu)))
    return np.where(np.isfinite(reach), share * np.where(np.isfinite(reach), reach, 0.0), 1.0)
