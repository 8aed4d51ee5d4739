"""`slcp replay`: worlds of a sweep step by step, into a file of states, controls and forces."""

from pathlib import Path
from typing import Annotated

import typer

import slcp_warp as slcp

from ..stages.replayed import play
from ..stages.trajectory import warnings
from ..support.options import Device, Seed, StepSize, given_options
from ..support.policies import TaskPolicy
from ..support.rules import NO_RULE, OneRule, with_rules
from ..support.screen import console, one_line_errors, prepared, timed, wrote
from ..support.tasks import TaskName


@one_line_errors
@with_rules
def replay_command(
    context: typer.Context,
    task: TaskName,
    policy: TaskPolicy = None,
    report: Annotated[
        Path | None, typer.Option(help="Of `slcp sweep`: its first worlds that failed are played.")
    ] = None,
    most: Annotated[int, typer.Option(min=1, help="Worlds of a report.")] = 8,
    world: Annotated[
        list[int] | None, typer.Option(min=0, help="The number of a world (repeatable), instead.")
    ] = None,
    given: Annotated[Path | None, typer.Option(help="Worlds of a file, instead.")] = None,
    out: Annotated[Path, typer.Option(help="File to write.")] = Path("replay.npz"),
    rules: OneRule = NO_RULE,
    step_size: StepSize = None,
    seed: Seed = 0,
    device: Device = None,
    dtype: Annotated[str, typer.Option(help="float32 or float64; the sweep's.")] = "float32",
) -> None:
    """Play disturbed worlds of a task again, of a sweep's seed, precision and options: those that failed.

    The file holds states, controls as they acted, impulses and gaps; `slcp watch --replay` shows it.
    """
    chosen_options = given_options(context)
    ways = chosen_options & {"report", "world", "given"}
    if len(ways) != 1:
        raise ValueError("one of --report FILE, --world N and --given FILE is needed")
    if "most" in chosen_options and report is None:
        raise ValueError("--most is of --report")
    path, chosen = prepared(out), slcp.load_task(task)
    own = None if given is None else slcp.load_worlds(given)
    with timed("replay"):
        run, table = play(
            chosen, policy, rules, numbers=world or (), given=own, report=report, most=most,
            step_size=step_size, seed=seed, dtype=dtype, device=device,
        )  # fmt: skip
    run.save(path)
    console.print(table)
    for line in warnings(run):
        typer.echo(f"slcp: {line}", err=True)
    wrote(path)
