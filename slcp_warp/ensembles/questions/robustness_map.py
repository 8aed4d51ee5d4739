"""Where a policy holds: the share of successes over a grid of two numbers of a task."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from ...inputs import checks
from ...inputs.errors import ArgumentError
from ...options import Options
from ...parameters import Parameters
from ...results.overlaps import OVERLAP
from ...storage.printed import Printed, Table
from ...storage.rows import save_rows
from ...tasks.task import Task
from ..statistics.intervals import share_interval
from ..statistics.source import NOTED
from ..worlds import draw_worlds
from .axes import ITSELF, changed, checked_axis, meant, set_twice
from .judged import Judge

HEAD = ("x", "y", "x_value", "y_value", "worlds", "success", "low", "high")
MOST_CELLS = 2**16


@dataclass(repr=False)
class RobustnessMap(Printed):
    """Shares of successes over a grid.

    Attributes:
        x, y: what is varied, by name.
        x_values, y_values: (X,) and (Y,), rising or not.
        successes: (Y, X) worlds that succeeded.
        worlds: of every cell, the same in all of them.
        policy: its name.
        overlapping: (Y, X) worlds that begin in overlap, by 1e-6 and more: their first steps throw them out.
    """

    x: str
    y: str
    x_values: np.ndarray
    y_values: np.ndarray
    successes: np.ndarray
    worlds: int
    policy: str
    overlapping: np.ndarray | None = None

    @property
    def share(self) -> np.ndarray:
        """(3, Y, X) share of successes, and the ends of its 95 % interval (Wilson)."""
        found = [share_interval(int(count), self.worlds) for count in self.successes.ravel()]
        return np.array(found).T.reshape(3, *self.successes.shape)

    def save(self, path: str | Path) -> Path:
        """Write the map as .csv, a row a cell; replaced only once complete."""
        share = self.share
        rows = (
            (self.x, self.y, a, b, self.worlds, *share[:, j, i].tolist())
            for j, b in enumerate(self.y_values.tolist())
            for i, a in enumerate(self.x_values.tolist())
        )
        return save_rows(path, HEAD, rows)

    def _line(self) -> str:
        height, width = self.successes.shape
        axes = f"{meant(self.x)} x {meant(self.y)}"
        return f"of {self.policy}: {axes}, {width} x {height} cells of {self.worlds:,} worlds"

    def _tables(self) -> list[Table]:
        head = (
            f"{self.y.rstrip(ITSELF)} \\ {self.x.rstrip(ITSELF)}",
            *(f"{value:.3g}" for value in self.x_values),
        )
        rows = [
            (f"{value:.3g}", *(f"{100.0 * share:.0f}{mark}" for share, mark in zip(row, marks)))
            for value, row, marks in zip(self.y_values, self.share[0], self._marks)
        ]
        title = "success [%]" + ("; *: worlds begin in overlap" if "*" in self._marks else "")
        return [Table(title, head, rows[::-1])]

    @property
    def _marks(self) -> np.ndarray:
        """(Y, X) what stands behind a cell's share."""
        found = np.zeros_like(self.successes) if self.overlapping is None else self.overlapping
        return np.where(found > 0, "*", "")


def robustness_map(
    task: Task,
    policy: Any,
    x: tuple[str, Sequence[float] | np.ndarray],
    y: tuple[str, Sequence[float] | np.ndarray],
    *,
    worlds: int = 256,
    seed: int = 0,
    case: Options | None = None,
    dtype: str = "float32",
    device: Any = None,
    strategy: str = "auto",
    progress: Callable[[int, int], None] | None = None,
) -> RobustnessMap:
    """How often a policy succeeds where two numbers of a task are others than planned for.

    Every cell of the grid runs the same disturbed worlds, with two of their numbers changed, so that cells
    differ by these alone.

    Args:
        task: what is run, disturbed and judged.
        policy: one.
        x, y: name and values: of a parameter, of all parts ("mass") or of one ("block.mass"), as factors on
            what was drawn; of a place or an angle ("hand.shape_offset_x", see `SIGNED` of the disturbances),
            as what is added to it; of a state ("block.x"), as what is added to the start; or of "kicks", as
            factors. With an equals sign behind the name ("block.mass=") the values are a parameter's or a
            state's own, in place of what was drawn; factors of the other axis are on these.
        worlds: of every cell.
        seed: of all that is drawn.
        case: options of the steps; None: the task's.
        dtype, device, strategy: as of a `Simulator`.
        progress: called with (worlds done, worlds in all).
    """
    worlds = checks.whole("worlds", worlds)
    judge = Judge(task, policy, seed, case, progress, worlds, dtype=dtype, device=device, strategy=strategy)
    across, down = (checked_axis(label, task, given) for label, given in (("x", x), ("y", y)))
    if across[0].rstrip(ITSELF) == down[0].rstrip(ITSELF):
        raise ArgumentError(f"x and y are both {across[0]!r}; two names are needed")
    if set_twice(task, across[0], down[0]):
        raise ArgumentError(f"x and y, {across[0]!r} and {down[0]!r}, are both values of the same numbers")
    width, height = len(across[1]), len(down[1])
    if width * height > MOST_CELLS:
        raise ArgumentError(f"x and y have {width} and {height} values; at most {MOST_CELLS} cells are drawn")
    each = Parameters(task.scene).layout.width + 2 * task.scene.nv
    checks.memory("worlds of a row of x", worlds * width * each, 32, wp.get_device("cpu"))
    base = draw_worlds(task, worlds, seed, dtype=dtype, device=device)
    repeated = base[np.tile(np.arange(worlds), width)]
    along = np.repeat(across[1], worlds)
    successes, overlapping = np.zeros((2, height, width), np.int64)
    for j, value in enumerate(down[1]):
        axes = [(across[0], along), (down[0], np.full(len(along), value))]
        cells = repeated
        for name, values in sorted(axes, key=lambda axis: not axis[0].endswith(ITSELF)):  # before factors
            cells = changed(task, cells, name, values)
        found = judge.run(cells, worlds * width * height)
        successes[j] = found["success"].reshape(width, worlds).sum(axis=1)
        overlapping[j] = (found[NOTED[0]] > OVERLAP).reshape(width, worlds).sum(axis=1)
    judge.starts.tell(stacklevel=2)
    return RobustnessMap(across[0], down[0], across[1], down[1], successes, worlds, judge.name, overlapping)
