"""`slcp library`: a library of local controllers of a task, by receding horizon (section IV.C)."""

from pathlib import Path
from typing import Annotated

import typer

import slcp_warp as slcp
from slcp_warp import ddp

from ..stages.library import (
    Interrupted,
    build,
    build_of_runs,
    kept_beside,
    kept_folder,
    library_table,
    task_options,
)
from ..stages.plan import task_problem
from ..support.options import (
    Device,
    Dtype,
    Seed,
    Settings,
    Sigma,
    Start,
    StepSize,
    given_options,
)
from ..support.records import load_plan
from ..support.rules import NO_RULE, OneRule, with_rules
from ..support.screen import INTERRUPTED, console, one_line_errors, prepared, progress_bar, timed, wrote
from ..support.simulators import observed_state, start_state
from ..support.tasks import DEFAULT, TaskName, tell_timing

RUNS, CHAINS = "runs", "chains"
PLANS = {RUNS: 1000, CHAINS: 400}
OF_CHAINS = {  # options that runs have no use for
    *("rounds", "chains", "perturb_every", "perturb_variance", "noisy", "unperturbed", "start"),
    "resume",
}


def of_runs(
    context: typer.Context, task: slcp.Task, problem: ddp.Problem, source: str | None, path: Path
) -> bool:
    """Whether a library is of a task's runs.

    Raises:
        ValueError: it is asked to be and cannot, options of the other kind are given, or it would be, but is
            to go on from plans that nothing has kept beside `path`.
    """
    if source not in (None, RUNS, CHAINS):
        raise ValueError(f"--from is {source!r}; choose {RUNS} or {CHAINS}")
    can = task.success is not None and problem.horizon == task.steps
    if source == RUNS and not can:
        raise ValueError(
            f"--from {RUNS}: task {task.name!r} needs a success, and plans of {task.steps} steps, as its runs"
        )
    other = sorted(given_options(context) & OF_CHAINS)
    if source == RUNS and other:
        raise ValueError(f"--from {RUNS} is given with {', '.join(other)}, of {CHAINS}")
    if can and source is None and other == ["resume"] and not kept_folder(path).exists():
        raise ValueError(
            f"--resume: {kept_folder(path)} is not there; plans of {CHAINS} are kept, and of {RUNS} none: "
            f"leave it out for {RUNS}, or give --from {CHAINS}"
        )
    return can and source != CHAINS and not other


@one_line_errors
@with_rules
def library_command(
    context: typer.Context,
    task: TaskName = DEFAULT,
    out: Annotated[Path, typer.Option(help="File to write.")] = Path("library.npz"),
    plans: Annotated[
        int | None,
        typer.Option(
            "--plans",
            "--count",
            help="Plans; default: the paper's 400, and 1,000 of runs (as many whole runs as make them; kept "
            "of those that succeed).",
        ),
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(
            "--from",
            help="chains of plans that follow each other, whose entries know no time; or runs of disturbed "
            "worlds, planned while they run, whose entries belong to their step. Default: runs where a run "
            "is as long as a plan.",
        ),
    ] = None,
    plan: Annotated[
        Path | None,
        typer.Option(
            help="A plan of the task that is there: runs follow it, in place of one made for disturbed "
            "worlds; of chains the first plan starts from it, too."
        ),
    ] = None,
    entries: Annotated[int, typer.Option(help="Controllers kept of every plan, at its first steps.")] = 4,
    rounds: Annotated[
        int, typer.Option(help="Rounds of new chains where the controller gets nowhere; 0: none.")
    ] = 5,
    chains: Annotated[int, typer.Option(help="Independent chains at first.")] = 1,
    offset: Annotated[int, typer.Option(help="Steps d between the plans of a chain or a run.")] = 4,
    perturb_every: Annotated[int, typer.Option(help="Steps between velocity kicks; 0: none.")] = 15,
    perturb_variance: Annotated[
        float | None, typer.Option(help="Variance of the kicks; default: of the task's starts' velocities.")
    ] = None,
    noisy: Annotated[int, typer.Option(help="Random starts of every plan.")] = 1,
    unperturbed: Annotated[int, typer.Option(help="So many chains are never kicked.")] = 0,
    passes: Annotated[int, typer.Option(help="DDP passes of every plan.")] = 10,
    horizon: Annotated[int | None, typer.Option(help="Steps N of a plan; default: the task's.")] = None,
    start: Start = None,
    sigma: Sigma = None,
    step_size: StepSize = None,
    rules: OneRule = NO_RULE,
    settings: Settings = None,
    seed: Seed = 0,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Go on with the plans that an ended run of the same options kept."),
    ] = False,
    device: Device = None,
    dtype: Dtype = "float64",
) -> None:
    """Build a trajectory library of a task.

    Every plan of chains is kept in a folder beside the file (.kept) until the library is complete; Ctrl-C
    saves the entries there are. Runs are made all at once, and an interrupted one leaves nothing.
    """
    # long: every option of the command is a parameter of its own, with its help
    path = prepared(out)
    chosen = slcp.load_task(task)
    problem = task_problem(chosen, horizon, sigma, step_size, settings, rules, device, dtype)
    given = None if plan is None else ddp.Result.of(load_plan(plan, chosen.scene))
    x0 = chosen.start[0] if start is None else start_state(chosen.scene, start, chosen.start[0])
    options = task_options(
        chosen, offset=offset, chains=chains, entries=entries, perturb_every=perturb_every, passes=passes,
        perturb_variance=perturb_variance, unperturbed=unperturbed, noisy=noisy, seed=seed,
        first=None if given is None else given.us,
    )  # fmt: skip
    observe, runs = observed_state(chosen), of_runs(context, chosen, problem, source, path)
    tell_timing(chosen, delayed=runs)
    try:
        with timed("library"), progress_bar("worlds" if runs else "controllers") as progress:
            plans = plans if plans is not None else PLANS[RUNS if runs else CHAINS]
            if runs:
                library = build_of_runs(chosen, problem, plans, options, progress, given)
            else:
                with kept_beside(path, resume) as kept:
                    library = build(problem, x0, plans, options, observe, rounds, progress, kept)
            library.save(path)
    except Interrupted as stopped:
        stopped.library.save(path)
        more = "; --resume goes on" if kept_folder(path).exists() else ""
        said = f"slcp: interrupted; saved the {len(stopped.library)} controllers there were{more}"
        typer.echo(said, err=True)
        wrote(path)
        raise typer.Exit(INTERRUPTED) from None
    console.print(library_table(library, observe))
    wrote(path)
