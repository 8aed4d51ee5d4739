"""`slcp paper schedules`: regularisation schedules of DDP over all named tasks and the published problems."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.multistart.solve import SCHEDULES

from ...support.options import Device
from ...support.screen import console, one_line_errors, show_rows
from ...support.tables import write_csv
from ..published.models import PROBLEMS

NEAR = 0.01  # of the lowest cost: what is as good
FIRST, LAST = 150, 400  # passes of Gauss-Newton before the second order, and of the last method
WAYS = ("second order", "Gauss-Newton", "both")


@one_line_errors
def schedules_command(
    only: Annotated[list[str] | None, typer.Option(help="Problems by name (repeatable); all.")] = None,
    csv: Annotated[Path | None, typer.Option(help="Also write every cost here.")] = None,
    device: Device = None,
) -> None:
    """Which schedule `ddp.solve` should have: costs from one start under eight of them, three ways each."""
    unknown = set(only or ()) - set(slcp.tasks.NAMED) - set(PROBLEMS)
    if unknown:
        raise ValueError(f"--only names {sorted(unknown)}; there are {[*slcp.tasks.NAMED, *PROBLEMS]}")
    rows = []
    for name in only or [*slcp.tasks.NAMED, *PROBLEMS]:
        rows += _rows(name, device)
        console.print(f"[dim]{name}: lowest {min(row['lowest'] for row in rows[-len(WAYS) :]):.6g}[/dim]")
    if csv is not None:
        write_csv(csv, rows)
    show_rows("cost by schedule", rows)
    show_rows(
        f"problems of {len(rows) // len(WAYS)} that come within {NEAR:.0%} of the lowest", _counts(rows)
    )


def _rows(name: str, device: str | None) -> list[dict[str, Any]]:
    """Costs of a problem by way, under every schedule; the lowest of all ways and of `ddp.plan`."""
    if name in PROBLEMS:
        problem, x0 = PROBLEMS[name](device)[:2]
    else:
        task = slcp.tasks.NAMED[name]()
        problem, x0 = ddp.problem_of(task, task.simulator(device=device)), task.start[0]
    count = len(SCHEDULES.rows())
    us = np.zeros((problem.horizon, problem.nu))
    if ddp.solve(problem, x0, us, ddp.Options(max_iterations=1)).status == ddp.Status.FLAT:
        us = ddp.sample(problem, x0).us
    start = np.repeat(us[None], count, axis=0)
    found = {WAYS[0]: _solve(problem, x0, start, "second-order", LAST)}
    found[WAYS[1]] = _solve(problem, x0, start, "gauss-newton", LAST)
    first = _solve(problem, x0, start, "gauss-newton", FIRST)
    found[WAYS[2]] = _solve(problem, x0, first.us, "second-order", LAST)
    best = min(float(ddp.plan(problem, x0=x0).best.cost), *(float(np.nanmin(r.cost)) for r in found.values()))
    return [
        {"problem": name, "way": way, "lowest": best} | _by_schedule(result.cost.tolist())
        for way, result in found.items()
    ]


def _solve(problem: ddp.Problem, x0: Any, us: np.ndarray, method: str, passes: int) -> ddp.Result:
    options = ddp.Options(max_iterations=passes, method=method, regularization=SCHEDULES)
    return ddp.solve(problem, x0, us, options)


def _by_schedule(values: list[Any]) -> dict[str, Any]:
    """A column for each schedule: mu at first, its factor, and the weights on state and control."""
    names = [f"{a:g}, {f:g}, {s:g}/{c:g}" for a, f, _, _, s, c in SCHEDULES.rows()]
    return dict(zip(names, values, strict=True))


def _counts(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """For every way, how many problems each schedule solves."""
    counts = []
    for way in WAYS:
        costs = np.array([list(row.values())[3:] for row in rows if row["way"] == way])
        lowest = np.array([row["lowest"] for row in rows if row["way"] == way])[:, None]
        near = costs - lowest <= NEAR * np.abs(lowest)
        counts.append({"way": way} | _by_schedule(near.sum(axis=0).tolist()))
    return counts
