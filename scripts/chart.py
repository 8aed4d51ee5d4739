"""`slcp chart`: every picture, from saved files only."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import slcp_warp as slcp
from slcp_warp import ddp

from .benchmarks.accuracy.command import RESULTS, draw_charts
from .benchmarks.accuracy.results import is_results, read_results
from .support.common import FINGER, mechanism_name, one_line_errors, wrote
from .support.records import Record, RecordError, load_record, read_kind


def chart_files(files: list[Path], out: Path, world: int = 0) -> list[Path]:
    """Draw what the files hold into the folder `out`; returns the pictures.

    A surface among the files is also drawn into the pictures of libraries and trajectories of its scene.

    Raises:
        RecordError, LibraryError, ValueError: a file that cannot be drawn.
        FileNotFoundError: no such file.
    """
    from .charts import cycle as chart_cycle  # they load matplotlib
    from .charts import ddp as chart_ddp
    from .charts import space as chart_space
    from .charts import sweep as chart_sweep

    kinds = {path: file_kind(path) for path in files}
    surfaces = [load_record(path, "surface") for path, kind in kinds.items() if kind == "surface"]
    surface = surfaces[0] if surfaces else None
    pictures: list[Path] = []
    for path, kind in kinds.items():
        place = out / path.stem
        if kind == "surface":
            pictures.append(chart_space.surface_chart(load_record(path, kind), place.with_suffix(".png")))
        elif kind == "library":
            library = ddp.Library.load(path)
            pictures.append(chart_space.library_chart(library, place.with_suffix(".png"), surface))
        elif kind == "plan":
            pictures.append(chart_ddp.trace_chart(load_record(path, kind), place.with_suffix(".png")))
        elif kind == "sweep":
            pictures.append(chart_sweep.sweep_chart(slcp.SweepReport.load(path), place.with_suffix(".png")))
        elif kind == "size":
            pictures.append(chart_sweep.size_chart(path, place.with_suffix(".png")))
        elif kind == "results":
            made, failures = draw_charts(read_results(path), out)
            pictures += made
            if failures:
                raise ValueError(f"{path}: {'; '.join(failures)}")
        elif kind == "trajectory":
            record = _checked_world(path, world)
            if mechanism_name(record.scene) == FINGER:
                cycle = out / f"{path.stem}_cycle.png"
                pictures.append(chart_cycle.cycle_chart(record, cycle, surface, world))
            pictures.append(chart_cycle.frames_chart(record, out / f"{path.stem}_frames.png", world))
            pictures.append(chart_cycle.animation(record, out / f"{path.stem}.gif", world=world))
        else:
            raise RecordError(f"{path} holds a {kind!r}, which no picture is made of")
    return pictures


def file_kind(path: Path) -> str:
    """What a file holds: "results" of the studies, a "size" table, or what `read_kind` says."""
    if path.suffix != ".csv":
        return read_kind(path)
    return "results" if is_results(path) else "size"


def _checked_world(path: Path, world: int) -> Record:
    """A trajectory file that has a world of this index with finite states."""
    record = load_record(path, "trajectory")
    if not 0 <= world < len(record["states"]):
        raise ValueError(f"--world is {world}; {path} has {len(record['states'])} worlds")
    if not np.isfinite(record["states"][world]).all():
        raise ValueError(f"{path}: the states of world {world} are not finite")
    return record


@one_line_errors
def chart_command(
    files: Annotated[list[Path], typer.Argument(help="Files of the other commands, or folders of them.")],
    out: Annotated[Path, typer.Option(help="Folder for the pictures.")] = Path("figures"),
    world: Annotated[int, typer.Option(help="World of a trajectory to draw.")] = 0,
) -> None:
    """Draw pictures from saved files: contact surface, library, limit cycle, animation, trace, robustness."""
    chosen: list[Path] = []
    for path in files:
        if path.is_dir():
            inside = [
                file
                for name in ("*.npz", "size*.csv", RESULTS)
                for file in sorted(path.glob(name))
                if not file.name.startswith(".")
            ]
            if not inside:
                raise ValueError(f"{path} holds no .npz file, no size*.csv and no {RESULTS}")
            chosen += inside
        else:
            chosen.append(path)
    for picture in chart_files(chosen, out, world):
        wrote(picture)
