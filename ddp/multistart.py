"""Many starts and regularisation schedules for one initial state, solved as one batch."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from slcp_warp.inputs.checks import array, instance
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.storage.printed import Printed

from .options import Options, Regularization
from .problem import Problem
from .results.result import Result
from .workspace import Workspace

SCHEDULES = Regularization(  # the same start ends in different minima under these
    initial=np.array([1.0e-6, 1.0e-3, 1.0, 10.0, 1.0e-3, 1.0, 1.0e-3, 1.0]),
    factor=np.array([1.6, 2.0, 1.6, 2.0, 2.0, 1.6, 1.6, 2.0]),
    state_weight=np.array([1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0]),
    control_weight=np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.1]),
)


@dataclass(frozen=True, repr=False)
class Multistart(Printed):
    """Outcome of `solve_multistart`.

    Attributes:
        best: the converged problem of lowest cost; of all of them where none converged.
        index: its place in ``all``: start index // schedules, schedule index % schedules.
        all: every start under every schedule.
    """

    best: Result
    index: int
    all: Result

    def _line(self) -> str:
        return f"the best is number {self.index}; {repr(self.all)[1:-1]}"


def solve_multistart(
    problem: Problem,
    x0: Any,
    starts: Any,
    options: Options | None = None,
    schedules: Regularization = SCHEDULES,
) -> Multistart:
    """Solve from one state with every start under every schedule, in one batch; keep the best.

    Args:
        problem: its params shared by all.
        x0: initial state (nx,).
        starts: controls (S, N, nu) or (N, nu).
        options: ``regularization`` is replaced by ``schedules``.
        schedules: a `Regularization` with fields of length M.
    """
    instance("problem", problem, Problem, "a ddp.Problem")
    instance("options", options, Options | None, "a ddp.Options")
    instance("schedules", schedules, Regularization, "a ddp.Regularization")
    starts = array("starts", starts)
    starts = starts[None] if starts.ndim == 2 else starts
    if starts.shape[1:] != (problem.horizon, problem.nu) or not len(starts):
        need = f"{problem.horizon}, {problem.nu}"
        raise ArgumentError(f"starts must have shape (S, {need}) or ({need}), got {starts.shape}")
    x0 = array("x0", x0)
    if x0.shape != (problem.nx,):
        raise ArgumentError(f"x0 must have shape ({problem.nx},), got {x0.shape}")
    rows = schedules.rows()
    batch = len(starts) * len(rows)
    initial, factor, minimum, maximum, state_weight, control_weight = np.tile(rows, (len(starts), 1)).T
    tiled = Regularization(initial, factor, minimum, maximum, state_weight, control_weight)
    workspace = Workspace(problem, batch, replace(options or Options(), regularization=tiled))
    result = workspace.solve(x0, np.repeat(starts, len(rows), axis=0))
    ranked = np.where(result.converged, result.cost, np.inf)
    index = int(np.argmin(ranked if np.isfinite(ranked).any() else result.cost))
    return Multistart(result.select(index), index, result)
