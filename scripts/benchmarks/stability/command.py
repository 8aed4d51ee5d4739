"""`slcp bench stability`: where each method holds, degrades, fails with a status, or fails silently."""

import math
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from slcp_warp.options import CHOICES
from slcp_warp.storage.files import write_text

from ...support.tables import write_csv
from ..shared.machine import machine
from .cases import CASES
from .mujoco import compare
from .report import draw, lines, markdown, print_table, read_rows
from .run import FAMILY, SILENT, Row, Selection, run_battery

QUICK = Selection(residuals=("hard", "rem-logistic"), dtypes=("float64",))


def _selection(
    cases: list[str], residuals: list[str], dtypes: list[str], quick: bool, everything: bool
) -> Selection:
    """What is run of the battery; ends the command with one line where a name is not offered."""
    for name, given, offered in (
        ("--case", cases, list(dict.fromkeys(c.name for c in CASES))),
        ("--residual", residuals, CHOICES["residual"]),
        ("--dtype", dtypes, ("float64", "float32")),
    ):
        for value in given:
            if value not in offered:
                typer.echo(f"slcp: {name} is {value!r}; choose from {list(offered)}", err=True)
                raise typer.Exit(2)
    return Selection(
        cases=tuple(cases),
        residuals=tuple(residuals or (QUICK.residuals if quick else ())),
        dtypes=tuple(dtypes or (QUICK.dtypes if quick else Selection().dtypes)),
        everything=everything,
    )


def _write(
    rows: list[Row], peers: list[Row], csv: Path | None, table: Path | None, chart: Path | None, read: bool
) -> None:
    """Write what is asked for of the cells; those that were read keep the facts of their own run."""
    facts = machine()
    if csv is not None:
        write_csv(csv, rows if read else [row | facts for row in rows])
        typer.echo(f"wrote {csv}")
    if table is not None:
        table.parent.mkdir(parents=True, exist_ok=True)
        write_text(table, markdown(rows) + ("\n" + lines(peers) if peers else ""))
        typer.echo(f"wrote {table}")
    if chart is not None:
        typer.echo(f"wrote {draw(rows, chart)}")


def stability_command(
    quick: Annotated[bool, typer.Option("--quick", help="A few cheap cases, hard and rem-logistic.")] = False,
    case: Annotated[list[str] | None, typer.Option(help="Only this case; may be given again.")] = None,
    residual: Annotated[
        list[str] | None, typer.Option(help="Only this residual; may be given again.")
    ] = None,
    dtype: Annotated[list[str] | None, typer.Option(help="float64 or float32; both if not given.")] = None,
    everything: Annotated[
        bool, typer.Option("--everything", help="Also float32 of all methods, and all their combinations.")
    ] = False,
    csv: Annotated[Path | None, typer.Option(help="Write a row per cell here.")] = None,
    chart: Annotated[Path | None, typer.Option(help="Draw the verdicts here (PNG).")] = None,
    mujoco: Annotated[
        float | None,
        typer.Option(help="Also run MuJoCo (extra `bench`) at this step size, beside hard mode."),
    ] = None,
    read: Annotated[
        list[Path] | None,
        typer.Option(help="Run nothing: take the cells of this CSV; of several, the later one's count."),
    ] = None,
    table: Annotated[Path | None, typer.Option(help="Write the table here as Markdown.")] = None,
) -> None:
    """Scenes that hurt solvers, judged cell by cell by an independent float64 check.

    The exit status is 1 if one fails silently.
    """
    chosen = _selection(case or [], residual or [], dtype or [], quick, everything)
    if mujoco is not None and not 0.0 < mujoco < math.inf:
        raise ValueError(f"--mujoco is {mujoco}; a positive step size is needed")
    cases = [c for c in CASES if c.quick or not quick]
    console, began = Console(), time.perf_counter()

    def say(line: str) -> None:
        console.print(f"  {line}", highlight=False, soft_wrap=True)

    rows = read_rows(read) if read else run_battery(cases, chosen, say)
    if not rows:
        typer.echo("slcp: nothing to run: no case with these residuals and precisions", err=True)
        raise typer.Exit(2)
    print_table(rows)
    console.print(f"  {time.perf_counter() - began:.0f} s, compiling included")
    peers = compare(mujoco, rows) if mujoco is not None else []
    if peers:
        console.print(f"\nhard mode and MuJoCo, h = {mujoco}\n{lines(peers)}", markup=False, soft_wrap=True)
    _write(rows, peers, csv, table, chart, bool(read))
    silent = [row for row in rows if row["verdict"] == SILENT]
    for row in silent:
        keys = ("case", *FAMILY, "dtype", "h", "sigma", "variant")
        console.print("  silent: " + ", ".join(f"{k} {row[k]}" for k in keys) + f", error {row['error']:.1e}")
    if silent:
        raise typer.Exit(1)
