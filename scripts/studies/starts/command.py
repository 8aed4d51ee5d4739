"""`slcp paper starts`: sampling, DDP from many starts, and both, on tasks: cost against CPU time."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.planning import random_starts, solve_starts
from slcp_warp.ddp.sampling.options import limit_share
from slcp_warp.kernels.control.sampling import METHODS

from ...support.options import Device
from ...support.screen import one_line_errors, prepared, show_rows

SAMPLINGS = ((64, 10), (128, 20), (256, 40))  # samples and iterations
STARTS = (2, 4, 8, 16)
SEEDS = 3


@one_line_errors
def starts_command(
    tasks: Annotated[list[str], typer.Argument(metavar="TASK...", help="As of `slcp tasks`.")],
    out: Annotated[Path, typer.Option(help="The picture.")] = Path("starts.png"),
    device: Device = None,
) -> None:
    """Cost against CPU time: sampled controls, DDP from noise, and DDP from what was sampled."""
    from .chart import starts_chart  # it loads matplotlib

    path = prepared(out, ".png")
    rows = [row for name in tasks for row in _outcomes(slcp.load_task(name), device)]
    show_rows(f"lowest cost, median of {SEEDS} seeds", rows)
    starts_chart(path, rows)
    typer.echo(f"wrote {path}")


def _outcomes(task: slcp.Task, device: str | None) -> list[dict[str, object]]:
    """Every way at every size: the median over seeds of cost and CPU seconds."""
    problem, x0 = ddp.problem_of(task, task.simulator(device=device)), task.start[0]
    ways: dict[tuple[str, str], Callable[[int], float]] = {}
    for samples, iterations in SAMPLINGS:
        for method in METHODS:
            sampling = ddp.Sampling(method=method, samples=samples, iterations=iterations)
            size = f"{samples} x {iterations}"
            ways[method, size] = _sampled(problem, x0, sampling)
            if method == "cem":
                ways["cem, then DDP", size] = _both(problem, x0, sampling)
    for count in STARTS:
        ways["DDP", f"{count} starts"] = _planned(problem, x0, count)
    rows = []
    for (way, size), run in ways.items():
        run(0)  # compiles
        costs, seconds = [], []
        for seed in range(SEEDS):
            start = time.process_time()
            costs.append(run(seed))
            seconds.append(time.process_time() - start)
        middle = {
            "cost": float(np.median(costs)),
            "best": float(np.min(costs)),
            "worst": float(np.max(costs)),
        }
        rows.append({"task": task.name, "way": way, "size": size, **middle, "s": float(np.median(seconds))})
    return rows


def _sampled(problem: ddp.Problem, x0: Any, sampling: ddp.Sampling) -> Callable[[int], float]:
    sampler = ddp.Sampler(problem, 1, sampling)

    def run(seed: int) -> float:
        sampler.run(x0, None, seed)
        return float(sampler.cost.numpy()[0])

    return run


def _both(problem: ddp.Problem, x0: Any, sampling: ddp.Sampling) -> Callable[[int], float]:
    sampler = ddp.Sampler(problem, 1, replace(sampling))

    def run(seed: int) -> float:
        sampler.run(x0, None, seed)
        return float(solve_starts(problem, x0, sampler.us.numpy().copy()).best.cost)

    return run


def _planned(problem: ddp.Problem, x0: Any, count: int) -> Callable[[int], float]:
    scale = limit_share(problem.control_limits, problem.nu)[0]

    def run(seed: int) -> float:
        us = random_starts(count, problem.horizon, problem.nu, scale, seed)
        lower, upper = problem.limit_rows()
        return float(solve_starts(problem, x0, np.clip(us, lower[0], upper[0])).best.cost)

    return run
