"""Many starts as a job: a chunk solves some of them under every schedule, and keeps all that a result has."""

import os
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from slcp_warp.ensembles.stored.identity import told
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.runs.job import Columns, Job, Plain, makes_jobs, reference_to
from slcp_warp.runs.store import Store

from ..identity import device_kind, problem_identity
from ..options import Options, Regularization
from ..problem import Problem
from ..results.result import ARRAYS, PASSES, Result
from ..results.status import Status
from ..results.trace import Trace
from ..workspace import Workspace
from .travel import digest_of, read_starts, write_starts

FILE = "starts.npz"


@dataclass(frozen=True)
class Starts:
    """What is solved.

    Attributes:
        problem: one for all.
        x0: (nx,).
        us: (S, N, nu).
        options: of the solver; its regularisation is not used.
        schedules: M of them.
    """

    problem: Problem
    x0: np.ndarray
    us: np.ndarray
    options: Options
    schedules: Regularization

    def solve(self, workspace: type = Workspace) -> Result:
        """Every start under every schedule, in one batch (S M)."""
        rows = self.schedules.rows()
        tiled = Regularization.of(np.tile(rows, (len(self.us), 1)))
        options = replace(self.options, regularization=tiled)
        solver = workspace(self.problem, len(self.us) * len(rows), options)
        found: Result = solver.solve(self.x0, np.repeat(self.us, len(rows), axis=0))
        return found

    def some(self, first: int, count: int) -> "Starts":
        """`count` of them from number `first` on."""
        return replace(self, us=self.us[first : first + count])


class MultistartJob(Job):
    """Chunks of `chunk` starts each."""

    kind = "multistart"

    def __init__(self, starts: Starts, chunk: int, folder: str | os.PathLike[str] | None = None) -> None:
        self.starts, self.chunk, self.folder = starts, chunk, folder
        self.count = -(-len(starts.us) // chunk)
        self.device = device_kind(starts.problem.dynamics)
        check_shared(starts.problem)

    def specification(self) -> Plain:
        """Problem, start states, controls, options and schedules."""
        options = asdict(self.starts.options)
        options.pop("regularization")
        return {
            "problem": problem_identity(self.starts.problem), "x0": told(self.starts.x0, "x0"),
            "starts": told(self.starts.us, "starts"), "options": told(options, "options"),
            "schedules": told(self.starts.schedules.rows(), "schedules"),
        }  # fmt: skip

    def layout(self) -> Plain:
        """So many starts a chunk."""
        return {"starts": self.chunk}

    def pack(self) -> None:
        """Write what workers read, beside the parts."""
        path = self._file()
        path.parent.mkdir(exist_ok=True)
        write_starts(path, self.starts.problem, self._arrays(), self.starts.options)

    def reference(self) -> Plain:
        """The file in the store, by its name and the digest of what is in it."""
        problem = self.starts.problem
        digest = digest_of(problem, self._arrays(), self.starts.options)
        return reference_to(multistart_job, file=str(self._file().resolve()), digest=digest, chunk=self.chunk)

    def _file(self) -> Path:
        if self.folder is None:
            raise ArgumentError("a multistart without a folder cannot be handed to other processes")
        return Path(self.folder) / "inputs" / FILE

    def _arrays(self) -> dict[str, np.ndarray]:
        return {"x0": self.starts.x0, "us": self.starts.us, "schedules": self.starts.schedules.rows()}

    def prepare(self) -> None:
        """Compile the solver's kernels."""
        quick = replace(self.starts.options, max_iterations=1, limit_rounds=0)
        replace(self.starts.some(0, 1), options=quick).solve()

    def tally(self, columns: Columns) -> dict[str, int]:
        """Problems, and how many of them converged."""
        converged = columns["status"] == Status.CONVERGED
        return {"rows": len(converged), "converged": int(converged.sum())}

    def run(self, index: int) -> Columns:
        """All arrays of the results; traces with a row for every pass that the options allow."""
        result = self.starts.some(index * self.chunk, self.chunk).solve()
        columns = {name: getattr(result, name) for name in ARRAYS}
        passes, most = result.trace.cost.shape[1], self.starts.options.max_iterations + 1
        for name in PASSES:
            whole = np.full((len(result.cost), most), np.nan)
            whole[:, :passes] = getattr(result.trace, name)
            columns[f"trace_{name}"] = whole
        return columns | {"passes": np.full(len(result.cost), passes)}


def result_of(problem: Problem, store: Store) -> Result:
    """The results of the chunks that are finished, as one batch."""
    tables = [store.table(index) for index in store.finished()]
    columns = {name: np.concatenate([t[name] for t in tables]) for name in tables[0]}
    passes = int(columns["passes"].max())
    trace = Trace(**{name: np.ascontiguousarray(columns[f"trace_{name}"][:, :passes]) for name in PASSES})
    arrays: dict[str, Any] = {name: columns[name] for name in ARRAYS}
    limits = None if problem.state_limits is None else problem.state_limit_rows()
    return Result(**arrays, trace=trace, simulated=problem.simulated(), state_limits=limits)


def check_shared(problem: Problem) -> None:
    """Raise ArgumentError where problems have numbers of their own: chunks have one set for all."""
    rows = {
        "control_limits": len(problem.limit_rows()[0]), "state_limits": len(problem.state_limit_rows()[0]),
        "cost.weights": len(np.atleast_2d(problem.cost.weights)), "params": len(problem.param_array(1)),
    }  # fmt: skip
    for name, count in rows.items():
        if count > 1:
            raise ArgumentError(f"Problem.{name} are for {count} problems; one set for all starts is needed")


@makes_jobs
def multistart_job(file: str, digest: str, chunk: int) -> MultistartJob:
    """The job of a file that `MultistartJob.pack` wrote."""
    problem, arrays, options = read_starts(Path(file), digest)
    schedules = Regularization(*arrays["schedules"].T)
    starts = Starts(problem, arrays["x0"], arrays["us"], options, schedules)
    return MultistartJob(starts, chunk, Path(file).parents[1])
