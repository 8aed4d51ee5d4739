"""`slcp compare`: two policies in the same worlds of a report."""

from pathlib import Path
from typing import Annotated

import typer

from ..stages.task_sweep import comparison, load_report, report_table
from ..support.screen import console, one_line_errors


@one_line_errors
def compare_command(
    report: Annotated[Path, typer.Argument(help="Table of `slcp sweep TASK` with several policies, .csv.")],
    first: Annotated[str | None, typer.Argument(help="A policy; default: the first.")] = None,
    second: Annotated[str | None, typer.Argument(help="Another one; default: the second.")] = None,
) -> None:
    """Compare two policies of a report world by world: differences with their intervals."""
    found = load_report(report)
    there = list(dict.fromkeys(key[0] for key in found.source.keys))
    named = [first or there[0], second or next((n for n in there if n != (first or there[0])), "")]
    if not named[1]:
        raise ValueError(f"{report} has the policy {there[0]!r} only; two are needed")
    console.print(report_table(found))
    console.print(comparison(found, *named))
