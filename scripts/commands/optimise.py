"""`slcp optimise`: DDP on a task, from one start or many, at one or more noise levels."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.planning import METHODS, SCHEDULES, Late, delay_of, noise_scale
from slcp_warp.inputs.checks import number
from slcp_warp.results.overlaps import overlaps
from slcp_warp.runs.stopping import Stop, on_signals

from ..stages.plan import first_controls, optimise, outcome_table, shown_controls, task_problem, trace_table
from ..stages.trajectory import judged, simulate
from ..support.options import Device, Dtype, Seed, Settings, Sigma, Start, StepSize
from ..support.policies import tell_gains
from ..support.rules import NO_RULE, OneRule, with_rules
from ..support.screen import console, one_line_errors, prepared, timed, waiting, wrote
from ..support.simulators import numbers, start_state
from ..support.tasks import DEFAULT, TaskName, tell_timing

FLAT = (
    "no start touches what the cost is of: add terms that lead there (a finger to what it grips), more "
    "--starts, wider ones (--explore), or a larger noise level first, --sigma 0.3 --continuation 0.1,0.05 "
    "(docs/do/cost.md)"
)
HELP = (
    "try more --starts or wider ones (--explore), or let the cost lead to what success asks for "
    "(docs/do/cost.md)"
)

Method = Annotated[
    str | None,
    typer.Option(
        help="second-order, gauss-newton or first-order; default: gauss-newton from every start, then "
        "second-order from the best."
    ),
]
Source = Annotated[
    str | None,
    typer.Option(
        "--from",
        help="A plan, or a policy (a library, file.py:name, ..) that is run once: its controls are a start "
        "in place of zeros (with --starts 1 the only one).",
    ),
]
Gain = Annotated[
    float,
    typer.Option(help="Stop where a pass lowers the cost by no more than this; 0: go on to rounding."),
]


@contextmanager
def passes_told(stop: Stop, on: bool) -> Iterator[Callable[[str, int, int, float], bool]]:
    """How far planning is, said as it goes on. What it gives is called after every pass, True where passes
    are to end: where Ctrl-C, if that is `on`, has wished for `stop`.
    """
    with (
        on_signals(stop, grace=None) if on else nullcontext(),
        timed("DDP"),
        waiting("planning from all starts; minutes where many bodies may touch") as say,
    ):

        def tell(name: str, made: int, going: int, cost: float) -> bool:
            say(f"{name}, pass {made}: {going} of the plans go on, lowest cost {cost:.6g}")
            return bool(stop)

        yield tell


def tell_limits(result: ddp.Result) -> None:
    """Say where a plan breaks its limits of states, by how much and when."""
    if not result.keeps_limits(ddp.Options.limit_tolerance):
        typer.echo(
            f"slcp: this plan breaks the task's state_limits, most of all {result.beyond_limits()}: allow "
            "more --passes, try more --starts, or give limits that can be kept (docs/do/cost.md)",
            err=True,
        )


def tell_success(task: slcp.Task, problem: ddp.Problem, x0: np.ndarray, path: Path) -> None:
    """Run a plan as long as the task's runs in the undisturbed task, and say what that says of it."""
    if task.success is None or problem.horizon != task.steps:
        return
    assert isinstance(problem.dynamics, slcp.Simulator)
    run = simulate(problem.dynamics, problem.params, x0[None], task.steps, path, task=task)
    deep = overlaps(run.scene, run.recorded("gap")[:, 0])
    if deep:
        typer.echo(f"slcp: the start overlaps: {deep}", err=True)
    table, good = judged(run, task)
    if table is not None:
        console.print(table)
    if good is not None and not good.all():
        pressed = not run.contact_impulse.size or np.any(run.contact_impulse > 0.0)
        nothing = "" if pressed else ", and nothing is touched"
        typer.echo(f"slcp: undisturbed, this plan is no success of the task{nothing}: {HELP}", err=True)


def tell_end(result: ddp.Result, path: Path, stop: Stop) -> None:
    """Say what was written, and of what it is where it is no solution."""
    if int(result.status) == ddp.Status.FLAT:
        typer.echo(f"slcp: {FLAT}", err=True)
    else:
        tell_gains("the plan", result)
    tell_limits(result)
    wrote(path)
    if stop:
        after = f"after {int(result.iterations)} passes"
        typer.echo(f"slcp: interrupted; saved the best of the plans so far, {after}", err=True)
        raise typer.Exit(128 + stop.signal)


@one_line_errors
@with_rules
def optimise_command(
    task: TaskName = DEFAULT,
    out: Annotated[Path, typer.Option(help="File to write.")] = Path("plan.npz"),
    source: Source = None,
    start: Start = None,
    sigma: Sigma = None,
    continuation: Annotated[
        str | None, typer.Option(help="Falling noise levels s1,s2,.. to go on to afterwards.")
    ] = None,
    method: Method = None,
    starts: Annotated[
        int,
        typer.Option(
            min=1, help="Starts: zero control and noise; from 4 on sampled and stabilised ones as well."
        ),
    ] = 8,
    schedules: Annotated[
        bool, typer.Option("--schedules", help="Eight regularisation schedules per start, second-order.")
    ] = False,
    explore: Annotated[
        float | None,
        typer.Option(
            help="Deviation of random starts; others have 2.5 and 5 times as much; default: a fifth of the "
            "limits, or 1."
        ),
    ] = None,
    passes: Annotated[int, typer.Option(help="Passes at most; 150 where a method follows.")] = 400,
    gain: Gain = 0.0,
    horizon: Annotated[int | None, typer.Option(help="Steps N of the plan; default: the task's.")] = None,
    step_size: StepSize = None,
    rules: OneRule = NO_RULE,
    settings: Settings = None,
    seed: Seed = 0,
    device: Device = None,
    dtype: Dtype = "float64",
) -> None:
    """Plan a task by DDP and save the trajectory with its feedback gains and trace.

    Ctrl-C ends the passes after the one at hand, and what is the best plan then is saved; a second Ctrl-C, or
    one where --method or --schedules is given, leaves nothing.
    """
    path, chosen = prepared(out), slcp.load_task(task)
    tell_timing(chosen, delayed=True)
    problem = task_problem(chosen, horizon, sigma, step_size, settings, rules, device, dtype)
    x0 = chosen.start[0] if start is None else start_state(chosen.scene, start, chosen.start[0])
    sigmas = None if continuation is None else numbers(continuation, "--continuation")
    ddp.Options(sigma_schedule=None if sigmas is None else tuple(sigmas))  # must be positive and fall
    methods = () if method is not None or schedules else METHODS
    every = METHODS if method is None else (method,)
    options = ddp.Options(
        max_iterations=passes, method=every[-1], improvement_tolerance=number("--gain", gain, 0.0),
        regularization=SCHEDULES if methods else ddp.Regularization(),
    )  # fmt: skip
    scale = noise_scale(chosen) if explore is None else number("--explore", explore, 0.0)
    stop = Stop()
    with passes_told(stop, bool(methods)) as tell:
        late = Late.of(problem, delay_of(chosen, problem))
        given = None if source is None else shown_controls(late, x0, source, chosen)
        guesses = first_controls(late, x0, starts, seed, scale, every, given)
        record, results = optimise(late, x0, guesses, options, schedules, sigmas, methods, tell, stop)
    record.header["seed"], record.header["task"] = seed, chosen.name
    record.save(path)
    console.print(trace_table(results[-1]), outcome_table(record, results))
    tell_success(chosen, late.whole, x0, path)
    tell_end(results[-1], path, stop)
