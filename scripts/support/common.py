"""What the commands share: errors as one line, progress bars, options made into simulators."""

import functools
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import warp as wp
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

import slcp_warp as slcp
from slcp_warp.options import CHOICES

console = Console()
FINGER = "flicking_finger"
BAD_INPUT = 2  # exit code
INTERRUPTED = 130
RESIDUALS = {"smoothed": "rem-logistic", **{name: name for name in CHOICES["residual"]}}
PRESETS = {FINGER: "none"}  # scaling that a named scene wants; inertia where it is not named
OBSERVED = {FINGER: 2}  # state component whose rate is judged

SceneName = Annotated[
    str,
    typer.Option(
        "--scene", help="A .toml, .json or .xml (MJCF) file, or: " + ", ".join(slcp.scenes.NAMED) + "."
    ),
]
Residual = Annotated[
    str, typer.Option(help="smoothed (rem-logistic), hard, rem-normal, erm-logistic or erm-normal.")
]
Scaling = Annotated[str | None, typer.Option(help="inertia or none; the finger's default is none.")]
Integrator = Annotated[str, typer.Option(help="euler, or trapezoidal: second order where motion is smooth.")]
Friction = Annotated[str, typer.Option(help="anitescu, or coulomb: with the hard residual.")]
Sigma = Annotated[float | None, typer.Option(help="Noise level of the smoothing; default: the scene's.")]
StepSize = Annotated[float | None, typer.Option("--step-size", help="h [s]; default: the scene's.")]
Device = Annotated[str | None, typer.Option(help="cpu, cuda:0, ...; default: the best one present.")]
Dtype = Annotated[str, typer.Option(help="float64 or float32.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", help="A parameter of the scene, name=value or name=v1,v2,.. (repeatable)."),
]
Start = Annotated[
    str | None, typer.Option(help="Initial state q1,..,v1,..; default: the scene's (the canonical start).")
]


def one_line_errors(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose bad input ends it with one line and exit code 2, and Ctrl-C with exit code 130."""

    @functools.wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        wp.config.log_level = wp.LOG_WARNING
        try:
            command(*args, **kwargs)
        except KeyboardInterrupt:
            typer.echo("slcp: interrupted; nothing was saved", err=True)
            raise typer.Exit(INTERRUPTED) from None
        except (ValueError, OSError, ImportError) as error:  # ImportError: an extra is missing
            typer.echo(f"slcp: {one_line(error)}", err=True)
            raise typer.Exit(BAD_INPUT) from None

    return run


def one_line(error: Exception) -> str:
    """An error's message in one line; of an error of the system the file first, without its number."""
    text = str(error)
    if isinstance(error, OSError) and error.filename and error.strerror:
        text = f"{error.filename}: {error.strerror}"
    return " ".join(text.split())


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on the screen; yields a callback (done, total)."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(what, total=None)

        def update(done: int, total: int) -> None:
            progress.update(task, completed=done, total=total)

        yield update


@contextmanager
def timed(what: str, times: dict[str, float] | None = None) -> Iterator[None]:
    """Print how long a stage took, and keep it in `times`."""
    start = time.perf_counter()
    yield
    seconds = time.perf_counter() - start
    if times is not None:
        times[what] = seconds
    console.print(f"[dim]{what}: {seconds:.1f} s[/dim]")


def named_scene(name: str, option: str = "--scene") -> slcp.Scene:
    """The scene of a name or a file; ValueError names the option and lists the names there are."""
    if Path(name).suffix in (".toml", ".json", ".xml"):
        return slcp.load_scene(name)
    if name not in slcp.scenes.NAMED:
        names = ", ".join(slcp.scenes.NAMED)
        raise ValueError(f"{option} is {name!r}; give a .toml, .json or .xml (MJCF) file, or one of {names}")
    return slcp.scenes.NAMED[name]()


def mechanism_name(scene: slcp.Scene) -> str:
    """The scene's name if its mechanism is that of the named scene, whatever its numbers; else ""."""
    make = slcp.scenes.NAMED.get(scene.name)
    known = make is not None and make().structure == replace(scene.structure, uncertain=False)
    return scene.name if known else ""


def default_scaling(scene: slcp.Scene) -> str:
    """The scaling that a scene wants where no option says otherwise."""
    return PRESETS.get(mechanism_name(scene), "inertia")


def make_simulator(
    scene: slcp.Scene,
    residual: str = "smoothed",
    scaling: str | None = None,
    device: str | None = None,
    dtype: str = "float64",
    integrator: str = "euler",
    friction: str = "anitescu",
) -> slcp.Simulator:
    """A simulator from a command's options."""
    if residual not in RESIDUALS:
        raise ValueError(f"--residual is {residual!r}; choose one of {list(RESIDUALS)}")
    scaling = scaling or default_scaling(scene)
    options = slcp.Options(RESIDUALS[residual], scaling, integrator=integrator, friction=friction)
    try:
        return slcp.Simulator(scene, options, device=device, dtype=dtype)
    except RuntimeError as error:  # Warp's answer to an unknown device
        raise ValueError(f"--device {device!r}: {error}") from error


def make_params(
    sim: slcp.Simulator,
    step_size: float | None = None,
    sigma: float | None = None,
    settings: list[str] | None = None,
) -> slcp.Parameters:
    """The scene's numbers with those of the options."""
    changes = parse_settings(settings, "--set")
    changes |= {k: v for k, v in (("step_size", step_size), ("sigma", sigma)) if v is not None}
    return sim.params.replace(**changes)


def parse_settings(settings: list[str] | None, option: str) -> dict[str, Any]:
    """Options of the form name=value or name=v1,v2,.. as a dictionary."""
    changes: dict[str, Any] = {}
    for text in settings or []:
        name, equals, value = text.partition("=")
        if not equals:
            raise ValueError(f"{option} is {text!r}; name=value is needed")
        values = numbers(value, f"{option} {name}")
        changes[name] = float(values[0]) if len(values) == 1 else values
    return changes


def numbers(text: str, name: str, count: int | None = None) -> np.ndarray:
    """The numbers of a comma-separated option; ValueError names the option."""
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        raise ValueError(f"{name} is {text!r}; comma-separated numbers are needed") from None
    if count is not None and len(values) != count:
        raise ValueError(f"{name} has {len(values)} numbers; {count} are needed")
    return values


def start_states(
    scene: slcp.Scene, start: str | None, worlds: int, velocity_sd: float, seed: int
) -> np.ndarray:
    """Initial states (worlds, nx): the start with normal noise on the velocities."""
    nx = 2 * scene.nv
    x0 = scene.x0 if start is None else numbers(start, "--start", nx)
    if not (math.isfinite(velocity_sd) and velocity_sd >= 0.0):
        raise ValueError(f"--velocity-sd is {velocity_sd}; it must be >= 0")
    x = np.tile(x0, (worlds, 1))
    x[:, scene.nv :] += velocity_sd * np.random.default_rng(seed).standard_normal((worlds, scene.nv))
    return x


def show_rows(title: str, rows: list[dict[str, Any]]) -> None:
    """Print rows with the same columns as a table."""
    table = Table(title=title, title_justify="left")
    for name in rows[0]:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(*(f"{v:.4g}" if isinstance(v, float) else str(v) for v in row.values()))
    console.print(table)


def prepared(path: Path, suffix: str = ".npz") -> Path:
    """An output path with its folder made; ValueError for another suffix."""
    if path.suffix != suffix:
        raise ValueError(f"--out is {path}; a name that ends in {suffix} is needed")
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def wrote(path: Path) -> None:
    """Say what was written, and how large it is."""
    typer.echo(f"wrote {path} ({path.stat().st_size / 1e3:.0f} kB)")
