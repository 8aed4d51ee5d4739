"""The outcome of a sweep."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..inputs import checks
from ..inputs.errors import ArgumentError
from ..storage.printed import Printed, Table, counted
from . import store


@dataclass(repr=False)
class SweepReport(Printed):
    """Outcome of a sweep.

    Attributes:
        cases: one summary per (residual, step_size): counts, statuses and (value, low, high) with 95 %
            intervals.
        table: tidy columns, one row per world and case.
        samples: per case, (B, S) the observed coordinate less its start.
        spec: the specification.
        complete: False if interrupted; then only finished worlds are in.
    """

    cases: list[dict[str, Any]]
    table: dict[str, np.ndarray]
    samples: list[np.ndarray]
    spec: dict[str, Any]
    complete: bool = True

    def _line(self) -> str:
        scene = self.spec.get("scene")
        of = f"of {scene!r}: " if isinstance(scene, str) else ""
        worlds = sum(int(case.get("worlds", 0)) for case in self.cases)
        return f"{of}{counted(len(self.cases), 'case')}, {worlds:,} runs" + (
            "" if self.complete else "; interrupted"
        )

    def _tables(self) -> list[Table]:
        names = list(
            dict.fromkeys(n for case in self.cases for n, v in case.items() if not isinstance(v, dict))
        )
        rows = [[case.get(name) for name in names] for case in self.cases]
        return [Table("cases: value, low and high of 95 %", names, rows)]

    def save(self, path: str | Path) -> Path:
        """Write .csv (the table) or .npz (everything, no pickle); replaced only once complete."""
        path = checks.path("path", path)
        if path.suffix == ".csv":
            store.save_table(path, self.table)
        elif path.suffix == ".npz":
            store.write(path, self.cases, self.table, self.samples, self.spec, self.complete)
        else:
            raise ArgumentError(f"path {path} ends in {path.suffix!r}; .csv or .npz is needed")
        return path

    @classmethod
    def load(cls, path: str | Path) -> "SweepReport":
        """Read an .npz written by `save`.

        Raises:
            FileNotFoundError: not there.
            FileError: truncated, not a sweep, or inconsistent.
        """
        return cls(*store.read(path))
