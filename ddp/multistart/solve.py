"""Many starts and regularisation schedules for one initial state, solved as one batch."""

import os
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from slcp_warp.inputs.checks import array, instance, whole
from slcp_warp.inputs.checks import path as checked_path
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.runs.manifest import NAME as MANIFEST
from slcp_warp.runs.progress import Progress
from slcp_warp.runs.running import run
from slcp_warp.runs.store import Store
from slcp_warp.storage.printed import Printed

from ..options import Options, Regularization
from ..problem import Problem
from ..results.result import Result
from ..results.status import Status
from ..workspace import Workspace
from .chunks import MultistartJob, Starts, result_of

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
        best: the converged problem of lowest cost; where none converged of those that keep their limits of
            states, and where none does of all.
        index: its place in ``all``: start index // schedules, schedule index % schedules.
        all: every start under every schedule.
        complete: False if it was ended; then only finished starts are in.
    """

    best: Result
    index: int
    all: Result
    complete: bool = True

    def _line(self) -> str:
        return f"the best is number {self.index}; {repr(self.all)[1:-1]}"


def solve_multistart(
    problem: Problem,
    x0: Any,
    starts: Any,
    options: Options | None = None,
    schedules: Regularization = SCHEDULES,
    *,
    out: str | os.PathLike[str] | None = None,
    executor: Any = None,
    chunk: int | None = None,
    progress: Progress | None = None,
) -> Multistart:
    """Solve from one state with every start under every schedule, and keep the best.

    All are one batch. With ``out`` or ``executor`` they are solved in chunks instead, to the same numbers:
    finished chunks are kept in the folder, and the same call goes on from there; an executor spreads them.

    Args:
        problem: its params shared by all.
        x0: initial state (nx,).
        starts: controls (S, N, nu) or (N, nu).
        options: ``regularization`` is replaced by ``schedules``.
        schedules: a `Regularization` with fields of length M.
        out: a folder for finished chunks (needs the extra `data`); one of other starts is refused.
        executor: `slcp_warp.runs.processes` and the like. Dynamics and cost have to be of functions that
            other processes can import; a simulator, and costs but `plain`, are.
        chunk: starts of a chunk; None: as the folder has it, else one.
        progress: called with a `slcp_warp.runs.Standing` after every chunk.

    Ctrl-C and SIGTERM end it, with ``out`` or ``executor``, between chunks: what is finished comes back
    (`complete` False).
    """
    given = _given(problem, x0, starts, options, schedules)
    if out is None and executor is None:
        return _best(given.solve(Workspace))
    if out is not None:
        return _in_chunks(given, checked_path("out", out), executor, chunk, progress)
    with tempfile.TemporaryDirectory(prefix="multistart-") as folder:
        return _in_chunks(given, Path(folder), executor, chunk, progress)


def _given(problem: Any, x0: Any, starts: Any, options: Any, schedules: Any) -> Starts:
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
    return Starts(problem, x0, starts, options or Options(), schedules)


def _in_chunks(
    given: Starts, folder: Path, executor: Any, chunk: int | None, progress: Progress | None
) -> Multistart:
    if chunk is None and (folder / MANIFEST).exists():
        kept = Store(folder).manifest.layout.get("starts")
        chunk = kept if isinstance(kept, int) and kept > 0 else 1
    job = MultistartJob(given, whole("chunk", 1 if chunk is None else chunk), folder)
    store = Store.open(folder, job)
    if executor is not None:
        job.pack()
    outcome = run(job, store, executor, progress)
    if not store.finished():
        raise KeyboardInterrupt
    return replace(_best(result_of(given.problem, store)), complete=outcome.complete)


def _best(result: Result) -> Multistart:
    for good in (result.converged, result.status != Status.STATE_LIMITS, np.full(len(result.cost), True)):
        ranked = np.where(good, result.cost, np.inf)
        if np.isfinite(ranked).any():
            break
    index = int(np.argmin(ranked))
    return Multistart(result.select(index), index, result)
