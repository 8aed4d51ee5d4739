"""What came out of a sweep of a task: a table, a summary with intervals, comparisons of policies."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..inputs import checks
from ..inputs.checks import shown
from ..inputs.errors import ArgumentError
from ..options import Status
from ..storage.printed import Printed, Table, counted
from ..tasks.task import Task
from . import store
from .chunks import KEYS
from .statistics import mean_interval, share_interval


def paired(
    first: Mapping[str, np.ndarray], second: Mapping[str, np.ndarray], names: Sequence[str]
) -> dict[str, tuple[float, float, float]]:
    """Mean differences first - second of columns of the same worlds, with 95 % intervals.

    Over the worlds where both are finite.
    """
    out = {}
    for name in names:
        a, b = (np.asarray(each[name], float) for each in (first, second))
        both = np.isfinite(a) & np.isfinite(b)
        out[name] = mean_interval(a[both] - b[both])
    return out


@dataclass(repr=False)
class Report(Printed):
    """Outcome of a sweep of a task.

    Attributes:
        task: what was run.
        parts: a dict of columns for every policy, case, step size and arm, with these under `KEYS`.
        complete: False if interrupted; then only finished worlds are in.
    """

    task: Task
    parts: list[dict[str, Any]] = field(default_factory=list)
    complete: bool = True

    def add(self, policy: str, case: str, step_size: float, arm: str, columns: dict[str, np.ndarray]) -> None:
        """One more part."""
        self.parts.append(dict(zip(KEYS, (policy, case, float(step_size), arm))) | {"columns": columns})

    @property
    def table(self) -> dict[str, np.ndarray]:
        """Tidy columns, one row a world: `KEYS`, world, what was drawn, measures, success, status."""
        if not self.parts:
            return {}
        names = list(dict.fromkeys(name for part in self.parts for name in part["columns"]))
        out: dict[str, list[np.ndarray]] = {name: [] for name in (*KEYS, *names)}
        for part in self.parts:
            count = len(part["columns"]["world"])
            for key in KEYS:
                out[key].append(np.full(count, part[key]))
            for name in names:
                out[name].append(part["columns"].get(name, np.full(count, np.nan)))
        return {name: np.concatenate(values) for name, values in out.items()}

    @property
    def summary(self) -> list[dict[str, Any]]:
        """A row a part: worlds, success with its 95 % interval (Wilson), mean of every measure, statuses."""
        rows = []
        for part in self.parts:
            columns = part["columns"]
            count = len(columns["world"])
            row = {key: part[key] for key in KEYS} | {"worlds": count}
            row["success"] = share_interval(int(columns["success"].sum()), count)
            row |= {name: mean_interval(columns[name]) for name in self.task.measures}
            row["statuses"] = {s.name: int((columns["status"] == s).sum()) for s in Status}
            rows.append(row)
        return rows

    def part(self, policy: str, case: str | None = None, step_size: float | None = None,
             arm: str = "disturbed") -> dict[str, np.ndarray]:  # fmt: skip
        """Columns of one part; case and step size None: the first."""
        for each in self.parts:
            same = each["policy"] == policy and each["arm"] == arm
            if same and case in (None, each["case"]) and step_size in (None, each["step_size"]):
                return each["columns"]
        there = [tuple(each[key] for key in KEYS) for each in self.parts]
        raise ArgumentError(
            f"there is no {policy!r}, {case!r}, {step_size!r}, {arm!r}; there are {shown(there)}"
        )

    def compare(
        self, first: str, second: str, case: str | None = None, step_size: float | None = None
    ) -> dict[str, tuple[float, float, float]]:
        """Differences first - second in the same worlds: (mean, low, high) with 95 % intervals.

        Of success (as 0 and 1) and of every measure, over the worlds where both are finite; case and step
        size None: the first.
        """
        names = ("success", *self.task.measures)
        a, b = (self.part(policy, case, step_size) for policy in (first, second))
        count = min(len(a["world"]), len(b["world"]))  # an interrupted sweep has fewer of the last
        a, b = ({name: part[name][:count] for name in names} for part in (a, b))
        return paired(a, b, names)

    def save(self, path: str | Path) -> Path:
        """Write the table as .csv; replaced only once complete."""
        path = checks.path("path", path)
        if path.suffix != ".csv":
            raise ArgumentError(f"path {path} ends in {path.suffix!r}; .csv is needed")
        store.write_table(path, self.table)
        return path

    def _line(self) -> str:
        end = "" if self.complete else "; interrupted"
        return f"of task {self.task.name!r}: {counted(len(self.parts), 'part')}{end}"

    def _tables(self) -> list[Table]:
        rows = []
        for row in self.summary:
            share, low, high = (100.0 * value for value in row["success"])
            success = f"{share:.1f} ({low:.1f} to {high:.1f})"
            means = [row[name][0] for name in self.task.measures]
            rows.append((*(row[key] for key in KEYS), row["worlds"], success, *means))
        head = (*KEYS, "worlds", "success, %", *(f"mean {name}" for name in self.task.measures))
        return [Table("", head, rows, left=2)]
