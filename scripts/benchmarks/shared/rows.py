"""Rows of the work-precision studies: timed cases as plain dicts with the diagram's columns."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from slcp_warp.kernels.device import launch

from .ours import cpu_threads
from .timing import Case, time_interleaved

Rows = list[dict[str, Any]]
Say = Callable[[str], None]
ONE_THREAD = "process CPU, one thread"
WALL = "wall"
LEAST = 0.02  # seconds that a timed call should last, where it can be repeated


def timed(cases: list[Case], repeats: int, threads: int | None = 1) -> Rows:
    """A row per case: its facts, and seconds per item with their spread, repeats in turn.

    Args:
        threads: 1: CPU time of the process on one thread; more, None for all, or a GPU among the cases'
            devices: wall time of all.
    """
    wall = threads != 1 or any(case.facts.get("device", "cpu") != "cpu" for case in cases)
    with cpu_threads(launch.thread_count() if threads is None else threads):
        clock = time.perf_counter if wall else time.process_time
        results = time_interleaved(cases, repeats, clock=clock)
    rows = []
    for r in results:
        low, middle, high = (float(x) for x in np.percentile(r.seconds, [10, 50, 90]))
        rows.append(r.case.facts | {
            "seconds": middle, "seconds_p10": low, "seconds_p90": high,
            "seconds_best": float(r.seconds.min()), "repeats": repeats,
            "clock": WALL if wall else ONE_THREAD,
        })  # fmt: skip
    return rows


def timed_once(case: Case, threads: int | None = None) -> dict[str, Any]:
    """The row of one run, as `timed`, for cases that take seconds and whose kernels are loaded."""
    clock = time.process_time if threads == 1 else time.perf_counter
    with cpu_threads(launch.thread_count() if threads is None else threads):
        begin = clock()
        case.run()
        seconds = (clock() - begin) / case.count
    return case.facts | {
        "seconds": seconds, "seconds_p10": seconds, "seconds_p90": seconds, "seconds_best": seconds,
        "repeats": 1, "clock": ONE_THREAD if threads == 1 else WALL,
    }  # fmt: skip


def repeated(run: Callable[[], Any], least: float = LEAST) -> tuple[Callable[[], Any], int]:
    """`run` as often as fills `least` seconds, and how often; called twice to find out."""
    run()
    begin = time.perf_counter()
    run()
    count = max(1, round(least / max(time.perf_counter() - begin, 1e-6)))

    def several() -> None:
        for _ in range(count):
            run()

    return several, count


def report(say: Say, rows: Rows, *names: str) -> Rows:
    """Say the named columns of every row; the rows themselves."""
    for row in rows:
        say("  ".join(f"{n} {row[n]:.3g}" if isinstance(row[n], float) else f"{n} {row[n]}"
                      for n in names if n in row))  # fmt: skip
    return rows
