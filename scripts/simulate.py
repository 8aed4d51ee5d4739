"""`slcp simulate`: worlds over time, open loop or under a policy, into a file."""

from pathlib import Path
from typing import Annotated

import typer

from .stages.trajectory import simulate, summary
from .support.options import (
    Device,
    Dtype,
    Integrator,
    Residual,
    Scaling,
    SceneName,
    Seed,
    Settings,
    Sigma,
    Start,
    StepSize,
)
from .support.screen import console, one_line_errors, prepared, wrote
from .support.simulators import make_params, make_simulator, named_scene, start_states


@one_line_errors
def simulate_command(
    out: Annotated[Path, typer.Option(help="File to write.")] = Path("trajectory.npz"),
    scene: SceneName = "flicking_finger",
    policy: Annotated[str, typer.Option(help="zero, or a file of `slcp library` or `optimise`.")] = "zero",
    steps: Annotated[int, typer.Option(help="Time steps.")] = 400,
    worlds: Annotated[int, typer.Option(min=1, help="Worlds, which differ by --velocity-sd.")] = 1,
    start: Start = None,
    velocity_sd: Annotated[float, typer.Option(help="Standard deviation added to velocities.")] = 0.0,
    residual: Residual = "smoothed",
    scaling: Scaling = None,
    integrator: Integrator = "euler",
    sigma: Sigma = None,
    step_size: StepSize = None,
    settings: Settings = None,
    seed: Seed = 0,
    device: Device = None,
    dtype: Dtype = "float64",
) -> None:
    """Simulate worlds of a scene and save states, controls, impulses and gaps."""
    path = prepared(out)
    sim = make_simulator(named_scene(scene), residual, scaling, device, dtype, integrator)
    params = make_params(sim, step_size, sigma, settings)
    x0 = start_states(sim.scene, start, worlds, velocity_sd, seed)
    run = simulate(sim, params, x0, steps, policy)
    run.header["seed"] = seed
    run.save(path)
    console.print(summary(run))
    wrote(path)
