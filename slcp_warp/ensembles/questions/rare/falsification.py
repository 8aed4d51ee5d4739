"""The smallest disturbance that was found to make a policy fail, and what it is compared with."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ....inputs.errors import ArgumentError
from ....options import Options, Status
from ....results import Trajectory
from ....results.overlaps import OVERLAP
from ....storage.printed import Printed, Table
from ....tasks.task import Task
from ...store import save_table
from ...worlds import Worlds
from ..replay import replay
from .trial import checked_options

COLUMNS = ("role", "name", "value", "sd", "failed")  # of the table


@dataclass(frozen=True, repr=False)
class Falsification(Printed):
    """The smallest disturbance that was found to make a policy fail.

    Attributes:
        task: with the disturbances that were searched, their standard deviations the units of size.
        size: Euclidean length in standard deviations; infinite: none was found up to `most`; 0: the policy
            fails where all that is drawn has its median, which of a `Uniform` start is not the task's own.
        values: what is disturbed, by name: (value, standard deviations from the middle).
        world: the failing world, as `slcp_warp.sweep(task, policy, worlds=...)` takes it; None: none.
        scenario: a task of that one world, to save and to run again; None: none.
        margin: in that world, of the hard problem in float64; at most 0.
        status: of that world.
        most: the largest size that was looked at.
        drawn: sizes (n,) of disturbances drawn from the distributions, and `failing` (n,) whether they fail.
        tried: worlds that were run.
        rounds: of the search.
        by_gradient, by_draws: improvements from gradients and from draws.
        options: of the steps that it fails under.
        by: names of what was searched; `left`: what the task disturbs beside it, and the search did not.
        shared: the names in `values`, those together that one number draws; it counts once in `size`.
        overlap: how deep the failing world begins in overlap [m, rad]: it may fail as it is thrown out of it.
    """

    task: Task
    size: float
    values: dict[str, tuple[float, float]]
    world: Worlds | None
    scenario: Task | None
    margin: float
    status: Status
    most: float
    drawn: np.ndarray
    failing: np.ndarray
    tried: int
    rounds: int
    by_gradient: int
    by_draws: int
    options: Options
    by: tuple[str, ...] = ()
    left: tuple[str, ...] = ()
    shared: tuple[tuple[str, ...], ...] = ()
    overlap: float = 0.0

    @property
    def found(self) -> bool:
        """Whether a failing disturbance was found."""
        return math.isfinite(self.size)

    @property
    def rarer(self) -> float:
        """Share of the drawn disturbances that are as large or larger."""
        return float((self.drawn >= self.size).mean())

    def replay(self, policy: Any, case: Options | None = None) -> Trajectory:
        """The failing world step by step, in float64; `case` None: with the options that it was found with.

        Raises:
            ArgumentError: nothing was found.
        """
        if self.world is None:
            raise ArgumentError("no failing disturbance was found; there is nothing to replay")
        options = self.options if case is None else checked_options(self.task, case)
        return replay(self.task, policy, self.world, case=options, dtype="float64")

    @property
    def table(self) -> dict[str, np.ndarray]:
        """Columns `COLUMNS`: a row for all that was "drawn", its size under sd, and for every number that was
        "found"; of one that several parts share the value is that of the first.
        """
        drawn, rows = len(self.drawn), self._found
        found = len(rows)
        value, sd = (np.array([row[i] for row in rows]) for i in (1, 2))
        return {
            "role": np.repeat(["drawn", "found"], [drawn, found]),
            "name": np.array([""] * drawn + [name for name, _, _ in rows]),
            "value": np.concatenate([np.full(drawn, np.nan), value]),
            "sd": np.concatenate([self.drawn, sd]),
            "failed": np.concatenate([self.failing, np.ones(found, bool)]),
        }

    @property
    def _found(self) -> list[tuple[str, float, float]]:
        """Name, value and standard deviations of every number that was found."""
        together = [names for names in self.shared if names[0] in self.values]
        together += [(name,) for name in self.values if all(name not in names for names in together)]
        return [
            (f"{names[0]} (of {len(names)})" if len(names) > 1 else names[0], *self.values[names[0]])
            for names in together
        ]

    def save(self, path: str | Path) -> Path:
        """Write the table as .csv; replaced only once complete."""
        return save_table(path, self.table)

    def _line(self) -> str:
        of = f"of task {self.task.name!r}" + (f" by {', '.join(map(self._how, self.by))}" if self.by else "")
        if self.left:
            of += f", without {', '.join(self.left)}"
        if not self.found:
            return f"{of}: nothing up to {self.most:g} standard deviations fails; {self.tried:,} worlds tried"
        tried = f"{self.tried:,} worlds tried"
        if self.overlap > OVERLAP:
            tried += f"; it begins in overlap, by {self.overlap:.2g}"
        if not self.size:
            return f"{of}: the policy fails where all that is drawn has its median; {tried}"
        share = f"{100.0 * self.rarer:.3g} % of worlds draw as much, in whatever direction"
        return f"{of}: fails from {self.size:.4g} standard deviations on; {share}; {tried}"

    def _how(self, kind: str) -> str:
        """A kind of disturbances, with when and where where one is meant."""
        d = self.task.disturbances
        if kind == "push" and len(d.pushes) == 1:
            (push,) = d.pushes
            point = "its centre of mass" if push.at is None else f"({push.at[0]:.3g}, {push.at[1]:.3g})"
            spans = (push.start, push.duration)
            start, lasts = (f"{span:g}" if isinstance(span, float | int) else repr(span) for span in spans)
            return f"push of {push.body!r} at {point} from {start} s for {lasts} s"
        if kind == "kick" and len(d.kick_times) == 1:
            return f"kick at {d.kick_times[0]:g} s"
        return kind

    def _tables(self) -> list[Table]:
        """The largest first."""
        rows = sorted(self._found, key=lambda row: -abs(row[2]))
        return [Table("the smallest that fails", ("disturbed", "value", "standard deviations"), rows)]
