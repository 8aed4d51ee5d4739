"""`slcp simulate`: worlds over time, open loop or under a policy, into a file."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import slcp_warp as slcp
from slcp_warp.inputs.times import nearest_steps

from ..stages.trajectory import judged, simulate, summary, warnings
from ..support.options import (
    DEFAULT_SCENE,
    Device,
    Dtype,
    SceneName,
    Seed,
    Settings,
    Sigma,
    Start,
    StepSize,
    refuse,
)
from ..support.policies import POLICY
from ..support.rules import NO_RULE, OneRule, with_rules
from ..support.screen import console, one_line_errors, prepared, wrote
from ..support.simulators import make_params, make_simulator, named_scene, start_states
from ..support.tasks import OptionalTask, task_simulator


@one_line_errors
@with_rules
def simulate_command(
    context: typer.Context,
    task: OptionalTask = None,
    out: Annotated[Path, typer.Option(help="File to write.")] = Path("trajectory.npz"),
    scene: SceneName = DEFAULT_SCENE,
    policy: Annotated[str, typer.Option(help=f"{POLICY}.")] = "zero",
    steps: Annotated[int | None, typer.Option(help="Time steps; default: the task's run, or 400.")] = None,
    worlds: Annotated[int, typer.Option(min=1, help="Worlds, which differ by --velocity-sd.")] = 1,
    start: Start = None,
    velocity_sd: Annotated[float, typer.Option(help="Standard deviation added to velocities.")] = 0.0,
    rules: OneRule = NO_RULE,
    sigma: Sigma = None,
    step_size: StepSize = None,
    settings: Settings = None,
    seed: Seed = 0,
    device: Device = None,
    dtype: Dtype = "float64",
) -> None:
    """Simulate worlds of a task or scene and save states, controls, impulses and gaps; exit 1 if all fail.

    Of a run as long as the task's, its measures and success are printed.
    """
    path = prepared(out)
    if task is None:
        sim = make_simulator(named_scene(scene), rules, device, dtype)
        first, length = sim.scene.x0, None
    else:
        refuse(context, {"scene"}, "and a task, which has its own")
        chosen = slcp.load_task(task)
        sim = task_simulator(chosen, rules, device, dtype)
        first, length = chosen.start[0], chosen.duration
    params = make_params(sim, step_size, sigma, settings)
    if steps is None:
        h = float(np.ravel(params["step_size"])[0])
        steps = 400 if length is None else nearest_steps("Task.duration", length, h)
    x0 = start_states(sim.scene, start, worlds, velocity_sd, seed, first)
    run = simulate(sim, params, x0, steps, policy, task=None if task is None else chosen)
    run.header["seed"] = seed
    run.save(path)
    for line in warnings(run):
        typer.echo(f"slcp: {line}", err=True)
    console.print(summary(run))
    if task is not None:
        if (table := judged(run, chosen)[0]) is not None:
            console.print(table)
        if left_out := chosen.disturbances.left_out():
            console.print(
                f"undisturbed: the task's {', '.join(left_out)} do not act here; `slcp sweep` runs its "
                "disturbed worlds, slcp.replay any of them step by step"
            )
    wrote(path)
    if not (run.recorded("status") == slcp.Status.SOLVED).any():
        raise typer.Exit(1)
