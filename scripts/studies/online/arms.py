"""`slcp paper success`: every named task under a library and under MPC, disturbed worlds, hard contact."""

import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

import slcp_warp as slcp

from ...support.options import Seed
from ...support.policies import MPC, ends_with_plan
from ...support.screen import one_line_errors, show_rows
from ...support.tables import write_csv

LIBRARY = "library"
WANTED = 0.9  # of the disturbed worlds


def made(folder: Path, task: str, arm: str, worlds: int, seed: int) -> Path:
    """The report of an arm, made by `slcp library` and `slcp sweep` where it is not there."""
    report, library = folder / task / f"{arm}.csv", folder / task / "library.npz"
    if report.is_file():
        return report
    report.parent.mkdir(parents=True, exist_ok=True)
    ahead = arm == MPC and ends_with_plan(slcp.tasks.NAMED[task]())
    if not ahead and not library.is_file():
        _slcp("library", task, "--out", library, "--seed", seed)
    policy = MPC if ahead else f"{MPC}:{library}" if arm == MPC else library
    choices = ("--policy", policy, "--residuals", "hard", "--worlds", worlds, "--seed", seed)
    _slcp("sweep", task, *choices, "--out", report)
    return report


def _slcp(*words: object) -> None:
    """A command in a process of its own, whose memory goes with it."""
    done = subprocess.run([sys.executable, "-m", "slcp_warp.scripts.main", *map(str, words)])
    if done.returncode:
        raise ValueError(f"slcp {' '.join(map(str, words))} ended with {done.returncode}")


def row_of(report: slcp.Report, task: str, arm: str) -> dict[str, Any]:
    """How many of the disturbed worlds succeed, with the 95 % interval."""
    found = next(row for row in report.summary if row["arm"] == "disturbed")
    share, low, high = found["success"]
    return {"task": task, "arm": arm, "worlds": found["worlds"], "success": share, "low": low, "high": high}


@one_line_errors
def arms_command(
    folder: Annotated[
        Path, typer.Argument(help="Where libraries and reports are kept; what is there stays.")
    ],
    only: Annotated[list[str] | None, typer.Option(help="Tasks by name (repeatable); all.")] = None,
    worlds: Annotated[int, typer.Option(min=1, help="Disturbed worlds under a library.")] = 1024,
    mpc_worlds: Annotated[int, typer.Option(min=1, help="Disturbed worlds under MPC.")] = 256,
    seed: Seed = 0,
    csv: Annotated[Path | None, typer.Option(help="Also write the table here.")] = None,
    chart: Annotated[Path | None, typer.Option(help="Draw both arms of every task (.png).")] = None,
) -> None:
    """Every named task from its default calls: success under its library and under MPC.

    The same command goes on where it ended: an arm whose report is in the folder is not run again.
    """
    unknown = set(only or ()) - set(slcp.tasks.NAMED)
    if unknown:
        raise ValueError(f"--only names {sorted(unknown)}; there are {', '.join(slcp.tasks.NAMED)}")
    rows = []
    for task in only or slcp.tasks.NAMED:
        for arm, count in ((LIBRARY, worlds), (MPC, mpc_worlds)):
            rows.append(row_of(slcp.load_report(made(folder, task, arm, count, seed)), task, arm))
    show_rows("share of disturbed worlds that succeed, hard contact, 95 % intervals", rows)
    if csv is not None:
        write_csv(csv, rows)
    if chart is not None:
        from .arms_chart import arms_chart

        typer.echo(f"wrote {arms_chart(chart, rows, WANTED)}")
