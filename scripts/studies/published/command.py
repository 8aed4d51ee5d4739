"""`slcp published`: published problems of optimal control from one default call, beside other solvers."""

import json
import subprocess
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from slcp_warp import ddp

from ...support.options import Device
from ...support.screen import one_line_errors, show_rows
from .models import PROBLEMS, Published


@one_line_errors
def published_command(
    peers: Annotated[
        str | None, typer.Option(help="Python interpreter with crocoddyl, and mim_solvers if it is there.")
    ] = None,
    device: Device = None,
) -> None:
    """Solve published problems from one default call, and say what it costs; others' solvers beside it."""
    rows = [row for name, make in PROBLEMS.items() for row in _ours(name, make(device))]
    rows += [] if peers is None else _theirs(peers)
    order = list(PROBLEMS)
    show_rows("published problems", sorted(rows, key=lambda row: order.index(str(row["problem"]))))


def _ours(name: str, given: Published) -> list[dict[str, object]]:
    """`ddp.solve(problem, x0)` and `ddp.plan(problem, x0=x0)`, timed on their second run."""
    rows = []
    workspace = ddp.Workspace(given.problem, 1, ddp.Options(max_iterations=500))
    calls: dict[str, Any] = {
        "ddp.solve": lambda: workspace.solve(given.x0, None).select(0),
        "ddp.plan": lambda: ddp.plan(given.problem, x0=given.x0).best,
    }
    for solver, call in calls.items():
        call()
        start = time.process_time()
        found = call()
        spent = time.process_time() - start
        row = _row(name, solver, float(found.cost), int(found.iterations), spent)
        rows.append(row | {"status": ddp.Status(int(found.status)).name, "known": f"{given.known:.8g}"})
    return rows


def _theirs(python: str) -> list[dict[str, object]]:
    """What `peers.py` prints."""
    script = Path(__file__).with_name("peers.py")
    done = subprocess.run([python, str(script)], stdout=subprocess.PIPE, text=True, check=True)
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    return [_row(r["problem"], r["solver"], r["cost"], r["passes"], r["seconds"]) for r in rows]


def _row(name: str, solver: str, cost: float, passes: int, seconds: float) -> dict[str, object]:
    return {"problem": name, "solver": solver, "cost": f"{cost:.8g}", "passes": passes,
            "ms": f"{1e3 * seconds:.3g}", "status": "", "known": ""}  # fmt: skip
