"""Interleaved timing, and its results as a table on the screen and as tidy rows in a CSV file."""

import gc
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rich.table import Table

from ...support.screen import console
from .machine import machine

Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class Case:
    """One thing to time: `run` does `count` items of work (world steps, Jacobians, passes) in one call.

    `reference` names the case of the same benchmark whose time is divided by this one's. `overhead` is a call
    whose time is taken off: what `run` does beside the work. `facts` go to the CSV.
    """

    name: str
    run: Callable[[], Any]
    count: float
    reference: str | None = None
    overhead: Callable[[], Any] | None = None
    facts: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Result:
    """Seconds per item of a case in every repeat (R,), and reference / case of the same repeat (R,)."""

    case: Case
    seconds: np.ndarray
    ratios: np.ndarray | None


def time_interleaved(
    cases: list[Case], repeats: int, clock: Callable[[], float] = time.process_time
) -> list[Result]:
    """Run all cases once unmeasured, then `repeats` rounds in turn, each beginning with another case.

    A ratio is taken inside a round, so that a machine that slows down slows both. The default clock is the
    CPU time of this process, all threads together; for speed-ups by threads take `time.perf_counter`.
    """
    for case in cases:
        case.run()
    seconds = {case.name: np.zeros(repeats) for case in cases}
    collecting = gc.isenabled()
    gc.disable()
    try:
        for r in range(repeats):
            for i in range(len(cases)):
                case = cases[(i + r) % len(cases)]
                spent = _timed(case.run, clock)
                if case.overhead is not None:
                    spent -= _timed(case.overhead, clock)
                seconds[case.name][r] = spent / case.count
    finally:
        if collecting:
            gc.enable()
    return [
        Result(c, seconds[c.name], None if c.reference is None else seconds[c.reference] / seconds[c.name])
        for c in cases
    ]


def _timed(run: Callable[[], Any], clock: Callable[[], float]) -> float:
    start = clock()
    run()
    return clock() - start


def print_table(title: str, unit: str, results: list[Result], notes: list[str]) -> None:
    """Medians, 10th and 90th percentiles and the best of the repeats; a ratio above 1 is faster."""
    factor = {"us": 1e6, "ms": 1e3}[unit.split()[0]]
    table = Table(title=title, title_justify="left")
    for heading in ("case", unit, "p10 - p90", "best", "ratio", "p10 - p90", "against"):
        side: Any = "left" if heading in ("case", "against") else "right"
        table.add_column(heading, justify=side, no_wrap=True)
    for r in results:
        row = [r.case.name, *_spread(r.seconds * factor), f"{r.seconds.min() * factor:.3g}"]
        row += ["", "", ""] if r.ratios is None else [*_spread(r.ratios), str(r.case.reference)]
        table.add_row(*row)
    console.print(table)
    load = machine()["load"]
    if load > machine()["cores"]:
        notes = [*notes, f"load average {load:.1f}: other processes ran, wall times are too long"]
    for note in notes:
        console.print(f"  {note}", highlight=False, soft_wrap=True)
    console.print()


def _spread(values: np.ndarray) -> tuple[str, str]:
    low, middle, high = np.percentile(values, [10, 50, 90])
    return f"{middle:.3g}", f"{low:.3g} - {high:.3g}"


def tidy_rows(benchmark: str, results: list[Result], clock: str) -> Rows:
    """One row per case: seconds per item and ratio with their spread, the case's facts, and the machine."""
    rows = []
    for r in results:
        low, middle, high = np.percentile(r.seconds, [10, 50, 90])
        row = {"benchmark": benchmark, "case": r.case.name, "clock": clock, "items": r.case.count,
               "repeats": len(r.seconds), "seconds": middle, "seconds_p10": low, "seconds_p90": high,
               "seconds_best": r.seconds.min(), "reference": r.case.reference or ""}  # fmt: skip
        if r.ratios is not None:
            low, middle, high = np.percentile(r.ratios, [10, 50, 90])
            row |= {"ratio": middle, "ratio_p10": low, "ratio_p90": high}
        rows.append(row | r.case.facts | machine())
    return rows


def finish(benchmark: str, unit: str, results: list[Result], notes: list[str], clock: str) -> Rows:
    """Print a benchmark's table; its rows."""
    print_table(f"{benchmark}: {clock}", unit, results, notes)
    return tidy_rows(benchmark, results, clock)
