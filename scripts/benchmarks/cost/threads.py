"""`slcp bench threads`: a rollout on one core and on all of them."""

import functools
import time

import slcp_warp as slcp
from slcp_warp.kernels.device import launch

from ..shared.ours import DTYPES, Ours, cpu_threads
from ..shared.timing import Case, Rows, finish, time_interleaved
from ..shared.workload import make_workload


def bench_threads(worlds: int = 20000, steps: int = 50, repeats: int = 9, seed: int = 0) -> Rows:
    """Wall time of a rollout on one core and on all of them."""
    work = make_workload(slcp.scenes.flicking_finger(), worlds, steps, seed)
    count = launch.thread_count()
    cases = []

    def run(ours: Ours, threads: int) -> None:
        with cpu_threads(threads):
            ours.rollout(ours.work)

    for dtype in DTYPES:
        ours = Ours(work, dtype)
        one = f"{dtype}, 1 thread"
        for label, threads, reference in ((one, 1, None), (f"{dtype}, {count} threads", count, one)):
            facts = {"dtype": dtype, "threads": threads}
            repeat = functools.partial(run, ours, threads)
            cases.append(Case(label, repeat, ours.work.steps, reference, facts=facts))
    results = time_interleaved(cases, repeats, clock=time.perf_counter)
    best = {r.case.name: r.seconds.min() for r in results}
    notes = []
    for dtype in DTYPES:
        gain = best[f"{dtype}, 1 thread"] / best[f"{dtype}, {count} threads"]
        notes.append(f"{dtype}: {gain:.2f} times as fast, best repeat against best repeat")
    return finish("threads", "us per step", results, notes, "wall time")
