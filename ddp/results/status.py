"""Why the solver stopped, per problem."""

from enum import IntEnum

from slcp_warp.kernels.control import status as codes


class Status(IntEnum):
    """Outcome of one problem; ``result.status`` holds these as integers."""

    RUNNING = codes.RUNNING
    CONVERGED = codes.CONVERGED
    SMALL_IMPROVEMENT = codes.SMALL_IMPROVEMENT
    MAX_ITERATIONS = codes.MAX_ITERATIONS
    REGULARIZATION_LIMIT = codes.REGULARIZATION_LIMIT
    LINE_SEARCH_FAILED = codes.LINE_SEARCH_FAILED
    DYNAMICS_FAILED = codes.DYNAMICS_FAILED
    FLAT = codes.FLAT
    STATE_LIMITS = codes.STATE_LIMITS

    @property
    def explanation(self) -> str:
        """One sentence for people."""
        return _EXPLANATIONS[self]


_EXPLANATIONS = {
    Status.RUNNING: "still running",
    Status.CONVERGED: "|Q_u| is within the gradient tolerance, relative to the size of its terms",
    Status.SMALL_IMPROVEMENT: "the last improvement is within its tolerance, or the next drowns in rounding",
    Status.MAX_ITERATIONS: "stopped before it converged: all passes are made, or it was told to end",
    Status.REGULARIZATION_LIMIT: "Q_uu is not positive definite at the largest regularisation",
    Status.LINE_SEARCH_FAILED: "no step size lowers the cost at the largest regularisation",
    Status.DYNAMICS_FAILED: "the dynamics, the cost or their derivatives failed or were not finite",
    Status.STATE_LIMITS: "a state is beyond its limits where passes ended",
    Status.FLAT: "nothing can be felt from here: the controls do not reach what the cost would gain from",
}
