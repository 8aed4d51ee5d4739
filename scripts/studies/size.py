"""`slcp size`: how a library's robustness grows with its number of plans."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import slcp_warp as slcp
from slcp_warp import ddp

from ..support.common import (
    OBSERVED,
    Device,
    Seed,
    default_scaling,
    mechanism_name,
    named_scene,
    numbers,
    one_line_errors,
    prepared,
    progress_bar,
    wrote,
)
from ..support.records import load_record
from ..support.tables import write_csv
from ..sweep import cycle_states


def size_rows(
    scene: slcp.Scene,
    library: ddp.Library,
    plans: list[int],
    spec: slcp.SweepSpec,
    device: str | None = None,
    progress: Any = None,
) -> list[dict[str, Any]]:
    """A row per number of plans and case; a smaller library is the plans that were made first."""
    library.check_scene(scene)
    rows: list[dict[str, Any]] = []
    scaling = default_scaling(scene)
    number = np.cumsum(library.age == 0)  # of an entry's plan, from 1
    for done, count in enumerate(plans):
        if not 0 < count <= number[-1]:
            raise ValueError(f"--plans contains {count}; the library has {number[-1]}")
        part = library.select(number <= count)
        report = slcp.sweep(scene, part.policy(), spec, scaling=scaling, device=device)
        for case in report.cases:
            row = {"plans": count, "controllers": len(part)} | {
                k: case[k] for k in ("residual", "step_size", "worlds")
            }
            for name in ("mean_rate", "share_above"):
                row |= dict(zip((name, f"{name}_low", f"{name}_high"), case[name]))
            rows.append(row)
        if not report.complete:
            break
        if progress is not None:
            progress(done + 1, len(plans))
    return rows


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
        start=None if start is None else cycle_states(load_record(start, "trajectory"), scene, skip),
        observe=OBSERVED.get(mechanism_name(scene), 0), seed=seed,
    )  # fmt: skip
    counts = [int(n) for n in numbers(plans, "--plans")]
    with progress_bar("sizes") as progress:
        rows = size_rows(scene, loaded, counts, spec, device, progress)
    if not rows:
        raise KeyboardInterrupt
    write_csv(path, rows)
    wrote(path)
