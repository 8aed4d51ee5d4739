"""Every picture, from saved files only: a drawer for each kind of file."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.library.entries import scene_digest

from ..support.paper import SCENE
from ..support.records import Record, RecordError, load_record, read_kind
from ..support.simulators import mechanism_name
from ..support.tables import has_columns, is_results
from . import cycle, falsify, questions, report, space, sweep
from . import ddp as plans
from .style import save

SHOWN = 8.0  # seconds of an animation


@dataclass(frozen=True)
class Order:
    """What is wanted of a file.

    Attributes:
        path: the file.
        out: folder for its pictures.
        name: what its pictures are called, see `picture_names`.
        world: of a trajectory, its index.
        surface: a contact surface to draw behind libraries and trajectories; None: none.
    """

    path: Path
    out: Path
    name: str
    world: int = 0
    surface: Record | None = None

    @property
    def picture(self) -> Path:
        """The file's one picture."""
        return self.out / f"{self.name}.png"


TABLES = {  # which columns a .csv of a kind has
    "report": {"policy", "arm"},
    "sensitivity": {"drawn", "first", "total"},
    "map": {"x_value", "y_value", "success"},
    "falsification": {"role", "failed"},
    "rare": {"margin", "reached", "share"},
}
Drawer = Callable[[Order], list[Path]]


def chart_files(
    files: list[Path], out: Path, world: int = 0, others: Mapping[str, Drawer] | None = None
) -> list[Path]:
    """Draw what the files hold into the folder `out`; returns the pictures.

    A surface among the files is also drawn into the pictures of libraries and trajectories of its scene.
    `others`: drawers of further kinds.

    Raises:
        RecordError, LibraryError, ValueError: a file that cannot be drawn.
        FileNotFoundError: no such file.
    """
    drawers, names = DRAWERS | dict(others or {}), picture_names(files)
    kinds = {path: file_kind(path) for path in names}
    for path, kind in kinds.items():
        if kind not in drawers:
            raise RecordError(f"{path} holds a {kind!r}, which no picture is made of")
    surfaces = [load_record(path, "surface") for path, kind in kinds.items() if kind == "surface"]
    pictures: list[Path] = []
    for path, kind in kinds.items():
        pictures += drawers[kind](Order(path, out, names[path], world, surfaces[0] if surfaces else None))
    return pictures


def worlds_of(path: Path) -> int:
    """How many worlds a file of a trajectory has, of which one is drawn; 1 of other files."""
    return len(slcp.Trajectory.load(path)) if file_kind(path) == "trajectory" else 1


def picture_names(files: list[Path]) -> dict[Path, str]:
    """What the pictures of files are called: their stems, and of equal ones as much more of the path as tells
    them apart; a file that is given twice is drawn once.
    """
    parts = {path.resolve(): path for path in reversed(files)}
    stems = {path: (*whole.parent.parts[1:], whole.stem) for whole, path in parts.items()}
    there = list(stems.values())
    for path, own in stems.items():
        if there.count(own) > 1:  # report.csv beside report.npz
            stems[path] = (*own[:-1], path.name.replace(".", "_"))
    names = {path: own[-1] for path, own in stems.items()}
    for more in range(2, 1 + max(map(len, stems.values()), default=0)):
        told = list(names.values())
        for path, own in stems.items():
            if told.count(names[path]) > 1:
                names[path] = "_".join(own[-more:])
    return {path: names[path] for path in files if path in names}


def file_kind(path: Path) -> str:
    """What a file holds: "results" of the studies, one of TABLES, "size", or what `read_kind` says."""
    if path.suffix == ".parquet" or path.is_dir():  # of a sweep in chunks
        return "report"
    if path.suffix != ".csv":
        return read_kind(path)
    if is_results(path):
        return "results"
    return next((kind for kind, columns in TABLES.items() if has_columns(path, columns)), "size")


def files_in(folder: Path, others: Mapping[str, Drawer] | None = None) -> tuple[list[Path], list[Path]]:
    """Files of a folder that pictures are made of, and tables in it that none is made of."""
    found = [file for ending in ("npz", "csv") for file in sorted(folder.glob(f"*.{ending}"))
             if not file.name.startswith(".")]  # fmt: skip
    drawers = DRAWERS | dict(others or {})
    none = [file for file in found if file.suffix == ".csv" and not _has_drawer(file, drawers)]
    return [file for file in found if file not in none], none


def _has_drawer(file: Path, drawers: dict[str, Drawer]) -> bool:
    kind = file_kind(file)
    return kind in drawers and (kind != "size" or has_columns(file, set(sweep.SIZE_COLUMNS)))


def _surface(order: Order) -> list[Path]:
    return [space.surface_chart(load_record(order.path, "surface"), order.picture)]


def _library(order: Order) -> list[Path]:
    library = ddp.Library.load(order.path)
    if library.header.get("digest") == scene_digest(slcp.scenes.NAMED[SCENE]()):  # Fig. 3, of its joints
        return [space.library_chart(library, order.picture, order.surface)]
    return [report.gains_chart(library, order.picture)]


def _plan(order: Order) -> list[Path]:
    return [plans.trace_chart(load_record(order.path, "plan"), order.picture)]


def _sweep(order: Order) -> list[Path]:
    return [sweep.sweep_chart(slcp.SweepReport.load(order.path), order.picture)]


def _report(order: Order) -> list[Path]:
    return [report.report_chart(order.path, order.picture)]


def _sensitivity(order: Order) -> list[Path]:
    return [questions.sensitivity_chart(order.path, order.picture)]


def _map(order: Order) -> list[Path]:
    return [questions.map_chart(order.path, order.picture)]


def _falsification(order: Order) -> list[Path]:
    return [falsify.falsify_chart(order.path, order.picture)]


def _size(order: Order) -> list[Path]:
    return [sweep.size_chart(order.path, order.picture)]


def _trajectory(order: Order) -> list[Path]:
    """The limit cycle where it is the finger's, of others all numbers over time; frames, and an animation."""
    run, world = _checked_world(order.path, order.world), order.world
    name, made = order.name, []
    if mechanism_name(run.scene) == SCENE:
        made.append(cycle.cycle_chart(run, order.out / f"{name}_cycle.png", order.surface, world))
    else:
        made.append(save(run.plot(world), order.out / f"{name}_numbers.png"))
    made.append(cycle.frames_chart(run, order.out / f"{name}_frames.png", world))
    made.append(run.animate(order.out / f"{name}.gif", world, SHOWN))
    return made


def _checked_world(path: Path, world: int) -> slcp.Trajectory:
    """A trajectory file that has a world of this index with finite states."""
    run = slcp.Trajectory.load(path)
    if not 0 <= world < len(run):
        raise ValueError(f"--world is {world}; {path} has {len(run)} worlds")
    if not np.isfinite(run.states[world]).all():
        raise ValueError(f"{path}: the states of world {world} are not finite")
    return run


DRAWERS: dict[str, Drawer] = {
    "surface": _surface,
    "library": _library,
    "plan": _plan,
    "sweep": _sweep,
    "report": _report,
    "sensitivity": _sensitivity,
    "map": _map,
    "size": _size,
    "falsification": _falsification,
    "trajectory": _trajectory,
}
