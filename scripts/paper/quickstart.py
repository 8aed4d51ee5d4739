"""`slcp quickstart`: the main job end to end, from the canonical start to a report with pictures."""

from pathlib import Path
from typing import Annotated

import typer

from ..charts.quickstart_report import write_report
from ..stages.library import Interrupted, library_table
from ..stages.plan import outcome_table
from ..stages.sweep import sweep_table
from ..support.options import Device, Seed
from ..support.paper import OBSERVED
from ..support.screen import INTERRUPTED, checked_folder, console, one_line_errors, timed
from .experiment import FULL, QUICK, STANDARD, Run


@one_line_errors
def quickstart_command(
    out: Annotated[Path, typer.Option(help="Folder for data, figures and report.")] = Path("out/quickstart"),
    seed: Seed = 0,
    quick: Annotated[
        bool | None, typer.Option("--quick/--full", help="A toy run in seconds / with the size study.")
    ] = None,
    device: Device = None,
) -> None:
    """Trajectory, library, sweep, figures and report of the paper's experiment."""
    run = Run(checked_folder(out), {None: STANDARD, True: QUICK, False: FULL}[quick], seed, device)
    try:
        with timed("everything", run.times):
            _run_all(run)
    except Interrupted as stopped:
        where = run.file("library.npz")
        typer.echo(f"slcp: interrupted; {len(stopped.library)} controllers are in {where}", err=True)
        raise typer.Exit(INTERRUPTED) from None
    except KeyboardInterrupt:
        typer.echo(f"slcp: interrupted; what was finished is in {run.data}", err=True)
        raise typer.Exit(INTERRUPTED) from None
    console.print(f"\nReport:  {run.report}\nFigures: {run.figures}\nData:    {run.data}", highlight=False)


def _run_all(run: Run) -> None:
    """The stages, each timed, and the report."""
    from ..charts.files import chart_files  # it loads matplotlib

    times = run.times
    with timed("trajectory (DDP)", times):
        plan, results = run.plan()
    console.print(outcome_table(plan, results))
    with timed(f"library of {run.scale.plans} plans", times):
        library = run.library()
    console.print(library_table(library, OBSERVED))
    with timed("limit cycle", times):
        run.cycle()
    with timed("contact surface", times):
        run.surface()
    with timed(f"sweep of 4 x {run.scale.worlds} worlds", times):
        report = run.sweep("sweep", run.spec())
    console.print(sweep_table(report))
    with timed(f"disturbed sweep of 4 x {run.scale.disturbed} worlds", times):
        disturbed = run.disturbed()
    console.print(sweep_table(disturbed))
    if run.scale.sizes:
        with timed("size study", times):
            run.sizes()
    with timed("figures", times):
        pictures = chart_files(run.to_draw(), run.figures)
    write_report(run.report, plan, library, [report, disturbed], pictures, times)
