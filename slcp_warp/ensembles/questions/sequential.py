"""Two policies in the same worlds, as many as it takes to say which is better."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from ...inputs import checks
from ...inputs.checks import shown
from ...inputs.errors import ArgumentError
from ...options import Options
from ...storage.printed import Printed, Table
from ...tasks.task import Task
from ..outcome import Report
from ..statistics.intervals import Interval
from ..statistics.sequential import STATISTICS, RunningDifference
from ..statistics.source import MemorySource
from ..statistics.starts import Starts
from ..tasks import TaskSweep

LEAST = 256  # worlds before a difference of means is judged
WORDS = {"larger": "{} is larger", "smaller": "{} is smaller", "equal": "they are equal within the margin",
         "undecided": "undecided"}  # fmt: skip


class Look(NamedTuple):
    """The difference first - second after so many worlds, with an interval for all looks together."""

    worlds: int
    difference: float
    low: float
    high: float


@dataclass(repr=False)
class SequentialComparison(Printed):
    """What a sequential comparison came to.

    Attributes:
        first, second: the policies' names.
        measure: what was compared: "success" or a measure's name.
        statistic: of its differences: "mean" or "median".
        decision: of the first one's value beside the second's: "larger", "smaller", "equal" (within the
            margin) or "undecided".
        looks: at the difference, one after the other.
        confidence: that the true difference is in the intervals of all looks.
        margin: differences below it count as equal; None: none does.
        report: of all worlds that were run.
    """

    first: str
    second: str
    measure: str
    statistic: str
    decision: str
    looks: list[Look]
    confidence: float
    margin: float | None
    report: Report

    @property
    def worlds(self) -> int:
        """Worlds that it took."""
        return self.looks[-1].worlds if self.looks else 0

    @property
    def difference(self) -> Interval:
        """First less second, with its interval."""
        return self.looks[-1][1:] if self.looks else (float("nan"),) * 3

    def _line(self) -> str:
        value, low, high = self.difference
        said = WORDS[self.decision].format(self.first)
        what = f"median of {self.measure}" if self.statistic == "median" else self.measure
        return (
            f"{what} of {self.first} less {self.second}: {value:.4g} ({low:.4g} to {high:.4g}) "
            f"after {self.worlds:,} worlds: {said}"
        )

    def _tables(self) -> list[Table]:
        return [Table("looks", Look._fields, self.looks[-8:], left=0)]


def compare_sequentially(
    task: Task,
    policies: Mapping[str, Any],
    *,
    measure: str = "success",
    statistic: str | None = None,
    bounds: Any = None,
    confidence: float = 0.95,
    margin: float | None = None,
    worlds: int = 65536,
    batch: int = 256,
    seed: int = 0,
    case: Options | None = None,
    step_size: float | None = None,
    dtype: str = "float32",
    device: Any = None,
    strategy: str = "auto",
    progress: Callable[[int, int], None] | None = None,
) -> SequentialComparison:
    """Run two policies in the same disturbed worlds, batch after batch, until their difference is decided.

    The interval is looked at after every batch, and it covers the true difference at all looks together with
    the promised confidence: stopping early costs nothing of it. That holds exactly, whatever the law, of
    "success", of the median of a measure's differences, and of its mean within bounds; of a mean without
    bounds for large numbers of worlds only, the larger the more it is due to seldom, large values
    (`statistics.sequential` and `statistics.any_law` have the sources).

    Args:
        task: what is run, disturbed and measured.
        policies: two, by name.
        measure: "success", or the name of one of the task's measures.
        statistic: of a measure's differences, first less second, world by world: "median", or "mean"; None:
            the mean of "success" and of what has bounds, else the median.
        bounds: (low, high) of the measure: values beyond count as the bound, and the mean is that of the
            measure so bounded. None: there are none.
        confidence: in (0, 1).
        margin: stop, too, when the difference is surely smaller than this; None: equal ones run to the end.
        worlds: at most.
        batch: worlds between looks.
        seed: of all that is drawn; the worlds are those of a `sweep` with this seed.
        case: options of the steps; None: the task's.
        step_size: [s]; None: the scene's.
        dtype, device, strategy: as of a `Simulator`.
        progress: called with (worlds done, at most).

    A keyboard interrupt ends it undecided, with what is finished.
    """
    first, second = _two(policies)
    checks.instance("task", task, Task, "a slcp_warp.Task")
    checks.choice("measure", measure, ("success", *task.measures))
    statistic, bounds = _statistic(measure, statistic, bounds)
    error = 1.0 - checks.number("confidence", confidence, 0.0, 1.0 - 1e-9, above=True)
    margin = None if margin is None else checks.number("margin", margin, 0.0, above=True)
    worlds, batch = checks.whole("worlds", worlds), checks.whole("batch", batch)
    checks.function("progress", progress, 2, optional=True)
    asymptotic = measure != "success" and statistic == "mean" and bounds is None
    sweeps = [  # a policy each: its chunks come first, in order
        TaskSweep(
            task, {name: policy}, worlds=worlds, seed=seed, cases=task.options if case is None else case,
            step_sizes=None if step_size is None else (step_size,), dtype=dtype, device=device,
            strategy=strategy, chunk=min(batch, worlds),
        )
        for name, policy in policies.items()
    ]  # fmt: skip
    sim = next(iter(sweeps[0].simulators.values()))
    checks.memory(
        "batch: its worlds", min(batch, worlds) * (sim.params.layout.width + sim.nx), 16, sim.device
    )
    source, known = MemorySource(), RunningDifference(measure, error, statistic, bounds)
    report = Report(task, source, complete=False)
    out = SequentialComparison(first, second, measure, statistic, "undecided", [], confidence, margin, report)
    try:
        for index in range(-(-worlds // batch)):
            rows = [sweep.run(index) for sweep in sweeps]
            for sweep, found in zip(sweeps, rows):
                source.add(sweep.chunks[index].part.keys, found)
            known.add(*rows)
            out.looks.append(Look(known.worlds, *known.interval()))
            out.decision = decision(out.looks[-1], margin, LEAST if asymptotic else 1)
            if progress is not None:
                progress(min((index + 1) * batch, worlds), worlds)
            if out.decision != "undecided":
                break
        out.report.complete = True
    except KeyboardInterrupt:
        pass
    Starts.of(source).tell(stacklevel=2)
    return out


def decision(look: Look, margin: float | None, least: int) -> str:
    """What an interval says after at least so many worlds."""
    if look.worlds < least:
        return "undecided"
    if look.low > 0.0 or look.high < 0.0:
        return "larger" if look.low > 0.0 else "smaller"
    inside = margin is not None and -margin < look.low and look.high < margin
    return "equal" if inside else "undecided"


def _statistic(measure: str, statistic: Any, bounds: Any) -> tuple[str, tuple[float, float] | None]:
    """What is compared, checked."""
    if bounds is not None:
        low, high = checks.array("bounds", bounds, (2,))
        if not low < high or measure == "success":
            raise ArgumentError(
                f"bounds is {shown(bounds)}; (low, high), low < high, of a measure are needed"
            )
        bounds = float(low), float(high)
    if statistic is None:
        return ("mean" if measure == "success" or bounds is not None else "median"), bounds
    checks.choice("statistic", statistic, STATISTICS)
    if statistic == "median" and (measure == "success" or bounds is not None):
        raise ArgumentError("statistic is 'median': that is of a measure, without bounds")
    return statistic, bounds


def _two(policies: Any) -> tuple[str, str]:
    if not isinstance(policies, Mapping) or len(policies) != 2:
        raise ArgumentError(f"policies is {shown(policies)}; two, by name, are needed")
    first, second = policies
    return first, second
