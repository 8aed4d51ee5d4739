"""What the solver returns."""

from dataclasses import dataclass, fields, replace

import numpy as np

from slcp_warp.inputs.checks import whole
from slcp_warp.kernels.control import status as codes

from .status import Status


@dataclass(frozen=True)
class Trace:
    """One row a pass (B, passes + 1), NaN where a problem had already stopped.

    Attributes:
        cost: cost after the pass.
        reduction: cost before less cost after; 0 where no step size was accepted.
        reduction_ratio: actual over expected reduction of the step accepted.
        step_size: the alpha accepted, 0 where none was.
        expected_reduction: largest expected reduction among the step sizes.
        regularization: mu of the backward pass.
        gradient: largest |Q_u| before the step.
        min_pivot: smallest pivot of Q_uu without regularisation; positive where it is positive definite.
        restarts: times that the backward pass had to start again with a larger mu.
    """

    cost: np.ndarray
    reduction: np.ndarray
    reduction_ratio: np.ndarray
    step_size: np.ndarray
    expected_reduction: np.ndarray
    regularization: np.ndarray
    gradient: np.ndarray
    min_pivot: np.ndarray
    restarts: np.ndarray

    @classmethod
    def from_rows(cls, rows: np.ndarray) -> "Trace":
        """Name the columns of the solver's array (B, passes + 1, TRACE_COLUMNS)."""
        columns = {
            "cost": codes.TRACE_COST,
            "reduction": codes.TRACE_REDUCTION,
            "reduction_ratio": codes.TRACE_RATIO,
            "step_size": codes.TRACE_STEP_SIZE,
            "expected_reduction": codes.TRACE_EXPECTED,
            "regularization": codes.TRACE_REGULARIZATION,
            "gradient": codes.TRACE_GRADIENT,
            "min_pivot": codes.TRACE_PIVOT,
            "restarts": codes.TRACE_RESTARTS,
        }
        return cls(**{name: rows[..., column].copy() for name, column in columns.items()})


@dataclass(frozen=True)
class Result:
    """Locally optimal trajectories and policies u = us + K (x - xs); NumPy arrays, batch first.

    Attributes:
        xs: states (B, N+1, nx).
        us: controls (B, N, nu).
        K: feedback gains (B, N, nu, nx) at the returned trajectory.
        k: the step that the last backward pass still proposed (B, N, nu).
        Vx: gradient of the cost-to-go (B, N+1, nx).
        Vxx: its Hessian (B, N+1, nx, nx).
        cost: total cost (B,), +inf where the first rollout failed.
        status: `Status` as integers (B,).
        iterations: line searches done (B,).
        gradient: largest |Q_u| at the returned trajectory (B,).
        min_pivot: smallest pivot of the unregularised Q_uu there (B,).
        lower, upper: limits of the controls (B, nu), infinite where there is none; `TrackingPolicy` keeps
            them.
        trace: history.
    """

    xs: np.ndarray
    us: np.ndarray
    K: np.ndarray
    k: np.ndarray
    Vx: np.ndarray
    Vxx: np.ndarray
    cost: np.ndarray
    status: np.ndarray
    iterations: np.ndarray
    gradient: np.ndarray
    min_pivot: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    trace: Trace

    @property
    def converged(self) -> np.ndarray:
        """Whether |Q_u| is within its tolerance and the cost felt the controls (B,)."""
        return np.asarray(self.status == Status.CONVERGED)

    @property
    def positive_definite(self) -> np.ndarray:
        """Whether Q_uu, without regularisation, is positive definite at every step (B,)."""
        return np.asarray(self.min_pivot > 0.0)

    def select(self, index: int) -> "Result":
        """Problem ``index`` alone, without the batch axis."""
        index = whole("index", index, -len(self.status), len(self.status) - 1)
        return replace(
            self,
            trace=Trace(**{f.name: getattr(self.trace, f.name)[index] for f in fields(Trace)}),
            **{f.name: getattr(self, f.name)[index] for f in fields(Result) if f.name != "trace"},
        )
