"""`slcp sweep`: thousands of perturbed worlds under a policy, on smoothed and hard dynamics."""

from pathlib import Path
from typing import Annotated

import typer

import slcp_warp as slcp

from .stages.sweep import cycle_states, run_sweep, sweep_table
from .support.options import Device, Integrator, Scaling, SceneName, Seed, Settings
from .support.screen import INTERRUPTED, console, one_line_errors, prepared, progress_bar, timed, wrote
from .support.simulators import OBSERVED, RESIDUALS, mechanism_name, named_scene, numbers, parse_settings


@one_line_errors
def sweep_command(
    policy: Annotated[Path, typer.Option(help="File of `slcp library` or `slcp optimise`.")],
    out: Annotated[Path, typer.Option(help="File to write; the table goes beside it as .csv.")] = Path(
        "sweep.npz"
    ),
    scene: SceneName = "flicking_finger",
    worlds: Annotated[int, typer.Option(help="Worlds of every case.")] = 4096,
    duration: Annotated[float, typer.Option(help="Simulated time [s].")] = 20.0,
    residuals: Annotated[str, typer.Option(help="smoothed, hard or both, with a comma.")] = "smoothed,hard",
    step_sizes: Annotated[str, typer.Option(help="Time steps h1,h2,.. [s].")] = "0.05,0.03",
    start: Annotated[
        Path | None, typer.Option(help="Trajectory whose states are drawn as initial ones; else the scene's.")
    ] = None,
    skip: Annotated[float, typer.Option(help="Leave out its first seconds.")] = 10.0,
    velocity_sd: Annotated[float, typer.Option(help="Kick of the initial velocities.")] = 2.0,
    position_sd: Annotated[float, typer.Option(help="Noise on the initial positions.")] = 0.0,
    torque_sd: Annotated[float, typer.Option(help="White noise on the controls.")] = 0.0,
    kick_times: Annotated[str, typer.Option(help="Times t1,t2,.. of later velocity kicks [s].")] = "",
    kick_sd: Annotated[float, typer.Option(help="Standard deviation of later kicks.")] = 2.0,
    vary: Annotated[
        list[str] | None,
        typer.Option(help="name=sd: log-normal spread of a parameter over worlds (repeatable)."),
    ] = None,
    settings: Settings = None,
    observe: Annotated[int | None, typer.Option(help="State component whose rate is judged.")] = None,
    threshold: Annotated[float, typer.Option(help="Rate that counts as spinning.")] = 0.5,
    scaling: Scaling = None,
    integrator: Integrator = "euler",
    seed: Seed = 0,
    device: Device = None,
    dtype: Annotated[str, typer.Option(help="float32 or float64.")] = "float32",
) -> None:
    """Roll a policy out in many perturbed worlds, report how robust it is. Ctrl-C saves what is finished."""
    path = prepared(out)
    chosen = named_scene(scene)
    states = None if start is None else cycle_states(slcp.Trajectory.load(start), chosen, skip)
    spec = slcp.SweepSpec(
        worlds=worlds, duration=duration, residuals=_residuals(residuals),
        step_sizes=tuple(numbers(step_sizes, "--step-sizes").tolist()), start=states,
        position_sd=position_sd, velocity_sd=velocity_sd, torque_sd=torque_sd,
        kick_times=tuple(numbers(kick_times, "--kick-times").tolist()) if kick_times else (),
        kick_sd=kick_sd, parameter_sd=parse_settings(vary, "--vary"),
        parameters=parse_settings(settings, "--set"), threshold=threshold, seed=seed,
        observe=OBSERVED.get(mechanism_name(chosen), 0) if observe is None else observe,
    )  # fmt: skip
    with timed("sweep"), progress_bar("worlds") as progress:
        report = run_sweep(chosen, policy, spec, scaling, integrator, device, dtype, progress)
    report.save(path)
    report.save(path.with_suffix(".csv"))
    console.print(sweep_table(report))
    wrote(path)
    wrote(path.with_suffix(".csv"))
    if not report.complete:
        done = sum(case["worlds"] for case in report.cases)
        typer.echo(f"slcp: interrupted; saved the {done} worlds that were finished", err=True)
        raise typer.Exit(INTERRUPTED)


def _residuals(text: str) -> tuple[str, ...]:
    names = [name.strip() for name in text.split(",")]
    unknown = [name for name in names if name not in RESIDUALS]
    if unknown:
        raise ValueError(f"--residuals names {unknown[0]!r}; choose smoothed, hard or both")
    return tuple(RESIDUALS[name] for name in names)
