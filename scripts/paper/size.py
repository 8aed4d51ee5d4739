"""`slcp size`: how a library's robustness grows with its number of plans."""

from pathlib import Path
from typing import Annotated

import typer

import slcp_warp as slcp
from slcp_warp import ddp

from ..stages.size import size_rows
from ..stages.sweep import cycle_states
from ..support.options import Device, Seed
from ..support.screen import one_line_errors, prepared, progress_bar, wrote
from ..support.simulators import named_scene, numbers, observed_of
from ..support.tables import write_csv


@one_line_errors
def size_command(
    library: Annotated[Path, typer.Option(help="File of `slcp library`.")],
    plans: Annotated[str, typer.Option(help="Numbers of plans n1,n2,..")] = "25,50,100,200,400",
    out: Annotated[Path, typer.Option(help="CSV to write.")] = Path("size.csv"),
    start: Annotated[Path | None, typer.Option(help="Trajectory to draw initial states from.")] = None,
    skip: Annotated[float, typer.Option(help="Leave out its first seconds.")] = 10.0,
    worlds: Annotated[int, typer.Option(help="Worlds of every case.")] = 1024,
    step_sizes: Annotated[str, typer.Option(help="Time steps h1,h2,.. [s].")] = "0.05,0.03",
    velocity_sd: Annotated[float, typer.Option(help="Kick of the initial velocities.")] = 2.0,
    seed: Seed = 0,
    device: Device = None,
) -> None:
    """Sweep the first n plans of a library for several n."""
    path = prepared(out, ".csv")
    loaded = ddp.Library.load(library)
    scene = named_scene(str(loaded.header.get("scene")))
    spec = slcp.SweepSpec(
        worlds=worlds, velocity_sd=velocity_sd,
        step_sizes=tuple(numbers(step_sizes, "--step-sizes").tolist()),
        start=None if start is None else cycle_states(slcp.Trajectory.load(start), scene, skip),
        observe=observed_of(scene), seed=seed,
    )  # fmt: skip
    counts = [int(n) for n in numbers(plans, "--plans")]
    with progress_bar("sizes") as progress:
        rows = size_rows(scene, loaded, counts, spec, device, progress)
    if not rows:
        raise KeyboardInterrupt
    write_csv(path, rows)
    wrote(path)
