"""The smallest disturbance that makes a policy fail."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ....inputs import checks
from ....inputs.checks import instance
from ....inputs.errors import ArgumentError
from ....options import Status
from ....tasks.task import Task
from ...tasks import policy_of
from .falsification import Falsification
from .gradient import slopes_of
from .margin import Margin
from .numbers import Numbers
from .scenario import scenario_of
from .shells import Found, Search
from .space import kinds_of, searched
from .trial import Trial, checked_options

SHELLS = 256.0  # the outermost shell over the innermost
MOST = (32.0, 256.0)  # the largest sizes that are looked at, one after the other
NEAR = (1.0, 1.001, 1.003, 1.01, 1.03, 1.1, 1.3)  # sizes at which what failed in float32 is tried in float64
POLISH = 512  # vectors at once, in float64
RAY = np.arange(1, 65) / 64.0  # parts of what was found that are looked at: less may fail where more does not
DRAWN = 4096  # worlds of the distribution that the size is compared with


def falsify(
    task: Task,
    policy: Any = None,
    by: Any = "kick",
    *,
    time: float | None = None,
    body: str | None = None,
    duration: float | None = None,
    at: tuple[float, float] | None = None,
    case: Any = None,
    margin: Any = None,
    most: float | None = None,
    worlds: int = 4096,
    rounds: int = 40,
    strategies: int = 8,
    gradients: bool = False,
    seed: int = 0,
    dtype: str = "float32",
    device: Any = None,
    strategy: str = "auto",
    progress: Callable[[int], None] | None = None,
) -> Falsification:
    """Find the smallest disturbance under which a policy fails.

    Size is the length in standard deviations of what is disturbed. Directions on shells come first, then
    evolution strategies that shrink what fails, `worlds` at once; with `gradients` also the nearest point of
    the margin's tangent plane, by derivatives through contact. Where all that the search ends at fails in
    single precision alone, it is made again in float64. What is found fails in float64, and none of its own
    64ths below it does; it fails in the search's precision, too, if anything nearby that large does.

    Args:
        task: with a success; its first start counts, and no noise; policies act as in world 0.
        policy: as for `sweep`.
        by: what is disturbed: "kick" (velocities, at one time; in the task's kicks' standard deviations, else
            in its starts', else in m/s and rad/s), "push" (a force on a body for a while), "start",
            "parameters", "all" that the task disturbs, or `Disturbances` of your own.
        time: of the kick or push [s]; None: the task's first, or 0.
        body: that is pushed; None: the task's first push's, or the scene's last.
        duration: of the push [s]; None: of the task's first push, or 0.1.
        at: the point that is pushed, in the body's frame [m]; None: the task's first push's, if it is on this
            body, or the end of the body's first shape.
        case: options of the steps; None: the task's, of the hard problem.
        margin: as of `failure_share`.
        most: the largest size that is looked at [standard deviations]; None: 32, and 256 if nothing fails.
        worlds: at once.
        rounds: at most.
        strategies: that go on side by side, from different directions.
        gradients: use derivatives of the margin where there are some.
        seed: of directions and draws.
        dtype, device, strategy: of the search, as of a `Simulator`.
        progress: called with (worlds that were run).

    Raises:
        ArgumentError: no success, or nothing that is disturbed.
    """
    instance("task", task, Task, "a slcp_warp.Task")
    worlds, rounds = checks.whole("worlds", worlds, 64), checks.whole("rounds", rounds)
    strategies, seed = checks.whole("strategies", strategies), checks.whole("seed", seed, 0)
    sizes = MOST if most is None else (checks.number("most", most, 0.0, above=True),)
    checks.flag("gradients", gradients), checks.function("progress", progress, 1, optional=True)
    own = task.replace(disturbances=searched(task, by, time, body, duration, at), start=task.start[:1])
    judge, chosen, policy = Margin(own, margin), checked_options(task, case), policy_of(own, policy)
    how: dict[str, Any] = {"seed": seed, "device": device, "strategy": strategy, "most": 1}
    quick, exact = (
        Trial(own, policy, chosen, judge.measures, dtype=each, **how) for each in (dtype, "float64")
    )
    numbers = Numbers(exact.sim, own, exact.step_size)
    if not numbers.dimension:
        raise ArgumentError(f"by is {checks.shown(by)}; nothing is disturbed by it")
    kinds = kinds_of(own.disturbances)
    left = tuple(kind for kind in kinds_of(task.disturbances) if kind not in kinds)
    hunt = Hunt(quick, exact, judge, numbers, progress, kinds, left)
    rng = np.random.default_rng(seed)
    drawn = rng.standard_normal((DRAWN, numbers.dimension))
    failing = hunt.quick_fails(drawn)
    suggest = slopes_of(own, policy, numbers, judge, device) if gradients else None
    best, found = np.zeros((1, numbers.dimension)), Found.nothing(numbers.dimension)
    for largest in () if hunt.exact_fails(best)[0] else sizes:
        how_far: Any = (numbers.dimension, worlds, largest / SHELLS, largest, strategies, rounds, suggest)
        found = Search(hunt.quick_fails, *how_far).run(rng, drawn[failing])
        best = hunt.confirmed(found.best, largest, rng)
        if len(found.best) and not len(best) and hunt.quick.sim.dtype is not hunt.exact.sim.dtype:
            # what fails in the search's precision alone has hidden what fails in both
            found = Search(hunt.exact_fails, *how_far).run(rng)
            best = hunt.confirmed(found.best, largest, rng)
        if len(best):
            break
    return hunt.report(best, found, sizes[-1], np.linalg.norm(drawn, axis=1), failing)


@dataclass
class Hunt:
    """What a search runs its worlds with, in two precisions."""

    quick: Trial
    exact: Trial
    judge: Margin
    numbers: Numbers
    progress: Callable[[int], None] | None
    by: tuple[str, ...]
    left: tuple[str, ...]

    def quick_fails(self, z: np.ndarray) -> np.ndarray:
        """Which of z (B, dimension) fail."""
        return self._fails(self.quick, z)

    def exact_fails(self, z: np.ndarray) -> np.ndarray:
        """Which of them fail in float64."""
        return self._fails(self.exact, z)

    def fails_in_both(self, z: np.ndarray) -> np.ndarray:
        """Which of them fail in both precisions."""
        return self.quick_fails(z) & self.exact_fails(z)

    def confirmed(self, best: np.ndarray, most: float, rng: np.random.Generator) -> np.ndarray:
        """What also fails in float64 near vectors (K, d), if some do in both precisions, as small as it gets;
        the smallest first.
        """
        for fails in (self.fails_in_both, self.exact_fails):
            found = _exact(fails, best, most, rng)
            if len(found):
                return _smallest_parts(self.exact_fails, found)
        return best[:0]

    def _fails(self, trial: Trial, z: np.ndarray) -> np.ndarray:
        ends = trial.run(self.numbers.worlds(z))
        if not self.judge.fitted:
            self.judge.fit(ends.values)
        if self.progress is not None:
            self.progress(self.quick.worlds + self.exact.worlds)
        return ~ends.success

    def report(
        self, best: np.ndarray, found: Found, most: float, drawn: np.ndarray, failing: np.ndarray
    ) -> Falsification:
        """What was found: `best` (K, dimension), the smallest first, or nothing."""
        common: dict[str, Any] = {
            "task": self.exact.task, "most": most, "drawn": drawn, "failing": failing, "rounds": found.rounds,
            "options": self.exact.sim.options, "by_gradient": found.suggested, "by_draws": found.drawn,
            "by": self.by, "left": self.left, "shared": self.numbers.shared(),
        }  # fmt: skip
        if not len(best):
            nothing: dict[str, Any] = {
                "size": math.inf,
                "values": {},
                "world": None,
                "scenario": None,
                "margin": math.nan,
            }
            tried = self.quick.worlds + self.exact.worlds
            return Falsification(**nothing, status=Status.SOLVED, tried=tried, **common)
        world = self.numbers.worlds(best[:1])
        ends = self.exact.run(world)
        return Falsification(
            size=float(np.linalg.norm(best[0])),
            values=self.numbers.told(best[0]),
            world=world,
            scenario=scenario_of(
                self.exact.task.replace(options=self.exact.sim.options), self.numbers, world
            ),
            margin=float(self.judge(ends.values, ends.success)[0]),
            status=Status(int(ends.status[0])),
            tried=self.quick.worlds + self.exact.worlds,
            overlap=float(ends.overlap[0]),
            **common,
        )


def _exact(
    fails: Callable[[np.ndarray], np.ndarray], best: np.ndarray, most: float, rng: np.random.Generator
) -> np.ndarray:
    """What also fails so, as small as it gets nearby; the smallest first."""
    if not len(best):
        return best
    tried = (best[:, None] * np.array(NEAR)[:, None]).reshape(-1, best.shape[1])
    failed = fails(tried).reshape(len(best), len(NEAR))
    kept = [best[k] * NEAR[int(np.argmax(row))] for k, row in enumerate(failed) if row.any()]
    if not kept:
        return best[:0]
    search = Search(fails, best.shape[1], POLISH, most / SHELLS, most, len(kept), rounds=10)
    return search.refine(np.array(kept), rng, step=0.02).best


def _smallest_parts(fails: Callable[[np.ndarray], np.ndarray], best: np.ndarray) -> np.ndarray:
    """Of each the smallest 64ths that fail so; the smallest first."""
    tried = best[:, None] * RAY[:, None]
    failed = fails(tried.reshape(-1, best.shape[1])).reshape(len(best), len(RAY))
    parts = tried[np.arange(len(best)), np.where(failed.any(1), failed.argmax(1), len(RAY) - 1)]
    return parts[np.argsort(np.linalg.norm(parts, axis=1), kind="stable")]
