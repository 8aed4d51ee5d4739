"""Options of the DDP solver."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slcp_warp.inputs.checks import number, numeric, shown, whole
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
from slcp_warp.kernels.control.backward.riccati_parts import METHODS

DEFAULT_STEP_SIZES = tuple(float(a) for a in 2.0 ** -np.arange(11.0))

STARTS = ("automatic", "rollout", "hold", "goal")


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

    @classmethod
    def of(cls, rows: np.ndarray) -> "Regularization":
        """A schedule for every problem, from rows (B, 6) as `rows` gives them."""
        return cls(*rows.T)

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

    A line search takes the first step size where its actual reduction is at least ``full_step_ratio`` of the
    expected one, and the others are not looked at. Else it takes, of the step sizes whose actual reduction is
    more than ``min_reduction_ratio`` of the expected one, the one of lowest cost: the cost never increases.
    On a CPU the others are rolled out only where the first does not suffice, on a GPU all are in one launch;
    the results are the same. ``None`` tolerances depend on the dtype.

    Attributes:
        max_iterations: line searches at most; one more backward pass makes the returned policy.
        method: "second-order", full DDP, (M33) to (M35), whose second derivatives generic kernels weigh by
            the value function of the pass before (M56); "gauss-newton", without second derivatives of the
            dynamics; or "first-order", the paper's (9)-(10).
        step_sizes: the alphas tried.
        full_step_ratio: least actual / expected reduction of the first step size for it to suffice; infinite:
            it never does, and the lowest cost of all step sizes is taken.
        regularization: one schedule, or one per problem.
        gradient_tolerance: converged when the largest |Q_u| of every control is at most this, relative to the
            largest size of its terms l_u and f_u' V_x; the root of the dtype's epsilon: 1.5e-8, float32:
            3.5e-4. And what the pass promises is at most 64 times its square (or 64 epsilons) of the sizes of
            J's terms (M53), or a line search found nothing of it.
        improvement_tolerance: stop when an accepted step lowers the cost by at most this.
        min_reduction_ratio: least actual / expected reduction of an accepted step.
        limit_weight: of the problem's state limits, as penalties (M46), in the first round.
        limit_factor: by which it grows with every further round, > 1.
        limit_rounds: rounds of new multipliers after the first; 0: the limits are soft. Where limits do not
            hold, a round that had its even share of ``max_iterations`` ends once a pass gains no more than a
            tenth of what is paid for violations, and at the latest with half of the passes that were left.
        limit_tolerance: states may be that far beyond their limits, relative to max(1, |limit|); where they
            are further when passes end the status is STATE_LIMITS, unless the limits are soft
            (`Result.beyond_limits` says which, when and by how much).
        start: where passes start from when no states are given. "rollout": under the controls given, or
            zeros; "hold": multiple shooting (M43) from the first state held; "goal": the same from the
            minimum of the final cost's expansion about the first state; "automatic": a rollout of the
            controls given; without any, of zeros or, where its cost is lower, of what "hold" comes to once
            gaps are closed.
        sigma_schedule: decreasing noise levels of a continuation (see `solve_continuation`), or None.
    """

    max_iterations: int = 200
    method: str = "second-order"
    step_sizes: Sequence[float] = DEFAULT_STEP_SIZES
    full_step_ratio: float = 0.75
    regularization: Regularization = field(default_factory=Regularization)
    gradient_tolerance: float | None = None
    improvement_tolerance: float = 0.0
    min_reduction_ratio: float = 1.0e-3
    limit_weight: float = 10.0
    limit_factor: float = 5.0
    limit_rounds: int = 12
    limit_tolerance: float = 1.0e-3
    start: str = "automatic"
    sigma_schedule: Sequence[float] | None = None

    def __post_init__(self) -> None:
        whole("max_iterations", self.max_iterations, 0)
        if not isinstance(self.method, str) or self.method not in METHODS:
            raise ArgumentError(f"method must be one of {', '.join(METHODS)}; got {shown(self.method)}")
        if not isinstance(self.start, str) or self.start not in STARTS:
            raise ArgumentError(f"start must be one of {', '.join(STARTS)}; got {shown(self.start)}")
        sizes = numeric(self.step_sizes)
        if sizes is None or sizes.ndim != 1 or sizes.size == 0 or not ((sizes > 0.0) & (sizes <= 1.0)).all():
            raise ArgumentError(f"step_sizes must be numbers in (0, 1], got {shown(self.step_sizes)}")
        ratio = numeric(self.full_step_ratio)
        if ratio is None or ratio.ndim or not ratio > 0.0:
            raise ArgumentError(
                f"full_step_ratio must be a positive number, got {shown(self.full_step_ratio)}"
            )
        for name in ("gradient_tolerance", "improvement_tolerance", "min_reduction_ratio"):
            value = getattr(self, name)
            found = numeric(value)
            if not (value is None and name == "gradient_tolerance") and (
                found is None or found.ndim or not (np.isfinite(found) and found >= 0.0)
            ):
                raise ArgumentError(f"{name} must be a finite number of at least 0, got {shown(value)}")
        whole("limit_rounds", self.limit_rounds, 0)
        for name, floor in (("limit_weight", 0.0), ("limit_factor", 1.0), ("limit_tolerance", 0.0)):
            number(name, getattr(self, name), floor, above=True)
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


def of_one_level(options: Options) -> Options:
    """The options; an ArgumentError where they have a schedule of noise levels, which nobody would follow."""
    if options.sigma_schedule is not None:
        raise ArgumentError(
            f"options.sigma_schedule is {shown(options.sigma_schedule)}; it is for ddp.solve and "
            "ddp.solve_continuation, which solve at one level after the other"
        )
    return options
