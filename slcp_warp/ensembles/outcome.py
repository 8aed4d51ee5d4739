"""What came out of a sweep of a task: a table, a summary with intervals, comparisons of policies."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from ..inputs import checks
from ..inputs.checks import shown
from ..inputs.errors import ArgumentError
from ..options import Status
from ..runs.parts import in_memory
from ..storage.printed import COLUMNS, Printed, Table, counted, percent, percents
from ..tasks.task import Task
from .chunks import ARMS, KEYS
from .statistics import files
from .statistics.intervals import Interval
from .statistics.reductions import differences, paired_blocks, quantiles_of_part, summary_of_part
from .statistics.same_worlds import unlike
from .statistics.sensitivity import Sensitivity, sensitivity_of_rows
from .statistics.sequential import RunningDifference
from .statistics.source import Key, MemorySource, Source, joined, measure_names

BYTES_OF_KEYS = 200  # of a row, as texts of NumPy
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


@dataclass(repr=False)
class Report(Printed):
    """Outcome of a sweep of a task.

    Every statistic goes through the rows block after block, in memory that does not grow with them, and is
    the same whatever chunks the sweep ran in.

    Attributes:
        task: what was run; None for a table that does not say.
        source: the rows, part by part; a part is what one of the policies did in one case, at one step size
            and in one arm, named by these (`KEYS`).
        complete: False if interrupted; then only finished worlds are in.
    """

    task: Task | None
    source: Source = field(default_factory=MemorySource)
    complete: bool = True

    @property
    def measures(self) -> tuple[str, ...]:
        """The names of the measures, and "failure_time" where something ends a run."""
        if self.task is None:
            return measure_names(self.source)
        return (*self.task.measures, *(("failure_time",) if self.task.failure is not None else ()))

    @property
    def parts(self) -> list[dict[str, Any]]:
        """The rows of every part: a dict with `KEYS` and the part's columns. It takes memory for all rows.

        Raises:
            ArgumentError: there is not so much.
        """
        self._check_memory("Report.parts")
        return [dict(zip(KEYS, key)) | {"columns": self._columns(key)} for key in self.source.keys]

    @property
    def table(self) -> dict[str, np.ndarray]:
        """Tidy columns, one row a world: `KEYS`, world, what was drawn, measures, success, status.

        "start_overlap" is how deep rows overlap where the world begins [m, rad], of those that can act in its
        first step (NaN: that begins with no numbers); "unsolved_time" is when the step begins that was not
        solved [s], after which the world stands still (infinite: all were).

        It takes memory for all rows; `dataset` does not.

        Raises:
            ArgumentError: there is not so much.
        """
        self._check_memory("Report.table")
        return files.table(self.source)

    def dataset(self) -> Any:
        """The table as a `pyarrow.dataset`, of which only what is asked for is read.

        Raises:
            ImportError: pyarrow is not installed; the message says how to.
        """
        own = getattr(self.source, "dataset", None)
        return own() if own is not None else in_memory(self.table)

    def _check_memory(self, what: str) -> None:
        """Raise an error unless all rows fit: joined from their blocks, beside what is there already."""
        need = 0
        for key in self.source.keys:
            need += 2 * self.source.worlds(key) * (8 * len(self.source.names(key)) + BYTES_OF_KEYS)
        checks.memory(f"{what}: the rows", need, 1, wp.get_device("cpu"))

    def _columns(self, key: Key) -> dict[str, np.ndarray]:
        blocks = list(self.source.blocks(key))
        return joined(blocks) if blocks else {name: np.zeros(0) for name in self.source.names(key)}

    @property
    def summary(self) -> list[dict[str, Any]]:
        """A row a part: worlds, success with its 95 % interval (Wilson), mean of every measure, statuses.

        `overlapping` has the number of `worlds` that begin in overlap, by 1e-6 and more, and the `deepest`
        [m, rad]; it is empty where the rows do not say.
        Means are over the worlds where the measure is finite; `finite` says by name in how many it is. A mean
        of `first_time` or `settled` leaves out the worlds that never get there: `quantiles` counts them.
        """
        return [
            dict(zip(KEYS, key)) | summary_of_part(self.source, key, self.measures)
            for key in self.source.keys
        ]

    def quantiles(self, probabilities: Sequence[float] = QUANTILES) -> list[dict[str, Any]]:
        """A row a part: for every measure its quantiles, {probability: (value, low, high)}.

        Exact order statistics of the solved worlds, with their 95 % intervals; infinite values count.

        Args:
            probabilities: in [0, 1].
        """
        wanted = tuple(checks.number("probabilities", q, 0.0, 1.0) for q in _several(probabilities))
        return [
            dict(zip(KEYS, key)) | quantiles_of_part(self.source, key, self.measures, wanted)
            for key in self.source.keys
        ]

    def key(self, policy: str, case: str | None = None, step_size: float | None = None,
            arm: str = "disturbed") -> Key:  # fmt: skip
        """The part of a policy; case and step size None: the first."""
        for name, value in (("policy", policy), ("case", "" if case is None else case), ("arm", arm)):
            checks.instance(name, value, str, "a text")
        step_size = None if step_size is None else checks.number("step_size", step_size)
        left = list(self.source.keys)
        wanted: dict[str, Any] = {"policy": policy, "case": case, "step_size": step_size, "arm": arm}
        for name in ("policy", "arm", "case", "step_size"):
            place, value = KEYS.index(name), wanted[name]
            there = list(dict.fromkeys(key[place] for key in left))
            left = [key for key in left if value is None or key[place] == value]
            if not left:
                raise ArgumentError(f"{name} is {shown(value)}; choose from {shown(there)}")
        return left[0]

    def _only(self, policy: str, case: str | None, step_size: float | None) -> Key:
        """As `key`, with a warning where several may be meant."""
        found = self.key(policy, case, step_size)
        for name, given in (("case", case), ("step_size", step_size)):
            at = KEYS.index(name)
            there = dict.fromkeys(k[at] for k in self.source.keys if (k[0], k[3]) == (policy, found[3]))
            if given is None and len(there) > 1:
                warnings.warn(
                    f"Report.compare: of {name} {', '.join(map(str, there))} it is of {found[at]}; {name}= "
                    "says of which",
                    RuntimeWarning,
                    stacklevel=3,
                )
        return found

    def part(self, policy: str, case: str | None = None, step_size: float | None = None,
             arm: str = "disturbed") -> dict[str, np.ndarray]:  # fmt: skip
        """Columns of one part; case and step size None: the first."""
        return self._columns(self.key(policy, case, step_size, arm))

    def compare(
        self,
        first: str,
        second: str,
        case: str | None = None,
        step_size: float | None = None,
        peeking: bool = False,
        *,
        other: "Report | None" = None,
    ) -> dict[str, Interval]:
        """Differences first - second in the same worlds: (mean, low, high) with 95 % intervals.

        Of success (as 0 and 1) and of every measure, over the worlds where both are finite; case and step
        size None: the first, and a RuntimeWarning where there are several. With `other` the second policy is
        that report's: of another task, whose scene is another design, in worlds of the same numbers, which of
        one seed are the same draws of what both disturb; of the measures that both have. The intervals are
        for one look at a number of worlds that was chosen before; with `peeking` they are wider, and hold for
        one who looks while a sweep runs and stops when he likes: of success exactly, of means for many
        worlds, unless few of them make the mean (`compare_sequentially` has medians and bounded means, which
        hold for every law).
        """
        checks.instance("other", other, Report | None, "a Report")
        there = self if other is None else other
        a = self._only(first, case, step_size)
        checks.instance("policy", second, str, "a text")
        alike = [k for k in there.source.keys if k[0] == second and k[1:] == a[1:]]
        b = there.key(second, case, step_size) if not alike else alike[0]
        if a[1:] != b[1:]:
            warnings.warn(f"Report.compare: {a} and {b} are of other cases or step sizes", RuntimeWarning,
                          stacklevel=2)  # fmt: skip
        if there is not self and (apart := unlike(self.source, a, there.source, b)):
            warnings.warn(
                f"Report.compare: {', '.join(apart)} of worlds of the same number differ: of another seed or "
                "another law, they are not the same worlds",
                RuntimeWarning,
                stacklevel=2,
            )
        names = ("success", *(name for name in self.measures if name in there.measures))
        if not checks.flag("peeking", peeking):
            return differences(self.source, a, b, names, there.source)
        running = {name: RunningDifference(name, 0.05) for name in names}
        for rows in paired_blocks(self.source, a, b, names, there.source):
            for known in running.values():
                known.add(*rows)
        return {name: known.interval() for name, known in running.items()}

    def sensitivity(
        self,
        measure: str = "success",
        policy: str | None = None,
        case: str | None = None,
        step_size: float | None = None,
    ) -> Sensitivity:
        """Which drawn numbers matter: indices of first order from the rows, without running anything.

        What is not in the table as a column (noise of single steps) is not among them. Columns that share
        their random number, as mass and inertia of a body do, have one index.

        Args:
            measure: "success", or the name of a measure.
            policy, case, step_size: of the part; None: the first.
        """
        checks.choice("measure", measure, ("success", *self.measures))
        if not self.source.keys:
            raise ArgumentError("the report has no rows")
        key = self.key(self.source.keys[0][0] if policy is None else policy, case, step_size)
        return sensitivity_of_rows(self.source, key, measure)

    def save(self, path: str | Path) -> Path:
        """Write the table as .csv, or with all that `load` needs as .npz or .parquet (extra `data`).

        The file is replaced only once complete. A task whose cost or measures are functions is left out: the
        report that is loaded has the names of its measures, and no task. A .csv does not say that a sweep was
        interrupted, which is a RuntimeWarning.
        """
        path = checks.path("path", path)
        if path.suffix != ".csv":
            self._check_memory("Report.save")
        elif not self.complete:
            warnings.warn(
                f"{path} will not say that the sweep was interrupted; .npz and .parquet do",
                RuntimeWarning,
                stacklevel=2,
            )
        files.write(path, self.source, self.task, self.complete)
        return path

    @classmethod
    def load(cls, path: str | Path) -> "Report":
        """Read a file that `save` wrote. A .csv holds rows only: the report has no task, and is complete
        where no world is missing.

        Raises:
            FileNotFoundError: not there.
            FileError: truncated, no report, or inconsistent.
        """
        return cls(*files.read(checks.path("path", path)))

    def _line(self) -> str:
        end = "" if self.complete else "; interrupted"
        of = "" if self.task is None else f"of task {self.task.name!r}: "
        return f"{of}{counted(len(self.source.keys), 'part')}{end}"

    def _tables(self) -> list[Table]:
        rows, summary = [], self.summary
        deep = any(row["overlapping"].get("worlds") for row in summary)
        begin = ["begin in overlap"] if deep else []
        head = [*KEYS, "worlds", *begin, "unsolved", "success, %"]
        beside = self.measures if len(head) + len(self.measures) <= COLUMNS else ()
        for row in summary:
            alone = row["arm"] != ARMS[0]  # a handful of worlds that are always the same
            success = percent(row["success"][0]) if alone else percents(row["success"])
            means = [_mean(row, name) for name in beside]
            unsolved = row["worlds"] - row["statuses"][Status.SOLVED.name]
            own = [overlap_text(row["overlapping"])] if deep else []
            rows.append((*(row[key] for key in KEYS), row["worlds"], *own, unsolved, success, *means))
        table = Table("", (*head, *(f"mean {name}" for name in beside)), rows, left=2)
        return [table] if beside or not self.measures else [table, *means_of_parts(summary, self.measures)]


def means_of_parts(summary: list[dict[str, Any]], measures: Sequence[str]) -> list[Table]:
    """A row a measure, a column a part: of measures that are too many to stand beside their parts; or the
    other way round where that fits and this does not, or several tables.
    """
    several = len({row["step_size"] for row in summary}) > 1
    parts = []
    for row in summary:
        words = [row["policy"], row["case"], *([f"h = {row['step_size']:g}"] if several else [])]
        parts.append(", ".join(words + ([] if row["arm"] == ARMS[0] else [row["arm"]])))
    most = COLUMNS - 1
    if len(parts) > most >= len(measures):
        turned = [(part, *(_mean(row, name) for name in measures)) for part, row in zip(parts, summary)]
        return [Table("", ("mean of", *measures), turned)]
    return [
        Table("", ("mean of", *parts[i : i + most]),
              [(name, *(_mean(row, name) for row in summary[i : i + most])) for name in measures])
        for i in range(0, len(parts), most)
    ]  # fmt: skip


def _mean(row: dict[str, Any], name: str) -> Any:
    """A measure's mean, and over how many worlds where it is not finite in all."""
    mean, count = row[name][0], row["finite"][name]
    if not count:
        return "none finite"
    return mean if count == row["worlds"] else f"{mean:.4g} of {count}"


def overlap_text(found: dict[str, Any]) -> str:
    """How many worlds begin in overlap, and how deep, of a row of `Report.summary`."""
    if not found.get("worlds"):
        return "0" if found else "unknown"
    return f"{found['worlds']:,}, to {found['deepest']:.2g}"


def _several(values: Any) -> Any:
    if isinstance(values, list | tuple) or (isinstance(values, np.ndarray) and values.ndim == 1):
        if len(values):
            return values
    raise ArgumentError(f"probabilities is {shown(values)}; at least one, in a tuple, is needed")
