"""Options of the DDP solver."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slcp_warp.inputs.checks import numeric, shown, whole
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
from slcp_warp.kernels.control.riccati import METHODS

DEFAULT_STEP_SIZES = tuple(float(a) for a in 2.0 ** -np.arange(11.0))


@dataclass(frozen=True)
class Regularization:
    """A schedule of Tassa, Erez & Todorov (2012), section II-F; every field a number or one per problem (B,).

    When a backward pass or a line search fails, delta = max(factor, delta factor) and mu = max(minimum, mu
    delta); after success delta = min(1/factor, delta/factor) and mu = mu delta, or 0 below the minimum. mu
    ``state_weight`` is added to V_xx as seen through f_x and f_u, mu ``control_weight`` to the diagonal of
    Q_uu (M34).

    Attributes:
        initial: mu of the first backward pass.
        factor: by which delta grows and falls, > 1.
        minimum: smallest mu but 0.
        maximum: where the solver gives up.
        state_weight, control_weight: of mu; one of them is positive.
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
            given = numeric(getattr(self, name))
            values = np.atleast_1d(np.full(1, np.nan) if given is None else given)
            floor = 1.0 if name == "factor" else 0.0
            bad = ~np.isfinite(values) | (values < floor)
            if name in ("factor", "minimum", "maximum"):
                bad |= values <= floor
            if values.ndim != 1 or values.size == 0 or bad.any():
                bound = f"above {floor:g}" if name in ("factor", "minimum", "maximum") else "of at least 0"
                raise ArgumentError(
                    f"regularization.{name} must be a finite number {bound}, or one per problem; "
                    f"got {shown(getattr(self, name))}"
                )
            columns.append(values)
        sizes = {c.size for c in columns if c.size > 1}
        if len(sizes) > 1:
            raise ArgumentError(
                f"the fields of regularization have different numbers of problems: {sorted(sizes)}"
            )
        rows = np.stack(np.broadcast_arrays(*columns), axis=1)
        if (rows[:, 4] + rows[:, 5] <= 0.0).any():
            raise ArgumentError(
                "regularization needs a positive state_weight or control_weight, got 0 for both"
            )
        return np.ascontiguousarray(rows)


@dataclass(frozen=True)
class Options:
    """How to solve a problem.

    A line search takes, of the step sizes whose actual reduction is more than ``min_reduction_ratio`` of the
    expected one, the one of lowest cost: the cost never increases. ``None`` tolerances depend on the dtype.

    Attributes:
        max_iterations: line searches at most; one more backward pass makes the returned policy.
        method: "second-order", full DDP, (M33) to (M35); "gauss-newton", without second derivatives of the
            dynamics; or "first-order", the paper's (9)-(10).
        step_sizes: the alphas tried, all at once.
        regularization: one schedule, or one per problem.
        gradient_tolerance: converged when the largest |Q_u| of every control is at most this, relative to the
            largest size of its terms l_u and f_u' V_x; the root of the dtype's epsilon: 1.5e-8, float32:
            3.5e-4. What is left to gain is then of the order of J's rounding.
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
        whole("max_iterations", self.max_iterations, 0)
        if not isinstance(self.method, str) or self.method not in METHODS:
            raise ArgumentError(f"method must be one of {', '.join(METHODS)}; got {shown(self.method)}")
        sizes = numeric(self.step_sizes)
        if sizes is None or sizes.ndim != 1 or sizes.size == 0 or not ((sizes > 0.0) & (sizes <= 1.0)).all():
            raise ArgumentError(f"step_sizes must be numbers in (0, 1], got {shown(self.step_sizes)}")
        for name in ("gradient_tolerance", "improvement_tolerance", "min_reduction_ratio"):
            value = getattr(self, name)
            found = numeric(value)
            if not (value is None and name == "gradient_tolerance") and (
                found is None or found.ndim or not (np.isfinite(found) and found >= 0.0)
            ):
                raise ArgumentError(f"{name} must be a finite number of at least 0, got {shown(value)}")
        if not isinstance(self.regularization, Regularization):
            raise ArgumentTypeError(
                f"regularization must be a ddp.Regularization, got {type(self.regularization).__name__}"
            )
        self.regularization.rows()
        if self.sigma_schedule is not None:
            check_levels("sigma_schedule", self.sigma_schedule)


def check_levels(name: str, value: Any) -> None:
    """Raise ArgumentError unless these are decreasing noise levels."""
    sigmas = numeric(value)
    positive = sigmas is not None and sigmas.ndim == 1 and sigmas.size > 0 and (sigmas > 0.0).all()
    if sigmas is None or not positive or not np.isfinite(sigmas).all():
        raise ArgumentError(f"{name} must be positive numbers, got {shown(value)}")
    if (np.diff(sigmas) >= 0.0).any():
        raise ArgumentError(f"{name} must decrease, got {shown(value)}")
