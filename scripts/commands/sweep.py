"""`slcp sweep`: thousands of perturbed worlds under policies, on smoothed and hard dynamics."""

import warnings
from pathlib import Path
from typing import Annotated, Any

import typer

import slcp_warp as slcp
from slcp_warp.ensembles.stored.sweep import StoredSweep

from ..stages.stored_sweep import Where, executor_of, finish_stored, opened_sweep
from ..stages.sweep import cycle_states, run_sweep, sweep_table
from ..stages.task_sweep import changed_task, report_tables, sweep_task
from ..support.options import DEFAULT_SCENE, Device, SceneName, Seed, Settings, given_options, refuse
from ..support.policies import MISSING, POLICY
from ..support.rules import NO_RULES, Rules, residual_of, with_rules
from ..support.screen import INTERRUPTED, console, one_line_errors, prepared, progress_bar, timed, wrote
from ..support.simulators import named_scene, numbers, observed_of, parse_settings
from ..support.tasks import OptionalTask

REPORT = (".csv", ".npz", ".parquet")  # what a report is written as
DRAWN = {"worlds", "velocity_sd", "position_sd", "kick_sd", "vary", "start", "skip"}  # options
OF_RESUMING = {"resume", "prepare", "chunk", "processes", "dask", "slurm", "slurm_option"}  # options


@one_line_errors
@with_rules
def sweep_command(
    context: typer.Context,
    task: OptionalTask = None,
    policy: Annotated[
        list[str] | None,
        typer.Option(help=f"{POLICY}; of a task several (repeatable)."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="File to write: of a task report.csv, or .npz or .parquet, which keep the task too; of a "
            "scene sweep.npz, with a table beside it. Of a task also a folder: finished chunks are kept "
            "there, and the same command goes on."
        ),
    ] = None,
    resume: Annotated[
        Path | None, typer.Option(help="Go on with the sweep in a folder; nothing else is needed.")
    ] = None,
    prepare: Annotated[
        bool, typer.Option("--prepare", help="Only make the folder, and say how many chunks there are.")
    ] = False,
    chunk: Annotated[
        str | None,
        typer.Option(help="Of a folder: run chunk I alone, or with I/N each N-th from I on, for job arrays."),
    ] = None,
    chunk_worlds: Annotated[
        int | None, typer.Option(help="Of a folder: worlds of a chunk; default: about a second's.")
    ] = None,
    processes: Annotated[int | None, typer.Option(help="Of a folder: so many processes here.")] = None,
    dask: Annotated[
        str | None,
        typer.Option(help="Of a folder: workers of a Dask cluster at an address, or a number of them here."),
    ] = None,
    slurm: Annotated[int | None, typer.Option(help="Of a folder: so many jobs of SLURM at once.")] = None,
    slurm_option: Annotated[
        list[str] | None,
        typer.Option(help="name=value for submitit: timeout_min, cpus_per_task, slurm_partition, .. ."),
    ] = None,
    scene: SceneName = DEFAULT_SCENE,
    worlds: Annotated[int, typer.Option(help="Worlds of every case.")] = 4096,
    given_worlds: Annotated[
        Path | None,
        typer.Option("--given", help="Of a task: worlds of a file instead, as `slcp rare --failing` writes."),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="Simulated time [s]; default: the task's, or 20.")
    ] = None,
    residuals: Annotated[
        str,
        typer.Option("--residuals", "--residual", help="smoothed, hard or both, with a comma."),
    ] = "smoothed,hard",
    step_sizes: Annotated[
        str | None, typer.Option(help="Time steps h1,h2,.. [s]; default: the task's, or 0.05,0.03.")
    ] = None,
    start: Annotated[
        Path | None, typer.Option(help="Trajectory whose states are drawn as initial ones; else the scene's.")
    ] = None,
    skip: Annotated[float, typer.Option(help="Leave out its first seconds.")] = 10.0,
    velocity_sd: Annotated[
        float | None, typer.Option(help="Kick of the initial velocities; default: the task's, or 2.")
    ] = None,
    position_sd: Annotated[
        float | None, typer.Option(help="Noise on the initial positions; default: the task's, or 0.")
    ] = None,
    torque_sd: Annotated[
        float | None, typer.Option(help="White noise on the controls; default: the task's, or 0.")
    ] = None,
    kick_times: Annotated[
        str | None,
        typer.Option(help="Times t1,t2,.. of later velocity kicks [s]; default: the task's."),
    ] = None,
    kick_sd: Annotated[
        float | None, typer.Option(help="Standard deviation of later kicks; default: the task's, or 2.")
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            help="name=sd: log-normal spread of a parameter over worlds (repeatable); in place of all those "
            "of the task."
        ),
    ] = None,
    settings: Settings = None,
    observe: Annotated[
        int | None, typer.Option(help="State component whose rate is judged, of a scene.")
    ] = None,
    threshold: Annotated[float, typer.Option(help="Rate that counts as spinning, of a scene.")] = 0.5,
    rules: Rules = NO_RULES,
    seed: Seed = 0,
    device: Device = None,
    dtype: Annotated[str, typer.Option(help="float32 or float64.")] = "float32",
) -> None:
    """Roll policies out in many perturbed worlds, report how robust they are. Ctrl-C saves what is finished.

    Of a task: the task's disturbances, measures and success. Of a scene: the rate of one state.
    """
    # long: every option of the command is a parameter of its own, with its help
    where = Where(chunk, prepare, executor_of(processes, dask, slurm, slurm_option or []))
    if resume is not None:
        if other := sorted(given_options(context) - OF_RESUMING):
            raise ValueError(f"--resume is given with {', '.join(other)}; the folder has them")
        finish_stored(StoredSweep.resume(resume), where)
        return
    given = {
        "velocity": velocity_sd, "position": position_sd, "torque": torque_sd, "kick": kick_sd,
        "kick_times": None if kick_times is None else tuple(numbers(kick_times, "--kick-times").tolist()),
        "parameters": parse_settings(vary, "--vary") or None,
    }  # fmt: skip
    given = {name: value for name, value in given.items() if value is not None}
    if start is None:
        refuse(context, {"skip"}, "without --start")
    sizes = None if step_sizes is None else tuple(numbers(step_sizes, "--step-sizes").tolist())
    folder = out if out is not None and not out.suffix else None
    if folder is None and (where.given or chunk_worlds is not None):
        raise ValueError("--chunk, --prepare, --processes, --dask and --slurm need a folder: --out runs/name")
    if task is not None:
        if settings or observe is not None:
            raise ValueError("--set and --observe are of --scene; a task has numbers and measures of its own")
        refuse(context, {"scene", "threshold"}, "of a scene; the task has its own")
        if given_worlds is not None:
            refuse(context, DRAWN, "with --given, whose worlds have their own")
        chosen = slcp.load_task(task)
        _check_kicks(chosen, kick_times, kick_sd)
        changes = {"start": _states(start, chosen.scene, skip), "duration": duration}
        changed = changed_task(chosen, given, **changes)
        own = worlds if given_worlds is None else slcp.load_worlds(given_worlds)
        choices = {"worlds": own, "seed": seed, "cases": rules.cases(changed.options, residuals),
                   "step_sizes": sizes, "device": device, "dtype": dtype}  # fmt: skip
        if folder is not None:
            same = not (given or any(each is not None for each in changes.values()))
            text = task if same and ".py:" in task else None
            finish_stored(opened_sweep(folder, changed, text, policy, chunk_worlds, where, choices), where)
        else:
            _sweep_task(prepared(out or Path("report.csv"), REPORT), changed, policy, choices)
        return
    if given_worlds is not None:
        raise ValueError("--given is of a task; a scene's worlds are drawn")
    if folder is not None:
        raise ValueError(f"--out is {out}, a folder; only sweeps of a task have one")
    path = prepared(out or Path("sweep.npz"))
    if not policy:
        raise ValueError(MISSING)
    if len(policy) > 1:
        raise ValueError("--policy is given more than once; only a task takes several")
    mechanism = named_scene(scene)
    names = {"velocity": "velocity_sd", "position": "position_sd", "torque": "torque_sd", "kick": "kick_sd",
             "parameters": "parameter_sd", "kick_times": "kick_times"}  # fmt: skip
    disturbed: dict[str, Any] = {"velocity_sd": 2.0, "kick_sd": 2.0}
    disturbed |= {names[name]: value for name, value in given.items()}
    spec = slcp.SweepSpec(
        worlds=worlds, duration=20.0 if duration is None else duration, residuals=_residuals(residuals),
        step_sizes=sizes or (0.05, 0.03), start=_states(start, mechanism, skip), **disturbed,
        parameters=parse_settings(settings, "--set"), threshold=threshold, seed=seed,
        observe=observed_of(mechanism) if observe is None else observe,
    )  # fmt: skip
    with timed("sweep"), progress_bar("worlds") as progress:
        report = run_sweep(mechanism, policy[0], spec, rules, device, dtype, progress)
    report.save(path)
    report.save(path.with_suffix(".csv"))
    console.print(sweep_table(report))
    wrote(path)
    wrote(path.with_suffix(".csv"))
    _end(report.complete, sum(case["worlds"] for case in report.cases))


def _sweep_task(path: Path, task: slcp.Task, policy: list[str] | None, choices: dict[str, Any]) -> None:
    with timed("sweep"), progress_bar("worlds") as progress:
        report = sweep_task(task, policy, progress=progress, **choices)
    with warnings.catch_warnings(action="ignore"):  # of a .csv that does not say what the end here says
        report.save(path)
    console.print(*report_tables(report), sep="\n")
    wrote(path)
    _end(report.complete, sum(map(report.source.worlds, report.source.keys)))


def _check_kicks(task: slcp.Task, times: str | None, deviation: float | None) -> None:
    """Raise ValueError for times of kicks that are none."""
    if times is not None and deviation is None and not (task.disturbances.kick or task.disturbances.kicks):
        raise ValueError(f"--kick-times is {times}, and task {task.name!r} has no kicks; --kick-sd is needed")


def _states(start: Path | None, scene: slcp.Scene, skip: float) -> Any:
    return None if start is None else cycle_states(slcp.Trajectory.load(start), scene, skip)


def _end(complete: bool, done: int) -> None:
    """Say so where a sweep was interrupted."""
    if not complete:
        typer.echo(f"slcp: interrupted; saved the {done} worlds that were finished", err=True)
        raise typer.Exit(INTERRUPTED)


def _residuals(text: str) -> tuple[str, ...]:
    return tuple(residual_of(name.strip(), "--residuals") for name in text.split(","))
