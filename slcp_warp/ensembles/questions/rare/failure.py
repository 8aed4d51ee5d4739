"""Shares of failures too small to count: multilevel splitting over a task's own disturbances."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ....inputs import checks
from ....inputs.checks import instance
from ....inputs.errors import ArgumentError
from ....storage.printed import Printed, Table
from ....tasks.task import Task
from ...store import save_table
from ...worlds import Worlds
from .estimate import estimate
from .margin import Margin
from .numbers import Numbers
from .silent import Silent
from .splitting import Effort, Moves, pilot, run_islands
from .trial import Trial, checked_options

PILOT = 4  # times the particles of an island: particles of the pilot
FAR_APART = 1.0  # relative standard deviation of the islands above which the report warns
KEPT = 1000  # failing worlds that are kept, at most


@dataclass(frozen=True, repr=False)
class FailureShare(Printed):
    """The share of worlds in which a policy fails, with a 95 % interval.

    The interval covers the chance of the draws: the islands are independent and each has the share as its
    mean. It cannot cover a kind of failure that no island has met and the margin does not lead to. Where none
    has met any, a condition of the margin is `silent`, or it `jumps`, high is at least the upper end of a
    count of the islands' plain worlds, which holds wherever failing lies.

    Attributes:
        name: of the task.
        share, low, high: the estimate and its interval.
        levels: margins, falling; the last is that of failing: 0, or -inf of a margin that was given.
        reached: (levels,) share of the worlds at or below each.
        accepted: (levels - 1,) share of the chains' moves below each.
        islands: (islands,) their own estimates.
        worlds: that were run.
        plain: upper end of the share by the islands' plain worlds alone.
        led: upper end by the lowest margin that was reached; right if the margin leads to all that fails.
        silent: conditions of the margin that were the same in all worlds that succeeded.
        jumps: whether worlds failed that the levels of the margin did not lead to.
        failing: some of the worlds that failed, as `slcp_warp.sweep` takes them; None: none did.
        seed: of all that was drawn; a sweep of `failing` needs it, for the noise of single steps.
    """

    name: str
    share: float
    low: float
    high: float
    levels: np.ndarray
    reached: np.ndarray
    accepted: np.ndarray
    islands: np.ndarray
    worlds: int
    plain: float
    led: float
    silent: tuple[str, ...]
    jumps: bool
    failing: Worlds | None
    seed: int

    @property
    def spread(self) -> float:
        """Standard deviation of the islands' estimates over their mean."""
        return float(self.islands.std(ddof=1) / self.share) if self.share > 0.0 else math.nan

    @property
    def plain_worlds(self) -> float:
        """Worlds drawn plainly that would give an interval as narrow, of the logarithm; NaN: none failed."""
        if not self.share > 0.0 or not self.low > 0.0:
            return math.nan
        half = 0.5 * math.log(self.high / self.low) / 1.96
        return (1.0 - self.share) / (self.share * half**2)

    @property
    def table(self) -> dict[str, np.ndarray]:
        """A row a level: its margin, the share of worlds at or below it, the share of moves accepted below
        it (NaN: none were made), and the whole estimate with its interval in every row.
        """
        accepted = np.full(len(self.levels), np.nan)
        accepted[: len(self.accepted)] = self.accepted
        whole = {name: np.full(len(self.levels), getattr(self, name)) for name in ("share", "low", "high")}
        return {"margin": self.levels, "reached": self.reached, "accepted": accepted} | whole

    def save(self, path: str | Path) -> Path:
        """Write the table as .csv; replaced only once complete."""
        return save_table(path, self.table)

    def _line(self) -> str:
        found = f"{self.share:.3g} (95 %: {self.low:.2g} to {self.high:.2g})"
        return "; ".join([f"of task {self.name!r}: {found}, {self.worlds:,} worlds", *self.doubts])

    @property
    def doubts(self) -> list[str]:
        """What is to be known of the estimate before it is believed."""
        found = []
        if not self.share > 0.0:
            found.append(
                f"none failed, high is of plain worlds (if the margin leads to failing: {self.led:.2g})"
            )
        if self.jumps:
            found.append("the margin jumps, its levels do not lead to failing; give another")
        if self.spread > FAR_APART:
            found.append("the islands lie far apart, more particles or longer chains would say more")
        if self.silent:
            found.append(
                f"plain worlds alone bound failing by {', '.join(self.silent)}; give a margin for it"
            )
        return found

    def _tables(self) -> list[Table]:
        accepted = [*self.accepted, None]
        rows = list(zip(self.levels, self.reached, accepted))
        return [
            Table("", ("margin at most", "share of worlds", "moves accepted"), rows, left=0, most=len(rows))
        ]


def failure_share(
    task: Task,
    policy: Any = None,
    *,
    case: Any = None,
    margin: Any = None,
    islands: int = 20,
    particles: int = 500,
    length: int = 20,
    smallest: float = 1e-9,
    seed: int = 0,
    step_size: float | None = None,
    dtype: str = "float32",
    device: Any = None,
    strategy: str = "auto",
    progress: Callable[[int], None] | None = None,
) -> FailureShare:
    """Estimate the share of a task's disturbed worlds in which a policy fails, however small it is.

    By multilevel splitting (Au and Beck 2001) with fixed levels (Cerou et al. 2012) over the numbers that the
    task's disturbances draw: particles whose margin is small are moved, by Markov chains that leave their law
    as it is, to where it is smaller still. `particles` a level and an island are run, some five levels for
    each power of a thousand.

    Args:
        task: with disturbances and a success.
        policy: as for `sweep`.
        case: options of the steps; None: the task's, of the hard problem.
        margin: how far a world is from failing: a measure that falls towards failing, or a comparison of
            measures, whose distance from its bounds counts, also beyond them; None: the task's success. It
            decides how the levels fall, not what fails.
        islands: independent runs, whose spread gives the interval.
        particles: of an island.
        length: states of a chain; particles / length of them start at a level.
        smallest: share below which the search ends.
        seed: of all that is drawn.
        step_size: [s]; None: the scene's.
        dtype, device, strategy: as of a `Simulator`.
        progress: called with the number of worlds that were run.

    Raises:
        ArgumentError: no success, nothing that is drawn, or a margin that is the same in all worlds.
    """
    instance("task", task, Task, "a slcp_warp.Task")
    judge = Margin(task, margin)
    effort, silent = _effort(islands, particles, length, smallest, judge.event), Silent(task, judge)
    seed = checks.whole("seed", seed, 0)
    checks.function("progress", progress, 1, optional=True)
    trial = Trial(
        task, policy, checked_options(task, case), judge.measures, seed=seed, step_size=step_size,
        dtype=dtype, device=device, strategy=strategy,
    )  # fmt: skip
    numbers = Numbers(trial.sim, task, trial.step_size, numbered=not trial.alike)
    width = numbers.dimension + numbers.fresh
    if not width:
        raise ArgumentError(f"task {task.name!r} has no disturbances: all of its worlds are the same")
    at_once = islands * particles
    checks.memory("islands * particles: the numbers", at_once * width, 16, trial.sim.device)

    def score(z: np.ndarray) -> np.ndarray:
        ends = trial.run(numbers.worlds(z))
        if not judge.fitted:
            judge.fit(ends.values)
        silent.look(ends.values, ends.success)
        if progress is not None:
            progress(trial.worlds)
        return judge.score(ends.values, ends.success)

    rng, moves = np.random.default_rng(seed), Moves(width, numbers.fresh)
    levels = pilot(score, moves, effort, PILOT * particles, rng)
    found = run_islands(score, levels, moves, effort, islands, rng)
    of = estimate(found, alone=bool(silent.names))
    reached = np.array([found.reached(k).mean() for k in range(len(levels.scores))])
    failing = numbers.worlds(found.ended[:KEPT]) if found.ended.size else None
    trial.starts.tell(stacklevel=2)
    return FailureShare(
        task.name, of.share, of.low, of.high, np.array(levels.scores), reached, found.accepted, of.islands,
        trial.worlds, of.plain, of.led, silent.names, of.jumps, failing, seed,
    )  # fmt: skip


def _effort(islands: int, particles: int, length: int, smallest: float, event: float) -> Effort:
    checks.whole("islands", islands, 2)
    particles, length = checks.whole("particles", particles, 10), checks.whole("length", length, 2)
    if particles < 2 * length:
        raise ArgumentError(
            f"particles is {particles}; at least two chains of length {length}, {2 * length}, are needed"
        )
    smallest = checks.number("smallest", smallest, 0.0, 0.5, above=True)
    keep = Effort.keep
    return Effort(particles, length, keep, 1 + math.ceil(math.log(smallest) / math.log(keep)), event)
