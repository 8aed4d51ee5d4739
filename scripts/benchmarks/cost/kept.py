"""What a folder costs a sweep: a chunk that is kept beside its launch, in processor time."""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp.ensembles.stored.sweep import StoredSweep
from slcp_warp.ensembles.tasks import TaskSweep
from slcp_warp.runs.worker import compute

from ...support.records import load_policy
from ...support.screen import show_rows
from ..shared.timing import Rows


def bench_kept(policy: Path, worlds: int, chunk: int) -> Rows:
    """Medians over chunks of the first named task under a policy, h = .05: a chunk, and its launch in it."""
    task = slcp.load_task(next(iter(slcp.tasks.NAMED)))
    found = load_policy(policy, task.scene)[0]
    work = TaskSweep(
        task, found, worlds=worlds, cases=task.options, chunk=chunk, device="cpu", step_sizes=(0.05,)
    )
    launches = Clock(work.rows)
    with tempfile.TemporaryDirectory() as folder:
        kept = StoredSweep.open(Path(folder) / "sweep", work, chunk=chunk)
        count = len(work.chunks) - 2  # whole ones
        compute(kept.job, kept.store, count)  # compiled, imported
        vars(work)["rows"] = launches
        whole = Clock(compute)
        for index in range(count):
            whole(kept.job, kept.store, index)
        reading = Clock(lambda: str(kept.report()))
        reading()
        size = sum(kept.store.part(i).stat().st_size for i in range(count)) / (count * chunk)
    (bare, bare_wall), (all_of_it, wall) = launches.median, whole.median
    rows = [{
        "chunks": count, "launch, s": bare, "kept, s": all_of_it, "more, ms": 1e3 * (all_of_it - bare),
        "wall, ms": 1e3 * (wall - bare_wall), "ratio": all_of_it / bare, "worlds/s": chunk / all_of_it,
        "bytes": size, "report, us": 1e6 * reading.median[0] / (count * chunk),
    }]  # fmt: skip
    show_rows(f"a sweep in a folder, one process, {chunk} worlds a chunk; bytes and report of a world", rows)
    return rows


class Clock:
    """A function whose calls are timed.

    Attributes:
        median: processor and wall time of a call [s].
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.times: list[tuple[float, float]] = []

    def __call__(self, *given: Any) -> Any:
        """Call it."""
        began, wall = time.process_time(), time.perf_counter()
        out = self.function(*given)
        self.times.append((time.process_time() - began, time.perf_counter() - wall))
        return out

    @property
    def median(self) -> tuple[float, float]:
        """Over the calls."""
        first, second = np.median(np.array(self.times), axis=0)
        return float(first), float(second)
