"""`slcp optimise`: DDP on the flicking finger, from one start or many, at one or more noise levels."""

from pathlib import Path
from typing import Annotated

import typer

from slcp_warp import ddp
from slcp_warp.ddp.planning import random_starts

from .stages.plan import finger_problem, optimise, outcome_table, trace_table
from .support.options import Device, Dtype, Integrator, Scaling, Seed, Settings, Sigma, Start, StepSize
from .support.screen import console, one_line_errors, prepared, timed, wrote
from .support.simulators import numbers


@one_line_errors
def optimise_command(
    out: Annotated[Path, typer.Option(help="File to write.")] = Path("plan.npz"),
    start: Start = None,
    sigma: Sigma = None,
    continuation: Annotated[
        str | None, typer.Option(help="Falling noise levels s1,s2,.. to go on to afterwards.")
    ] = None,
    method: Annotated[str, typer.Option(help="second-order, gauss-newton or first-order.")] = "second-order",
    starts: Annotated[int, typer.Option(min=1, help="Starts: zero control and random ones.")] = 1,
    schedules: Annotated[
        bool, typer.Option("--schedules", help="Eight regularisation schedules per start.")
    ] = False,
    explore: Annotated[float, typer.Option(help="Standard deviation of random starts.")] = 1.0,
    passes: Annotated[int, typer.Option(help="Passes at most.")] = 200,
    horizon: Annotated[int, typer.Option(help="Steps N of the plan.")] = 75,
    step_size: StepSize = None,
    scaling: Scaling = None,
    integrator: Integrator = "euler",
    settings: Settings = None,
    seed: Seed = 0,
    device: Device = None,
    dtype: Dtype = "float64",
) -> None:
    """Plan a trajectory of the flicking finger by DDP and save it with its feedback gains and trace."""
    path = prepared(out)
    problem = finger_problem(horizon, sigma, step_size, settings, scaling, device, dtype, integrator)
    scene = problem.dynamics.scene
    x0 = scene.x0 if start is None else numbers(start, "--start", problem.nx)
    sigmas = None if continuation is None else numbers(continuation, "--continuation")
    ddp.Options(sigma_schedule=None if sigmas is None else tuple(sigmas))  # must be positive and fall
    options = ddp.Options(max_iterations=passes, method=method)
    guesses = random_starts(starts, problem.horizon, problem.nu, explore, seed)
    with timed("DDP"):
        record, results = optimise(problem, x0, guesses, options, schedules, sigmas)
    record.header["seed"] = seed
    record.save(path)
    console.print(trace_table(results[-1]))
    console.print(outcome_table(record, results))
    wrote(path)
