"""What the solver returns."""

import os
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from slcp_warp.inputs.checks import whole
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.results.records import Record, read_record
from slcp_warp.results.simulated import Simulated
from slcp_warp.storage.files import FileError, reading
from slcp_warp.storage.printed import Printed, Table, counted

from .excess import Limits, excess, worst
from .plan_check import PLAN, STATE_LIMITS, check_plan
from .status import Status
from .trace import Trace

DELAY = "delay"  # entry of a plan's header


@dataclass(frozen=True, repr=False)
class Result(Printed):
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
        trace: history; its costs are with what is paid for `state_limits` at the time, unlike `cost`.
        simulated: scene, options and parameters that were planned with; None: dynamics of one's own.
        header: further entries of its file, JSON values; see `delay`.
        state_limits: of the problem, lower and upper (1 or B, nx), infinite where there is none; None: none.
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
    simulated: Simulated | None = None
    header: dict[str, Any] = field(default_factory=dict)
    state_limits: Limits | None = None

    @property
    def converged(self) -> np.ndarray:
        """Whether |Q_u| is within its tolerance and the cost felt the controls (B,)."""
        return np.asarray(self.status == Status.CONVERGED)

    @property
    def positive_definite(self) -> np.ndarray:
        """Whether Q_uu, without regularisation, is positive definite at every step (B,)."""
        return np.asarray(self.min_pivot > 0.0)

    def beyond_limits(self) -> str | list[str]:
        """Which state is furthest beyond its limits, by how much and when, in words ("" where none is); of a
        batch for every problem.
        """
        if self.state_limits is None:
            return [""] * len(self.xs) if self.batched else ""
        names = step_size = None
        if self.simulated is not None:
            names, step_size = self.simulated.scene.state_names, self.simulated.step_size
        found = worst(self.xs if self.batched else self.xs[None], self.state_limits)
        lines = ["" if each is None else each.text(names, step_size) for each in found]
        return lines if self.batched else lines[0]

    def keeps_limits(self, tolerance: float) -> np.ndarray:
        """Whether no state is beyond its limits by more than that, relative to max(1, |limit|) (B,)."""
        if self.state_limits is None:
            return np.ones(np.shape(self.status), dtype=bool)
        relative = excess(self.xs if self.batched else self.xs[None], self.state_limits)[1]
        return np.reshape(relative.max((1, 2)) <= tolerance, np.shape(self.status))

    def _limits_of(self, index: int) -> Limits | None:
        """The state limits of one problem."""
        if self.state_limits is None or len(self.state_limits[0]) == 1:
            return self.state_limits
        lower, upper = (a[index][None] for a in self.state_limits)
        return lower, upper

    @property
    def delay(self) -> int:
        """Steps after which a control acts that is sent: none acts in the first so many of `us`, and
        `TrackingPolicy` sends the others as much earlier. Vx and Vxx are NaN in these steps.
        """
        return whole("header['delay']", self.header.get(DELAY, 0), 0, self.us.shape[-2] - 1)

    def as_batch(self) -> "Result":
        """This result of one problem as a batch of one."""
        own: dict[str, Any] = {name: np.asarray(getattr(self, name))[None] for name in ARRAYS}
        trace = Trace(**{name: np.asarray(getattr(self.trace, name))[None] for name in PASSES})
        return replace(self, trace=trace, **own)

    def select(self, index: int) -> "Result":
        """Problem ``index`` alone, without the batch axis."""
        index = whole("index", index, -len(self.status), len(self.status) - 1)
        return replace(
            self,
            trace=Trace(**{name: getattr(self.trace, name)[index] for name in PASSES}),
            simulated=None if self.simulated is None else self.simulated.select(index),
            state_limits=self._limits_of(index),
            **{name: getattr(self, name)[index] for name in ARRAYS},
        )

    def after(self, before: "Result | None") -> "Result":
        """This result of one problem with the passes of the solve that it went on from; None: of none."""
        if before is None:
            return self
        return replace(
            self, iterations=before.iterations + self.iterations, trace=before.trace.then(self.trace)
        )

    @property
    def batched(self) -> bool:
        """Whether there is an axis of problems."""
        return self.xs.ndim == 3

    def record(self) -> Record:
        """What its file holds.

        Raises:
            ArgumentError: dynamics of one's own, which a file cannot hold.
        """
        if self.simulated is None:
            raise ArgumentError(
                "this plan was made for dynamics of one's own; files hold plans of simulators"
            )
        arrays = {name: np.asarray(getattr(self, name)) for name in ARRAYS}
        arrays |= {f"trace_{name}": getattr(self.trace, name) for name in PASSES}
        if self.state_limits is not None:
            arrays |= dict(zip(STATE_LIMITS, self.state_limits, strict=True))
        return Record("plan", arrays, self.simulated, {"horizon": self.us.shape[-2]} | self.header)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write an .npz file, with scene, options and parameters; replaced only once complete."""
        return self.record().save(path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Result":
        """Read a file of `save` or of `slcp optimise`.

        Raises:
            FileError: truncated, no plan, of a newer version, or inconsistent.
            FileNotFoundError: no such file.
        """
        record = read_record(path, "plan", PLAN, check_plan)
        with reading(path, "a plan", FileError):
            return cls.of(record)

    @classmethod
    def of(cls, record: Record) -> "Result":
        """The result that a plan file holds."""
        values: dict[str, Any] = {name: record.arrays[name] for name in ARRAYS if name in record.arrays}
        for name, none in (("lower", -np.inf), ("upper", np.inf)):  # of files that state no limits
            values.setdefault(name, np.full(np.delete(record["us"].shape, -2), none))
        trace = Trace(**{name: record[f"trace_{name}"] for name in PASSES})
        found = cls(**values, trace=trace, simulated=record.simulated, header=record.facts())
        if STATE_LIMITS[0] in record.arrays:
            lower, upper = (record[name] for name in STATE_LIMITS)
            found = replace(found, state_limits=(lower, upper))
        steps = found.us.shape[-2]
        if found.header.get("horizon", steps) != steps:
            raise FileError(f"its header: horizon is {found.header['horizon']!r:.60}; it holds {steps} steps")
        try:
            whole("header['delay']", found.delay, 0)
        except ValueError as error:
            raise FileError(str(error)) from None
        return found

    def _line(self) -> str:
        codes, counts = np.unique(np.ravel(self.status), return_counts=True)
        ends = ", ".join(f"{n:,} {Status(int(code)).name}" for code, n in zip(codes, counts))
        of = "" if self.simulated is None else f"{self.simulated.scene.name!r}, "
        what = counted(len(self.xs) if self.batched else 1, "problem")
        best = f"cost {np.min(self.cost):.6g}" + (" at best" if self.batched else "")
        line = f"{of}{what}, {self.us.shape[-2]} steps: {ends}; {best}"
        if self.batched or bool(np.all(self.keeps_limits(LIMIT_TOLERANCE))):
            return line
        return f"{line}; beyond its limits {self.beyond_limits()}"

    def _tables(self) -> list[Table]:
        names = ("cost", "iterations", "gradient", "min_pivot")
        columns = [np.ravel(getattr(self, name)) for name in names]
        ends = [Status(int(code)).name for code in np.ravel(self.status)]
        rows = [(i, end, *(c[i].item() for c in columns)) for i, end in enumerate(ends)]
        if self.state_limits is None:
            return [Table("", ("problem", "status", *names), rows, left=2)]
        beyond = self.beyond_limits() if self.batched else [self.beyond_limits()]
        keeps = np.ravel(self.keeps_limits(LIMIT_TOLERANCE))
        rows = [(*row, "" if kept else what) for row, what, kept in zip(rows, beyond, keeps, strict=True)]
        return [Table("", ("problem", "status", *names, "beyond its limits"), rows, left=2)]


LIMIT_TOLERANCE = 1e-3  # of `Options.limit_tolerance`: what is nearer to its limits is not printed
PASSES = tuple(f.name for f in fields(Trace))
APART = ("trace", "simulated", "header", "state_limits")  # have no axis of problems, or are no arrays
ARRAYS = tuple(f.name for f in fields(Result) if f.name not in APART)
