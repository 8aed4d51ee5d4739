"""`slcp sweep`: thousands of perturbed worlds under a policy, on smoothed and hard dynamics."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

import slcp_warp as slcp
from slcp_warp.ddp.library.entries import scene_digest

from .support.common import (
    INTERRUPTED,
    OBSERVED,
    RESIDUALS,
    Device,
    Integrator,
    Scaling,
    SceneName,
    Seed,
    Settings,
    console,
    default_scaling,
    make_simulator,
    mechanism_name,
    named_scene,
    numbers,
    one_line_errors,
    parse_settings,
    prepared,
    progress_bar,
    timed,
    wrote,
)
from .support.records import Record, load_policy, load_record


def cycle_states(record: Record, scene: slcp.Scene, skip: float) -> np.ndarray:
    """States (M, nx) of a trajectory after `skip` seconds, solved worlds only; angles in one period."""
    if scene_digest(record.scene) != scene_digest(scene):
        raise ValueError(f"the start states are of scene {record.scene.name!r}, not {scene.name!r}")
    first = round(skip / record.step_size)
    states = record["states"][record["status"] == slcp.Status.SOLVED][:, first:]
    if not states.size:
        raise ValueError(
            f"no state is left after {skip} s; the trajectory ends earlier, or no world was solved"
        )
    states = states.reshape(-1, states.shape[-1]).astype(float)
    period = scene.state_period
    return np.where(period > 0.0, np.mod(states, np.where(period > 0.0, period, 1.0)), states)


def run_sweep(
    scene: slcp.Scene,
    policy_file: Path,
    spec: slcp.SweepSpec,
    scaling: str | None = None,
    integrator: str = "euler",
    device: str | None = None,
    dtype: str = "float32",
    progress: Callable[[int, int], None] | None = None,
) -> slcp.SweepReport:
    """Sweep a policy's file; the report's `spec` also says which scene and policy they were."""
    policy, facts = load_policy(policy_file, scene)
    scaling = scaling or default_scaling(scene)
    device = str(make_simulator(scene, device=device, dtype=dtype).device)  # a bad name fails here, clearly
    report = slcp.sweep(
        scene, policy, spec, scaling=scaling, integrator=integrator, dtype=dtype, device=device,
        progress=progress,
    )  # fmt: skip
    if not report.cases:
        raise KeyboardInterrupt
    method = {"scaling": scaling, "integrator": integrator}
    report.spec |= {"scene": scene.name, **method, "dtype": dtype, "device": device, **facts}
    return report


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
    states = None if start is None else cycle_states(load_record(start, "trajectory"), chosen, skip)
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


def case_name(case: dict[str, Any]) -> str:
    """A case in words: "smoothed, h = 0.05"."""
    kind = "smoothed" if case["residual"] == "rem-logistic" else case["residual"]
    return f"{kind}, h = {case['step_size']:g}"


def percent(values: tuple[float, float, float]) -> str:
    """A share with its interval, in percent: "94.8 [93.3, 96.0]"."""
    share, low, high = (100.0 * value for value in values)
    return f"{share:.1f} [{low:.1f}, {high:.1f}]"


def plus_minus(values: tuple[float, float, float], form: str = ".3f") -> str:
    """A mean with half its interval: "0.760 ± 0.008"."""
    return f"{values[0]:{form}} ± {0.5 * (values[2] - values[1]):{form}}"


def sweep_table(report: slcp.SweepReport) -> Table:
    """The cases with their 95 % confidence intervals."""
    threshold = report.spec["threshold"]
    worlds = sum(case["worlds"] for case in report.cases)
    title = f"{worlds} worlds in {len(report.cases)} cases, 95 % confidence intervals"
    table = Table(title=title, box=SIMPLE_HEAD, padding=0, pad_edge=False, show_edge=False)
    headings = ("case", "mean rate", f"rate > {threshold:g} [%]", "2nd half [%]", "failed")
    for heading in headings:
        width = 18 if heading == "case" else None
        table.add_column(heading, justify="left" if width else "right", no_wrap=True, min_width=width)
    for case in report.cases:
        failed = case["worlds"] - case["statuses"]["SOLVED"]
        table.add_row(
            case_name(case), plus_minus(case["mean_rate"]), percent(case["share_above"]),
            percent(case["share_spinning"]), str(failed),
        )  # fmt: skip
    return table
