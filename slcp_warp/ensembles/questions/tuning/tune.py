"""Numbers of a policy, or of a design, that do best over a task's disturbed worlds."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ....inputs import checks
from ....options import Options
from ....tasks.task import Task
from ...statistics.intervals import share_interval, shares_interval
from ...worlds import Worlds, draw_worlds
from ...worlds.seeds import seed_apart
from .candidates import Candidates
from .ranges import Ranges
from .tuned import Judged, Tuned
from .wanted import Cost, Outcome, Wanted, ranks

try:
    import cmaes
except ImportError:  # an extra
    cmaes = None

SEARCHED, NEW = 0x74756E65, 0x74657374  # with the seed: worlds of the search, and those of the judgement
SPREAD = 0.3  # of the first candidates, as a share of every range
FEWEST = 8  # candidates of a round


class Try(NamedTuple):
    """A candidate: its round, its numbers (n,), and how the worlds of the search went."""

    round: int
    numbers: np.ndarray
    place: np.ndarray
    share: float
    value: float
    cost: Cost


def tune(
    task: Task,
    policy: Any = None,
    numbers: Mapping[str, Any] | None = None,
    *,
    parameters: Mapping[str, Any] | None = None,
    minimise: str | None = None,
    maximise: str | None = None,
    success: float | None = None,
    start: Mapping[str, float] | None = None,
    log: Any = None,
    worlds: int = 256,
    rounds: int = 40,
    candidates: int | None = None,
    resolution: float = 0.01,
    test_worlds: int = 1024,
    seed: int = 0,
    case: Options | None = None,
    dtype: str = "float32",
    device: Any = None,
    strategy: str = "auto",
    progress: Callable[[int, int], None] | None = None,
) -> Tuned:
    """Find numbers of a policy, or of a design, that do best over disturbed worlds.

    An evolution strategy (CMA-ES: Hansen and Ostermeier 2001, by the package cmaes) draws rounds of
    candidates, each of which runs in the same disturbed worlds, and goes where more of them succeed; among
    candidates with the same share, where worlds are farther from failing (a median, in standard deviations
    of the measures that the success compares). What is best, and the numbers that the search began with, are
    judged in other worlds. No derivatives are needed: of policies with many numbers, such as networks,
    gradients (`slcp_warp.torch`) or learners (`Environment`) take fewer worlds.

    Args:
        task: what is run, disturbed and judged.
        policy: a function of the numbers, by their names, that gives a policy; without `numbers` a policy.
        numbers: of the policy, {name: (low, high)}.
        parameters: of the task, {name: (low, high)}: a parameter of the scene, a place or a state of the
            start, named as in a map (`robustness_map`): "spring.stiffness" is a factor on what a world has,
            "spring.stiffness=" the number itself.
        minimise, maximise: a measure of the task, whose mean is to be small or large, or one of the numbers;
            None: success is to be frequent.
        success: with one of these, the share of worlds that has to succeed.
        start: numbers to begin with, by name; of those that are left out the middle of the range.
        log: names of numbers whose logarithm is looked for: of those that may be 1 or 1,000.
        worlds: of every candidate, the same for all.
        rounds: at most.
        candidates: of a round; None: 4 + 3 ln n of n numbers, and at least 8.
        resolution: share of the ranges within which all candidates of a last round lie.
        test_worlds: in which the best and the first numbers are judged.
        seed: of candidates and of all that is drawn; no world is one of a sweep of the same seed.
        case: options of the steps; None: the task's.
        dtype, device, strategy: as of a `Simulator`.
        progress: called with (worlds done, worlds at most).

    A keyboard interrupt after the first candidate ends the search; what was best by then is judged.

    Raises:
        ArgumentError, ArgumentTypeError: nothing to choose by, a range that is none, a name that the task has
            not got, what is no function of the numbers.
        ImportError: without the package cmaes (the extra `tune`).
    """
    task = checks.instance("task", task, Task, "a slcp_warp.Task")
    ranges = Ranges(task, numbers, parameters, log)
    wanted = Wanted(task, ranges.names, minimise, maximise, success)
    first, worlds, rounds = (
        ranges.start(start),
        checks.whole("worlds", worlds),
        checks.whole("rounds", rounds, 0),
    )
    test_worlds, seed = checks.whole("test_worlds", test_worlds), checks.whole("seed", seed, 0)
    size = max(FEWEST, 4 + int(3.0 * np.log(len(ranges))))
    size = size if candidates is None else checks.whole("candidates", candidates, 4, 2**16)
    resolution = checks.number("resolution", resolution, 0.0, 1.0)
    case = task.options if case is None else checks.instance("case", case, Options, "a slcp_warp.Options")
    checks.function("progress", progress, 2, optional=True)
    how = {"dtype": dtype, "device": device}
    search = Search(
        Candidates(task, policy, ranges, wanted, case, how | {"strategy": strategy}),
        *(ranges, wanted, draw_worlds(task, worlds, seed_apart(seed, SEARCHED), **how), seed),
        *(progress, worlds * (1 + size * rounds) + 2 * test_worlds),
    )
    ended = search.run(first, _strategy(ranges, first, size, seed), rounds, resolution)
    return _judged(search, draw_worlds(task, test_worlds, seed_apart(seed, NEW), **how), ended)


def _strategy(ranges: Ranges, first: np.ndarray, size: int, seed: int) -> Any:
    """The evolution strategy in the cube of the ranges."""
    if cmaes is None:
        raise ImportError("slcp_warp.tune needs the package cmaes: pip install 'slcp-warp[tune]'")
    bounds = np.tile([0.0, 1.0], (len(ranges), 1))
    return cmaes.CMA(first, SPREAD, bounds=bounds, seed=seed % 2**32, population_size=size)


class Search:
    """Candidates, one after the other.

    Attributes:
        tried: so far.
    """

    def __init__(
        self,
        candidates: Candidates,
        ranges: Ranges,
        wanted: Wanted,
        worlds: Worlds,
        seed: int,
        progress: Callable[[int, int], None] | None,
        total: int,
    ) -> None:
        self.candidates, self.ranges, self.wanted = candidates, ranges, wanted
        self.worlds, self.seed, self.tried = worlds, seed, list[Try]()
        self._progress, self._total = progress, total

    def run(self, first: np.ndarray, strategy: Any, rounds: int, resolution: float) -> str:
        """Try the first place (n,) and those that the strategy draws; why it ended."""
        self._try(0, first)  # an interrupt before there is anything to judge goes through
        try:
            for number in range(1, rounds + 1):
                places = [strategy.ask() for _ in range(strategy.population_size)]
                costs = [self._try(number, place).cost for place in places]
                strategy.tell(list(zip(places, ranks(costs), strict=True)))
                if np.ptp(places, axis=0).max() <= resolution:
                    return "resolution"
        except KeyboardInterrupt:
            return "interrupted"
        return "rounds"

    @property
    def best(self) -> Try:
        """The first of those that cost least."""
        return min(self.tried, key=lambda each: each.cost)

    def outcome(self, numbers: np.ndarray, worlds: Worlds, use: int) -> Outcome:
        """How worlds go with numbers (n,); `use` of the seed: SEARCHED or NEW."""
        found = self.candidates.run(numbers, worlds, seed_apart(self.seed, use))
        if self._progress is not None:
            self._progress(self.candidates.done, self._total)
        return found

    def _try(self, number: int, place: np.ndarray) -> Try:
        numbers = self.ranges.numbers(place)
        found = self.outcome(numbers, self.worlds, SEARCHED)
        value = self.wanted.value(found)[0]
        self.tried.append(Try(number, numbers, place, found.share, value, self.wanted.cost(found)))
        return self.tried[-1]


def _judged(search: Search, worlds: Worlds, ended: str) -> Tuned:
    """What was found, in worlds that the search has not seen."""
    best, first, count = search.best, search.tried[0], len(worlds)
    found = [search.outcome(each.numbers, worlds, NEW) for each in (first, best)]
    search.candidates.starts.tell(stacklevel=3)
    names, wanted = search.ranges.names, search.wanted
    both = [
        Judged(
            search.candidates.by_name(each.numbers),
            share_interval(int(each_found.success.sum()), count),
            wanted.value(each_found),
        )
        for each, each_found in zip((first, best), found, strict=True)
    ]
    before, after = (each.success for each in found)
    better = shares_interval(int((after & ~before).sum()), int((before & ~after).sum()), count)
    numbers = np.array([each.numbers for each in search.tried])
    tried = {"round": np.array([each.round for each in search.tried])}
    tried |= {name: numbers[:, i] for i, name in enumerate(names)}
    tried["success_share"] = np.array([each.share for each in search.tried])
    if wanted.name is not None and wanted.measure is not None:
        tried[f"mean_{wanted.name}"] = np.array([each.value for each in search.tried])
    return Tuned(
        both[1].numbers, search.candidates.policy(best.numbers), both[1], both[0], better, wanted.words(),
        wanted.name, tried, len(search.worlds), count, search.seed, ended, search.ranges.ends(best.place),
        wanted.least,
    )  # fmt: skip
