"""`slcp library`: a library of local controllers by receding horizon (section IV.C)."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

import slcp_warp as slcp
from slcp_warp import ddp

from .optimise import finger_problem
from .support.common import (
    INTERRUPTED,
    OBSERVED,
    Device,
    Dtype,
    Integrator,
    Scaling,
    Seed,
    Settings,
    Sigma,
    Start,
    StepSize,
    console,
    numbers,
    one_line_errors,
    prepared,
    progress_bar,
    timed,
    wrote,
)


class Interrupted(Exception):
    """Ctrl-C came while a library was built; `library` is what there was."""

    def __init__(self, library: ddp.Library) -> None:
        super().__init__("interrupted")
        self.library = library


def build(
    problem: ddp.Problem,
    x0: np.ndarray,
    plans: int,
    options: ddp.RecedingOptions,
    rounds: int = 5,
    progress: Callable[[int, int], None] | None = None,
) -> ddp.Library:
    """A library of `plans` plans with `options.entries` controllers of each.

    Args:
        rounds: how often new chains start where the controller gets nowhere (see `ddp.build_refined`); the
            test rollouts are in single precision.

    Raises:
        Interrupted: by Ctrl-C, with what there was.
    """
    if plans < 1:
        raise ValueError(f"--plans is {plans}; it must be at least 1")
    count = plans * options.entries
    sim = problem.dynamics
    trial = slcp.Simulator(sim.scene, sim.options, device=sim.device, dtype="float32")
    score = ddp.turning(OBSERVED[sim.scene.name])
    library = ddp.build_refined(problem, x0, count, score, rounds, options, trial, progress)
    if len(library) < count:
        raise Interrupted(library)
    return library


@one_line_errors
def library_command(
    out: Annotated[Path, typer.Option(help="File to write.")] = Path("library.npz"),
    plans: Annotated[int, typer.Option("--plans", "--count", help="Plans (the paper's 400).")] = 400,
    entries: Annotated[int, typer.Option(help="Controllers kept of every plan, at its first steps.")] = 4,
    rounds: Annotated[
        int, typer.Option(help="Rounds of new chains where the controller gets nowhere; 0: none.")
    ] = 5,
    chains: Annotated[int, typer.Option(help="Independent chains at first.")] = 1,
    offset: Annotated[int, typer.Option(help="Steps d between the plans of a chain.")] = 4,
    perturb_every: Annotated[int, typer.Option(help="Steps between velocity kicks; 0: none.")] = 15,
    perturb_variance: Annotated[float, typer.Option(help="Variance of the kicks.")] = 4.0,
    unperturbed: Annotated[int, typer.Option(help="So many chains are never kicked.")] = 0,
    passes: Annotated[int, typer.Option(help="DDP passes of every plan.")] = 10,
    horizon: Annotated[int, typer.Option(help="Steps N of a plan.")] = 75,
    start: Start = None,
    sigma: Sigma = None,
    step_size: StepSize = None,
    scaling: Scaling = None,
    integrator: Integrator = "euler",
    settings: Settings = None,
    seed: Seed = 0,
    device: Device = None,
    dtype: Dtype = "float64",
) -> None:
    """Build a trajectory library of the flicking finger. Ctrl-C saves the entries there are."""
    path = prepared(out)
    problem = finger_problem(horizon, sigma, step_size, settings, scaling, device, dtype, integrator)
    x0 = problem.dynamics.scene.x0 if start is None else numbers(start, "--start", problem.nx)
    options = ddp.RecedingOptions(
        offset=offset, chains=chains, entries=entries, perturb_every=perturb_every, passes=passes,
        perturb_variance=perturb_variance, unperturbed=unperturbed, seed=seed,
    )  # fmt: skip
    try:
        with timed("library"), progress_bar("controllers") as progress:
            library = build(problem, x0, plans, options, rounds, progress)
    except Interrupted as stopped:
        stopped.library.save(path)
        typer.echo(f"slcp: interrupted; saved the {len(stopped.library)} controllers there were", err=True)
        wrote(path)
        raise typer.Exit(INTERRUPTED) from None
    library.save(path)
    console.print(library_table(library))
    wrote(path)


def library_table(library: ddp.Library) -> Table:
    """Size, and how much the plans gain over zero controls."""
    table = Table(title="library", box=SIMPLE_HEAD)
    for heading in ("controllers", "plans", "chains", "gain 10 %", "median", "90 %", "turned, rad"):
        table.add_column(heading, justify="right")
    first = library.age == 0
    low, middle, high = np.quantile(library.gain[first], (0.1, 0.5, 0.9))
    turned = [np.ptp(library.x[library.chain == c, 2]) for c in np.unique(library.chain)]
    table.add_row(
        *map(str, (len(library), int(first.sum()), len(turned))),
        *(f"{g:.1f}" for g in (low, middle, high)), f"{sum(turned):.1f}",
    )  # fmt: skip
    return table
