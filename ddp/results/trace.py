"""The history of a solve."""

from dataclasses import dataclass, fields

import numpy as np

from slcp_warp.kernels.control import status as codes
from slcp_warp.storage.printed import Arrays


@dataclass(frozen=True, repr=False)
class Trace(Arrays):
    """One row a pass (B, passes + 1), NaN where a problem had already stopped.

    Attributes:
        cost: cost after the pass, with what is paid for state limits in its round (M46).
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

    def then(self, after: "Trace") -> "Trace":
        """The passes of one problem and those of a solve that went on from its end, whose row comes once."""
        written = [np.isfinite(each.gradient) for each in (self, after)]
        last = np.flatnonzero(written[0])[-1:]
        written[0][last] = np.isfinite(self.step_size[last])  # else no pass, but where the second one begins
        columns = ((f.name, getattr(self, f.name), getattr(after, f.name)) for f in fields(self))
        return Trace(**{name: np.concatenate([a[written[0]], b[written[1]]]) for name, a, b in columns})

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
