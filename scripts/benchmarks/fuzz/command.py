"""`slcp bench fuzz`: random scenes under every method, judged by an oracle that shares no code with them."""

import dataclasses
import multiprocessing
import os
import time
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from pathlib import Path
from typing import Annotated

import typer
import warp as wp
from rich.console import Console

from slcp_warp.inputs import checks
from slcp_warp.options import CHOICES
from slcp_warp.storage.files import write_text

from ...support.screen import one_line_errors
from ...support.tables import write_csv
from ..shared.machine import machine
from .case import case_of, describe, load_case, save_case
from .draws import CHUNK
from .parts import PARTS
from .report import lines_of, markdown, rows_of, show, unsolved_lines
from .run import run_task
from .shrink import shrink
from .tasks import DTYPES, GENERIC, Failure, Tally, Task
from .verdicts import SILENT, WRONG

OWN_CHUNKS = 4  # of CHUNK worlds for every scene with kernels of its own
FOLLOWED = 40  # worlds of a chunk that are followed for many steps
MOST_SHRUNK = 12  # failures that are made small: one of each method and reason


def tasks_of(
    seed: int, worlds: int, structures: int, residuals: tuple[str, ...], part: str = "steps"
) -> list[Task]:
    """The tasks of a part: scenes for the generic kernels until there are enough worlds (of those that are
    followed, steps of worlds), and those with kernels of their own, evenly between them.
    """
    methods = [o for o in GENERIC if not residuals or o.residual in residuals]
    strategies, steps = PARTS[part].strategies, sum(PARTS[part].steps) / 2
    per_chunk = CHUNK if part in ("steps", "ends", "locked") else FOLLOWED
    each = CHUNK * len(methods) * len(DTYPES)
    if per_chunk == FOLLOWED:
        each = int(per_chunk * steps) * len(methods) * len(DTYPES)
    chunks = 1
    if PARTS[part].differentiated:
        each = per_chunk
    if part == "sweeps":  # kernels of its own for every scene, whatever the strategy
        per_chunk, chunks, each = CHUNK, OWN_CHUNKS, CHUNK * OWN_CHUNKS
    count = -(-worlds // each) if methods and "generic" in strategies else 0
    generic = [Task(seed, i, "generic", chunks, residuals, per_chunk, part) for i in range(count)]
    out = [(i / max(1, count), task) for i, task in enumerate(generic)]
    for strategy in strategies:
        if strategy != "generic":
            tasks = [
                Task(seed, i, strategy, OWN_CHUNKS, residuals, per_chunk, part) for i in range(structures)
            ]
            out += [(i / max(1, structures), task) for i, task in enumerate(tasks)]
    return [task for _, task in sorted(out, key=lambda item: item[0])]


def run_all(tasks: list[Task], jobs: int, until: float, console: Console) -> Tally:
    """Every task, or those that begin in time, in `jobs` processes, BLAS in one thread each: several take
    turns at products of small matrices for a thousand times as long, on a processor that others use.
    """
    tally, done = Tally(), 0

    def take(found: Tally) -> None:
        nonlocal done
        tally.add(found)
        done += 1
        for failure in found.failures:
            console.print(
                f"  {failure.verdict}: {describe_failure(failure)}", highlight=False, soft_wrap=True
            )
        if done % 20 == 0:
            console.print(f"  {done} scenes", highlight=False)

    os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1"))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=_quiet) as pool:
        waiting: set[Future[Tally]] = set()
        for task in tasks:
            if time.monotonic() > until:
                break
            waiting.add(pool.submit(run_task, task))
            if len(waiting) >= 2 * jobs:
                ready, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for future in ready:
                    take(future.result())
        for future in waiting:
            take(future.result())
    return tally


def _quiet() -> None:
    wp.config.log_level = wp.LOG_WARNING


def describe_failure(failure: Failure) -> str:
    """A failure in one line, with what names it."""
    o, task = failure.options, failure.task
    method = "/".join([o.residual, o.scaling, o.friction, o.integrator, o.noise, o.gap, failure.dtype])
    step = "" if failure.step is None else f" step {failure.step}"
    return (f"{task.kernels} scene {task.scene} world {failure.world}{step} ({failure.kind}), {method}: "
            f"{failure.reason}, error {failure.error:.1e}")  # fmt: skip


def save_failures(failures: list[Failure], folder: Path, small: bool, console: Console) -> None:
    """One case of every method and reason, made small, into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    seen: set[tuple[str, ...]] = set()
    for failure in failures:
        words = failure.reason.split(" by ")[0]
        key = (
            failure.task.kernels,
            failure.options.residual,
            failure.options.friction,
            failure.dtype,
            words,
        )
        if key in seen or len(seen) >= MOST_SHRUNK:
            continue
        seen.add(key)
        case = case_of(failure)
        if small and not words.startswith("differs"):
            case = shrink(case, tries=60 if failure.task.own else 200)
        path = folder / f"case{len(seen)}.json"
        save_case(case, path)
        console.print(f"wrote {path}: {describe(case)}", highlight=False, soft_wrap=True)


def _write(path: Path | None, lines: list[list[str]]) -> None:
    """A table as Markdown, where there is a file for it."""
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, markdown(lines))
        typer.echo(f"wrote {path}")


@one_line_errors
def fuzz_command(
    worlds: Annotated[
        int, typer.Option(min=0, help="Worlds (state and method) for the generic kernels.")
    ] = 200000,
    structures: Annotated[int, typer.Option(min=0, help="Scenes with kernels of their own.")] = 8,
    seed: Annotated[int, typer.Option(min=0, help="Seed of scenes and states.")] = 0,
    minutes: Annotated[float, typer.Option(min=0.0, help="No scene begins after this time.")] = 60.0,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    residual: Annotated[
        list[str] | None, typer.Option(help="Only this residual; may be given again.")
    ] = None,
    part: Annotated[
        list[str] | None, typer.Option(help=f"What is run, of {', '.join(PARTS)}; may be given again.")
    ] = None,
    csv: Annotated[Path | None, typer.Option(help="Write a row per method and class here.")] = None,
    table: Annotated[Path | None, typer.Option(help="Write the table here as Markdown.")] = None,
    unsolved: Annotated[
        Path | None, typer.Option(help="Look into why worlds are NOT_CONVERGED; write that here as Markdown.")
    ] = None,
    save: Annotated[
        Path | None, typer.Option(help="Write failing cases, made small, into this folder.")
    ] = None,
    whole: Annotated[bool, typer.Option("--whole", help="Write failing cases as they were found.")] = False,
    replay: Annotated[Path | None, typer.Option(help="Run nothing but this case.")] = None,
    device: Annotated[str, typer.Option(help="Whose steps are judged: cpu, cuda:0, ...")] = "cpu",
) -> None:
    """Random scenes and states under every method, judged by an oracle in NumPy that shares no code with the
    kernels; exit 1 if a world fails silently or has a status that a proof refutes.
    """
    console, began = Console(), time.monotonic()
    _quiet()
    for name in residual or ():
        if name not in CHOICES["residual"]:
            raise ValueError(f"--residual is {name!r}; choose from {list(CHOICES['residual'])}")
    for name in part or ():
        if name not in PARTS:
            raise ValueError(f"--part is {name!r}; choose from {list(PARTS)}")
    on = str(checks.device(device).alias)
    if replay is not None:
        case = load_case(replay, on)
        verdict, reason = case.verdict
        console.print(f"{describe(case)}\nnow: {verdict} {reason}", highlight=False, soft_wrap=True)
        raise typer.Exit(int(verdict in (SILENT, WRONG)))
    tasks = [
        dataclasses.replace(task, explains=unsolved is not None, device=on)
        for name in dict.fromkeys(part or ("steps",))
        for task in tasks_of(seed, worlds, structures, tuple(residual or ()), name)
    ]
    tally = run_all(tasks, jobs, began + 60.0 * minutes, console)
    rows = rows_of(tally)
    if not rows:
        raise ValueError("nothing was run: give --worlds, --structures or more --minutes")
    show(rows, console)
    console.print(f"{time.monotonic() - began:.0f} s, compiling included")
    if csv is not None:
        write_csv(csv, [row | facts for facts in [machine()] for row in rows])
        typer.echo(f"wrote {csv}")
    _write(table, lines_of(rows))
    _write(unsolved, unsolved_lines(rows))
    if save is not None and tally.failures:
        save_failures(tally.failures, save, not whole, console)
    if tally.failures:
        raise typer.Exit(1)
