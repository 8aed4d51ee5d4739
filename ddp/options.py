"""Options of the DDP solver."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slcp_warp.kernels.riccati import METHODS

DEFAULT_STEP_SIZES = tuple(float(a) for a in 2.0 ** -np.arange(11.0))


@dataclass(frozen=True)
class Regularization:
    """A schedule of Tassa, Erez & Todorov (2012), section II-F; every field a number or one per problem (B,).

    When a backward pass or a line search fails, delta = max(factor, delta factor) and mu = max(minimum, mu
    delta); after success delta = min(1/factor, delta/factor) and mu = mu delta, or 0 below the minimum. mu
    ``state_weight`` is added to V_xx as seen through f_x and f_u, mu ``control_weight`` to the diagonal of
    Q_uu.
    """

    initial: Any = 1.0e-3
    factor: Any = 2.0
    minimum: Any = 1.0e-6
    maximum: Any = 1.0e10
    state_weight: Any = 1.0
    control_weight: Any = 0.0

    def rows(self) -> np.ndarray:
        """The schedule as rows (1 or B, 6), float64.

        Raises:
            ValueError: a field is not finite, out of its range, or of a length unlike the others'.
        """
        columns = []
        for name in ("initial", "factor", "minimum", "maximum", "state_weight", "control_weight"):
            values = np.atleast_1d(np.asarray(getattr(self, name), dtype=np.float64))
            floor = 1.0 if name == "factor" else 0.0
            bad = ~np.isfinite(values) | (values < floor)
            if name in ("factor", "minimum", "maximum"):
                bad |= values <= floor
            if values.ndim != 1 or values.size == 0 or bad.any():
                bound = f"above {floor:g}" if name in ("factor", "minimum", "maximum") else "of at least 0"
                raise ValueError(
                    f"regularization.{name} must be a finite number {bound}, or one per problem; "
                    f"got {getattr(self, name)!r}"
                )
            columns.append(values)
        sizes = {c.size for c in columns if c.size > 1}
        if len(sizes) > 1:
            raise ValueError(
                f"the fields of regularization have different numbers of problems: {sorted(sizes)}"
            )
        rows = np.stack(np.broadcast_arrays(*columns), axis=1)
        if (rows[:, 4] + rows[:, 5] <= 0.0).any():
            raise ValueError("regularization needs a positive state_weight or control_weight, got 0 for both")
        return np.ascontiguousarray(rows)


@dataclass(frozen=True)
class Options:
    """How to solve a problem.

    A line search takes, of the step sizes whose actual reduction is more than ``min_reduction_ratio`` of the
    expected one, the one of lowest cost: the cost never increases. ``None`` tolerances depend on the dtype.

    Attributes:
        max_iterations: line searches at most; one more backward pass makes the returned policy.
        method: "second-order" (full DDP), "gauss-newton" (no second derivatives of the dynamics) or
            "first-order", the paper's (9)-(10).
        step_sizes: the alphas tried, all at once.
        regularization: one schedule, or one per problem.
        gradient_tolerance: converged when the largest |Q_u| is at most this; 1e-6, float32: 1e-3.
        improvement_tolerance: stop when an accepted step lowers the cost by at most this.
        min_reduction_ratio: least actual / expected reduction of an accepted step.
        sigma_schedule: decreasing noise levels of a continuation (see `solve_continuation`), or None.
    """

    max_iterations: int = 200
    method: str = "second-order"
    step_sizes: Sequence[float] = DEFAULT_STEP_SIZES
    regularization: Regularization = field(default_factory=Regularization)
    gradient_tolerance: float | None = None
    improvement_tolerance: float = 0.0
    min_reduction_ratio: float = 1.0e-3
    sigma_schedule: Sequence[float] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.max_iterations, int) or self.max_iterations < 0:
            raise ValueError(
                f"max_iterations must be a whole number of at least 0, got {self.max_iterations!r}"
            )
        if self.method not in METHODS:
            raise ValueError(f"method must be one of {', '.join(METHODS)}; got {self.method!r}")
        sizes = np.asarray(self.step_sizes, dtype=np.float64)
        if (
            sizes.ndim != 1
            or sizes.size == 0
            or not (np.isfinite(sizes) & (sizes > 0.0) & (sizes <= 1.0)).all()
        ):
            raise ValueError(f"step_sizes must be numbers in (0, 1], got {self.step_sizes!r}")
        for name in ("gradient_tolerance", "improvement_tolerance", "min_reduction_ratio"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value >= 0.0):
                raise ValueError(f"{name} must be a finite number of at least 0, got {value!r}")
        if not isinstance(self.regularization, Regularization):
            raise TypeError(
                f"regularization must be a ddp.Regularization, got {type(self.regularization).__name__}"
            )
        self.regularization.rows()
        if self.sigma_schedule is not None:
            sigmas = np.asarray(self.sigma_schedule, dtype=np.float64)
            if sigmas.ndim != 1 or sigmas.size == 0 or not (np.isfinite(sigmas) & (sigmas > 0.0)).all():
                raise ValueError(f"sigma_schedule must be positive numbers, got {self.sigma_schedule!r}")
            if (np.diff(sigmas) >= 0.0).any():
                raise ValueError(f"sigma_schedule must decrease, got {self.sigma_schedule!r}")
