"""`slcp bench latency`: how long one cycle of model predictive control keeps one world waiting."""

import gc
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.kernels.device import launch

from ...support.screen import show_rows
from ..shared.machine import machine
from ..shared.timing import Rows

QUANTILES = (0.5, 0.9, 0.99, 0.999, 1.0)
WARM = 50  # cycles before those that count


def bench_latency(
    name: str, library: Path | None, passes: int, cycles: int, method: str | None, dtype: str, seed: int
) -> Rows:
    """From a state of the task, on hard contact, to the controls: wall time and processor time."""
    task = slcp.load_task(name)
    problem = ddp.problem_of(task, task.simulator(dtype=dtype))
    entries = None if library is None else ddp.Library.load(library)
    if entries is not None:
        entries.check_scene(task.scene)
    options = None if method is None else ddp.Options(method=method)
    rows = []
    for prepared in (False, True):  # real-time iteration readies the next cycle between two
        own = 0 if prepared else passes
        improved = 1 if prepared else len(_starts(entries))
        policy = ddp.MPC(problem, entries, passes=own, improved=improved, options=options)
        times = np.array(list(_cycles(task, policy, cycles + WARM, seed)))[WARM:]
        how = "real-time iteration" if prepared else f"{passes} passes"
        rows += [
            {"task": task.name} | _row(how, clock, column)
            for clock, column in zip(("wall", "processor"), times.T)
        ]
    what = f"{task.name}: ms from a state to the controls"
    title = f"{what}, {cycles} cycles of one world, {launch.thread_count()} threads"
    show_rows(title, rows)
    return [row | machine() for row in rows]


def _starts(entries: ddp.Library | None) -> tuple[str, ...]:
    return ("shift", "zero" if entries is None else "library")


def _cycles(task: slcp.Task, policy: ddp.MPC, cycles: int, seed: int) -> Iterator[tuple[float, float]]:
    """Seconds of every cycle, of the clock and of this process."""
    plant, rng = task.simulator(slcp.Options("hard", "none")), np.random.default_rng(seed)
    spread = task.disturbances.deviation(task.scene)
    world = np.zeros(1, dtype=int)
    gc.collect()
    gc.disable()
    try:
        for k in range(cycles):
            if k % task.steps == 0:
                x = task.start[:1] + spread * rng.standard_normal((1, len(spread)))
                policy.begin(plant, world)
            wall, own = time.perf_counter(), time.process_time()
            u = policy.act(x, (k % task.steps) * policy.period, world)
            yield time.perf_counter() - wall, time.process_time() - own
            policy.prepare()
            x = plant.step(x, u).state
    finally:
        gc.enable()


def _row(policy: str, clock: str, seconds: np.ndarray) -> dict[str, object]:
    found: dict[str, object] = {"policy": policy, "clock": clock}
    names = ("median", "90 %", "99 %", "99.9 %", "largest")
    return found | dict(zip(names, (1e3 * np.quantile(seconds, QUANTILES)).tolist(), strict=True))
