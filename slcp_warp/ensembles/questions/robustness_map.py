"""Where a policy holds: the share of successes over a grid of two numbers of a task."""

import itertools
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
from ..worlds import Worlds, draw_worlds
from .axes import ITSELF, Axis, changed, checked_axis, meant, set_twice
from .judged import Judge
from .made import made

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
    numbers: Sequence[str] | str = (),
    worlds: int = 256,
    seed: int = 0,
    case: Options | None = None,
    dtype: str = "float32",
    device: Any = None,
    strategy: str = "auto",
    progress: Callable[[int, int], None] | None = None,
) -> RobustnessMap:
    """How often a policy succeeds where two numbers, of the task or its own, are others than planned for.

    Every cell of the grid runs the same disturbed worlds, with two of their numbers changed, so that cells
    differ by these alone.

    Args:
        task: what is run, disturbed and judged.
        policy: one; or, with `numbers`, a function of these by name that gives one.
        x, y: name and values: of a parameter, of all parts ("mass") or of one ("block.mass"), as factors on
            what was drawn; of a place or an angle ("hand.shape_offset_x", see `SIGNED` of the disturbances),
            as what is added to it; of a state ("block.x"), as what is added to the start; or of "kicks", as
            factors. With an equals sign behind the name ("block.mass=") the values are a parameter's or a
            state's own, in place of what was drawn; factors of the other axis are on these.
        numbers: which names of x and y are arguments of the policy's function, whose values they then are.
        worlds: of every cell.
        seed: of all that is drawn.
        case: options of the steps; None: the task's.
        dtype, device, strategy: as of a `Simulator`.
        progress: called with (worlds done, worlds in all).
    """
    worlds = checks.whole("worlds", worlds)
    checks.instance("task", task, Task, "a slcp_warp.Task")
    given = [axis[0] for axis in (x, y) if _named(axis)]
    none = isinstance(numbers, str | list | tuple) and not numbers
    own = () if none else checks.names("numbers", numbers, given)
    for name in own:
        if not name.isidentifier():
            raise ArgumentError(f"numbers names {name!r}, which is no argument of a function")
    axes = [checked_axis(label, task, given, own) for label, given in (("x", x), ("y", y))]
    _check_apart(task, axes, own)
    cells = _Cells(axes, own, policy)
    judge = Judge(
        task, cells.policy(0, 0), seed, case, progress, worlds, dtype=dtype, device=device, strategy=strategy
    )
    each = Parameters(task.scene).layout.width + 2 * task.scene.nv
    checks.memory("worlds of a row of x", worlds * cells.width * each, 32, wp.get_device("cpu"))
    base = draw_worlds(task, worlds, seed, dtype=dtype, device=device)
    successes, overlapping = np.zeros((2, cells.height, cells.width), np.int64)
    for j, columns in itertools.product(range(cells.height), cells.together):
        judge.use(cells.policy(columns[0], j))
        found = judge.run(cells.worlds(task, base, columns, j), worlds * cells.height * cells.width)
        successes[j, columns] = found["success"].reshape(-1, worlds).sum(axis=1)
        overlapping[j, columns] = (found[NOTED[0]] > OVERLAP).reshape(-1, worlds).sum(axis=1)
    judge.starts.tell(stacklevel=2)
    (across, along), (down, upwards) = axes
    name = judge.name if not own else getattr(policy, "__name__", judge.name)
    return RobustnessMap(across, down, along, upwards, successes, worlds, name, overlapping)


def _named(axis: Any) -> bool:
    return isinstance(axis, list | tuple) and len(axis) == 2 and isinstance(axis[0], str)


def _check_apart(task: Task, axes: Sequence[Axis], own: Sequence[str]) -> None:
    """Raise ArgumentError for two axes of the same numbers, and for more cells than are drawn."""
    (across, along), (down, upwards) = axes
    if across.rstrip(ITSELF) == down.rstrip(ITSELF):
        raise ArgumentError(f"x and y are both {across!r}; two names are needed")
    if not own and set_twice(task, across, down):
        raise ArgumentError(f"x and y, {across!r} and {down!r}, are both values of the same numbers")
    if len(along) * len(upwards) > MOST_CELLS:
        raise ArgumentError(
            f"x and y have {len(along)} and {len(upwards)} values; at most {MOST_CELLS} cells are drawn"
        )


class _Cells:
    """The cells of a grid: which policy each has, and which worlds.

    Attributes:
        width, height: how many values x and y have.
        together: columns of a row that one policy runs.
    """

    def __init__(self, axes: Sequence[Axis], own: Sequence[str], policy: Any) -> None:
        self._axes, self._policy = axes, policy
        self._own = [name.removesuffix(ITSELF) in own for name, _ in axes]
        self.width, self.height = (len(values) for _, values in axes)
        columns = list(range(self.width))
        self.together = [[i] for i in columns] if self._own[0] else [columns]

    def policy(self, i: int, j: int) -> Any:
        """Of the cell of the values i of x and j of y."""
        given = zip(self._axes, self._own, (i, j), strict=True)
        return made(
            self._policy, {name.removesuffix(ITSELF): values[k] for (name, values), own, k in given if own}
        )

    def worlds(self, task: Task, base: Worlds, columns: list[int], j: int) -> Worlds:
        """Of the cells of some columns of row j, one cell after the other."""
        cells = base[np.tile(np.arange(len(base)), len(columns))]
        (across, along), (down, upwards) = self._axes
        values = np.repeat(along[columns], len(base)), np.full(len(cells), upwards[j])
        given = [axis for axis, own in zip(zip((across, down), values), self._own) if not own]
        for name, numbers in sorted(given, key=lambda axis: not axis[0].endswith(ITSELF)):  # before factors
            cells = changed(task, cells, name, numbers)
        return cells
