"""How soon a sequential comparison of two policies stops, and how often it is wrong.

    python -m slcp_warp.scripts.studies.stopping REPORT [--measure success] [--worlds 4096] [--batch 256]
        [--repetitions 200]

The worlds of a report of `slcp sweep TASK` with two policies are cut into repetitions of so many worlds, none
of them in two; with --repetitions each draws its worlds from all of them, with replacement. In each the
comparison looks at the difference every `batch` worlds and stops when it is decided; the fixed design looks
once, at the end, with the interval for one look. The same worlds with the policies' labels exchanged at
random, world by world, are a comparison of equals: whatever is decided there is an error, of the sequential
rule and of one that looks as often with the interval for one look.
"""

import argparse
from pathlib import Path

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

import slcp_warp as slcp
from slcp_warp.ensembles.questions.sequential import LEAST, Look, decision
from slcp_warp.ensembles.statistics.intervals import Interval
from slcp_warp.ensembles.statistics.moments import Moments
from slcp_warp.ensembles.statistics.sequential import RunningDifference

from ..support.screen import console


class Ends:
    """Where repetitions stopped, and what they said.

    Attributes:
        worlds: of each repetition, until it stopped.
        said: "larger", "smaller" or "undecided".
    """

    def __init__(self) -> None:
        self.worlds: list[int] = []
        self.said: list[str] = []

    def add(self, looks: list[Interval], batch: int, least: int) -> None:
        """One more repetition, of which these are the intervals."""
        for number, interval in enumerate(looks, start=1):
            said = decision(Look(number * batch, *interval), None, least)
            if said != "undecided":
                break
        self.worlds.append(number * batch)
        self.said.append(said)

    def share(self, *words: str) -> float:
        """Of the repetitions that said one of these."""
        return float(np.isin(self.said, words).mean())


def looks_of(
    first: np.ndarray, second: np.ndarray, measure: str, batch: int
) -> tuple[list[Interval], list[Interval]]:
    """After every batch the interval for all looks together, and the one for a single look."""
    running, moments = RunningDifference(measure, 0.05), Moments()
    together, single = [], []
    for begin in range(0, len(first), batch):
        a, b = ({measure: values[begin : begin + batch]} for values in (first, second))
        running.add(a, b)
        apart = np.asarray(a[measure], float) - np.asarray(b[measure], float)
        moments += Moments.of(apart)
        together.append(running.interval())
        single.append(moments.interval())
    return together, single


def study(
    first: np.ndarray,
    second: np.ndarray,
    measure: str,
    worlds: int,
    batch: int,
    repetitions: int | None = None,
    seed: int = 0,
) -> dict[str, Ends]:
    """The ends of all repetitions, by rule and by what was compared: (n,) results of the same worlds."""
    ends = {name: Ends() for name in ("sequential", "fixed", "sequential, equals", "peeking, equals")}
    least, rng = 1 if measure == "success" else LEAST, np.random.default_rng(seed)
    for number in range(repetitions or len(first) // worlds):
        rows = (
            worlds * number + np.arange(worlds)
            if repetitions is None
            else rng.integers(len(first), size=worlds)
        )
        a, b = first[rows], second[rows]
        together, single = looks_of(a, b, measure, batch)
        ends["sequential"].add(together, batch, least)
        ends["fixed"].add(single[-1:], worlds, 1)
        exchange = rng.random(worlds) < 0.5
        equal = np.where(exchange, b, a), np.where(exchange, a, b)
        together, single = looks_of(*equal, measure, batch)
        ends["sequential, equals"].add(together, batch, least)
        ends["peeking, equals"].add(single, batch, least)
    return ends


def main() -> None:
    """Read the report, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("report", type=Path)
    parser.add_argument("--measure", default="success")
    parser.add_argument("--worlds", type=int, default=4096, help="of a repetition")
    parser.add_argument("--batch", type=int, default=256, help="worlds between looks")
    parser.add_argument("--repetitions", type=int, help="so many, of worlds drawn from all")
    given = parser.parse_args()
    report = slcp.load_report(given.report)
    keys = [key for key in report.source.keys if key[3] == "disturbed"][:2]
    first, second = (report.part(*key)[given.measure] for key in keys)
    ends = study(first, second, given.measure, given.worlds, given.batch, given.repetitions)
    apart = report.compare(keys[0][0], keys[1][0])[given.measure]
    title = f"{given.measure}: {keys[0][0]} less {keys[1][0]} is {apart[0]:.4f}, of {len(first):,} worlds"
    table = Table(title=title, box=SIMPLE_HEAD)
    for heading in (
        "rule",
        "repetitions",
        "larger",
        "smaller",
        "worlds: 10 %",
        "median",
        "mean",
        "90 %",
        "fewer",
    ):
        table.add_column(heading, justify="left" if heading == "rule" else "right")
    for name, found in ends.items():
        worlds = np.array(found.worlds)
        said = np.array(found.said)
        fewer = ((worlds < given.worlds) & (said != "undecided")).mean()
        numbers = (np.quantile(worlds, 0.1), np.median(worlds), worlds.mean(), np.quantile(worlds, 0.9))
        table.add_row(
            name, str(len(worlds)), f"{100 * found.share('larger'):.1f} %",
            f"{100 * found.share('smaller'):.1f} %", *(f"{n:,.0f}" for n in numbers), f"{100 * fewer:.0f} %",
        )  # fmt: skip
    console.print(table)


if __name__ == "__main__":
    main()
