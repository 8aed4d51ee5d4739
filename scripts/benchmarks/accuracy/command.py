"""`slcp bench charts`: every study of speed against accuracy into one file, and its charts.

A study is a module with `rows(say)`, a chart a module with `draw(rows, path)`; both are named here and
imported when their turn comes.
"""

import functools
import importlib
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from ...support.screen import INTERRUPTED, checked_folder, one_line_errors, wrote
from ...support.tables import RESULTS, write_csv
from ..shared.machine import machine
from ..shared.rows import Say
from .kept import Kept, Piece, left_in, pieces_of
from .results import Rows, read_results, same_run, studies_in

FAILED = 1  # exit code


@dataclass(frozen=True)
class Study:
    """Where a study's rows come from, and modules that draw them, by the picture's or table's file name.

    peers: a second module of rows, those of other programs, where the first has not got them all.
    """

    module: str
    charts: dict[str, str]
    peers: str | None = None


STUDIES = {
    "contact": Study("contact", {
        "contact.png": "charts.contact", "finger.png": "charts.finger", "ratios.md": "charts.ratios",
    }),
    "solver": Study("solver", {"solver.png": "charts.solver"}),
    "derivatives": Study("derivatives", {"derivatives.png": "charts.derivatives"},
                         "derivatives_peers"),
    "bias": Study("bias", {"bias.png": "charts.bias"}),
    "ddp": Study("ddp", {"ddp.png": "charts.ddp"}),
    "sweep": Study("sweep", {"sweep.png": "charts.sweep"}),
    "scaling": Study("scaling", {"scaling.png": "charts.scaling"}, "scaling_peers"),
    "many": Study("many", {
        "many.png": "charts.many", "many_error.png": "charts.many_error", "many_rest.png": "charts.many_rest",
        "many.md": "charts.many_table",
    }),
}  # fmt: skip


def load(name: str) -> Any:
    """A module, named from this folder."""
    return importlib.import_module(f".{name}", __package__)


def checked(names: list[str]) -> tuple[str, ...]:
    """The studies asked for, in the order they run; all if none is named.

    Raises:
        ValueError: there is no such study.
    """
    for name in names:
        if name not in STUDIES:
            raise ValueError(f"--study is {name!r}; choose from {', '.join(STUDIES)}")
    return tuple(name for name in STUDIES if name in names or not names)


def kept_rows(path: Path, facts: dict[str, Any], again: tuple[str, ...]) -> Rows:
    """Rows of an earlier run that may stand beside new ones, without those of the studies to run again.

    Where others are left out, the file is kept under another name.
    """
    if not path.exists():
        return []
    old = read_results(path)
    kept = [row for row in old if same_run(row, facts) and row["study"] not in again]
    dropped = [name for name in studies_in(old) if name not in (*studies_in(kept), *again)]
    if dropped:
        typer.echo(f"{path}: {', '.join(dropped)}: of another commit, version or machine, left out")
        set_aside(path)
        if kept:
            write_csv(path, kept)
    return kept


def set_aside(path: Path) -> None:
    """Rename results that a run does not go on with."""
    if path.exists():
        aside = path.replace(path.with_stem(path.stem + "_before"))
        typer.echo(f"{path}: now {aside.name}")


def run_studies(names: tuple[str, ...], path: Path, kept: Rows) -> tuple[Rows, list[str]]:
    """Run studies one after the other, the file written after each; all rows, and a line per failure.

    Of a study that is not complete the finished pieces are kept beside the file.
    """
    rows, failures = kept, []
    for name in names:
        typer.echo(f"{name} ...")
        begin = time.perf_counter()
        new, failed = run_study(name, path.parent / f"{name}.kept")
        failures += failed
        if not new:
            continue
        facts = machine()
        order = list(STUDIES)
        rows = sorted(rows + [facts | row for row in new], key=lambda row: order.index(row["study"]))
        write_csv(path, rows)
        shutil.rmtree(path.parent / f"{name}.kept", ignore_errors=True)
        typer.echo(f"  {len(new)} rows in {time.perf_counter() - begin:.0f} s")
    return rows, failures


def run_study(name: str, folder: Path) -> tuple[Rows, list[str]]:
    """The rows of a study, piece by piece, and a line per failure."""
    new: Rows = []
    failures: list[str] = []

    def say(text: str) -> None:
        typer.echo(f"  {text}")

    def attempt(measure: Callable[[], Any]) -> Any:
        try:
            return measure()
        except Exception as error:  # neither another study's failure nor that of the rows there are
            failures.append(f"study {name} failed: {type(error).__name__}: {' '.join(str(error).split())}")
            typer.echo(f"  {failures[-1]}", err=True)

    pieces: list[Piece] = []
    for module in (STUDIES[name].module, STUDIES[name].peers):
        if module is not None:
            pieces += attempt(functools.partial(_pieces, module, say)) or []
    if pieces:
        store = Kept(folder, name, [label for label, _ in pieces], machine())
        for piece in pieces:
            new += attempt(functools.partial(store.rows, piece, say)) or []
    return new, failures


def _pieces(module: str, say: Say) -> list[Piece]:
    return pieces_of(load(module), module, say)


def draw_charts(rows: Rows, out: Path) -> tuple[list[Path], list[str]]:
    """Every picture and table of the studies that have rows, into a folder; a line per failure."""
    made, failures = [], []
    if not any(name in STUDIES for name in studies_in(rows)):
        failures.append(
            f"no charts of {', '.join(studies_in(rows))}; there are charts of {', '.join(STUDIES)}"
        )
    for study in studies_in(rows):
        charts = STUDIES[study].charts if study in STUDIES else {}
        for file, module in charts.items():
            try:
                made.append(load(module).draw(rows, out / file))
            except Exception as error:
                failures.append(f"{file} failed: {type(error).__name__}: {' '.join(str(error).split())}")
    return made, failures


def draw_file(path: Path, out: Path) -> list[Path]:
    """The charts of a file of results, into a folder.

    Raises:
        ValueError: a chart that cannot be drawn.
        FileError: no such results.
    """
    made, failures = draw_charts(read_results(path), out)
    if failures:
        raise ValueError(f"{path}: {'; '.join(failures)}")
    return made


@one_line_errors
def charts_command(
    out: Annotated[Path, typer.Option(help="Folder for results.csv and the charts.")],
    study: Annotated[
        list[str] | None, typer.Option(help=f"Only this study; may be given again: {', '.join(STUDIES)}.")
    ] = None,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Leave out what was measured already by this commit."),
    ] = False,
) -> None:
    """Speed against accuracy beside the peers: all studies into one CSV, then the charts."""
    names, path, facts = checked(study or []), out / RESULTS, machine()
    checked_folder(out).mkdir(parents=True, exist_ok=True)
    if study or resume:
        kept = kept_rows(path, facts, () if resume else names)
    else:
        set_aside(path)
        kept = []
    for folder in left_in(out):
        if not resume and folder.stem in names:
            shutil.rmtree(folder)
    finished = studies_in(kept)
    for name in [name for name in names if name in finished]:
        typer.echo(f"{name}: in {path} already")
    begin = time.perf_counter()
    try:
        todo = tuple(name for name in names if name not in finished)
        rows, failures = run_studies(todo, path, kept)
    except KeyboardInterrupt:
        typer.echo(f"slcp: interrupted; finished studies are in {path}, --resume goes on", err=True)
        raise typer.Exit(INTERRUPTED) from None
    if rows:
        pictures, undrawn = draw_charts(read_results(path), out)
        failures += undrawn
        for picture in (path, *pictures):
            wrote(picture)
    typer.echo(f"{len(rows)} rows, {time.perf_counter() - begin:.0f} s")
    for failure in failures:
        typer.echo(f"slcp: {failure}", err=True)
    if failures:
        raise typer.Exit(FAILED)
