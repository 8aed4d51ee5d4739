"""How a world's step ended, as the integers that kernels write; `slcp_warp.Status` says what they mean."""

SOLVED = 0
NOT_CONVERGED = 1
INFEASIBLE = 2
NONFINITE = 3
JAMMED = 4
