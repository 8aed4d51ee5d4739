"""`slcp compare`: two policies in the same worlds, of a report or of as many as it takes."""

from pathlib import Path
from typing import Annotated

import typer

import slcp_warp as slcp

from ..stages.task_sweep import comparison, report_tables, tell_incomplete
from ..support.options import Device, Seed, StepSize, refuse
from ..support.policies import POLICY, named_policies
from ..support.rules import HARD_RULE, RULES, HardRule, with_rules
from ..support.screen import INTERRUPTED, console, one_line_errors, prepared, progress_bar, timed, wrote
from ..support.simulators import numbers

OF_TASKS = {  # options that a report has no use for
    *("measure", "statistic", "bounds", "confidence", "margin", "worlds", "batch", "out"),
    *("step_size", "seed", "device", "dtype", *RULES),
}
REPORT = (
    "Report of `slcp sweep TASK` with several policies (.csv, .npz, .parquet, folder); with --policy a task."
)
SEQUENTIAL = "Intervals for all looks together; of a task: run until the difference is decided."
OTHER = "Of a report: another one, of another design, whose policy is the second."


@one_line_errors
@with_rules
def compare_command(
    context: typer.Context,
    report: Annotated[str, typer.Argument(metavar="REPORT", help=REPORT)],
    first: Annotated[str | None, typer.Argument(help="A policy; default: the first.")] = None,
    second: Annotated[
        str | None, typer.Argument(help="Another one; default: the second, of --other the same.")
    ] = None,
    sequential: Annotated[bool, typer.Option(help=SEQUENTIAL)] = False,
    other: Annotated[Path | None, typer.Option(help=OTHER)] = None,
    policy: Annotated[list[str] | None, typer.Option(help=f"Of a task, twice: {POLICY}.")] = None,
    measure: Annotated[str, typer.Option(help="Of a task: success, or a measure.")] = "success",
    statistic: Annotated[
        str | None,
        typer.Option(help="Of a measure: median or mean of its differences; with --bounds mean."),
    ] = None,
    bounds: Annotated[
        str | None, typer.Option(help="low,high of the measure; what is beyond counts as the bound.")
    ] = None,
    confidence: Annotated[float, typer.Option(help="Of the decision about a task.")] = 0.95,
    margin: Annotated[
        float | None, typer.Option(help="Differences below it count as equal, and end the comparison.")
    ] = None,
    worlds: Annotated[int, typer.Option(help="Of a task: at most.")] = 65536,
    batch: Annotated[int, typer.Option(help="Of a task: worlds between looks.")] = 256,
    rules: HardRule = HARD_RULE,
    step_size: StepSize = None,
    seed: Seed = 0,
    device: Device = None,
    dtype: Annotated[str, typer.Option(help="float32 or float64.")] = "float32",
    out: Annotated[Path | None, typer.Option(help="Of a task: keep the worlds as a report.")] = None,
) -> None:
    """Compare two policies world by world: differences with their intervals.

    Of a report; or of a task, in as many worlds as it takes (--sequential).
    """
    if not policy:
        refuse(context, OF_TASKS, "of a task with --policy; this is of a report")
        _of_report(Path(report), first, second, sequential, other)
        return
    if other is not None:
        raise ValueError("--other is of reports; of a task's --policy alone say what is compared")
    if not sequential:
        raise ValueError("--policy is of a task with --sequential; `slcp sweep` makes reports to compare")
    if first is not None:
        raise ValueError(f"{first} is a name of a report's policy; of a task's --policy alone say which")
    task = slcp.load_task(report)
    path = None if out is None else prepared(out, (".csv", ".npz", ".parquet"))
    case = rules.of(task.options)
    with timed("comparison"), progress_bar("worlds") as progress:
        found = slcp.compare_sequentially(
            task, named_policies(policy, task.scene, task), measure=measure, statistic=statistic,
            bounds=None if bounds is None else numbers(bounds, "--bounds", 2), confidence=confidence,
            margin=margin, worlds=worlds, batch=batch, seed=seed, case=case,
            step_size=step_size, dtype=dtype, device=device,
            progress=progress,
        )  # fmt: skip
    _of_worlds(found, path)


def _of_worlds(found: slcp.SequentialComparison, path: Path | None) -> None:
    written = [] if path is None or not found.looks else [found.report.save(path)]
    console.print(str(found), markup=False, highlight=False)
    for each in written:
        wrote(each)
    if not found.report.complete:
        typer.echo(f"slcp: interrupted after {found.worlds} worlds", err=True)
        raise typer.Exit(INTERRUPTED)


def _of_report(
    path: Path, first: str | None, second: str | None, sequential: bool, other: Path | None
) -> None:
    found = slcp.load_report(path)
    there = list(dict.fromkeys(key[0] for key in found.source.keys))
    one = first or there[0]
    beside = None if other is None else slcp.load_report(other)
    two = second or (one if beside is not None else next((name for name in there if name != one), ""))
    if not two:
        raise ValueError(f"{path} has the policy {there[0]!r} only; two are needed, or --other")
    differences = comparison(found, one, two, sequential, beside)
    tell_incomplete(found, path)
    if beside is not None and other is not None:
        tell_incomplete(beside, other)
    console.print(*report_tables(found), sep="\n")
    console.print(differences)
