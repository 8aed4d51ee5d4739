"""Sweeps in folders: begun or gone on with, spread over workers, a chunk at a time, and their report."""

import shlex
import signal
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

import slcp_warp as slcp
from slcp_warp.ensembles.stored.sweep import StoredSweep
from slcp_warp.ensembles.tasks import TaskSweep
from slcp_warp.runs.progress import shown

from ..support.policies import of_python, policies_of_task, policy_name
from ..support.screen import INTERRUPTED, console
from .task_sweep import report_tables

TERMINATED = 128 + signal.SIGTERM


@dataclass(frozen=True)
class Where:
    """What of a sweep in a folder is run, and by whom.

    Attributes:
        chunk: see `chunks_of`; None: all.
        prepare: nothing is run.
        executor: None: this process.
    """

    chunk: str | None
    prepare: bool
    executor: Any

    def __post_init__(self) -> None:
        if self.executor is not None and (self.prepare or self.chunk is not None):
            raise ValueError("--prepare and --chunk run in this process: no --processes, --dask or --slurm")
        if self.prepare and self.chunk is not None:
            raise ValueError("--prepare runs nothing, and --chunk is given; one of them")

    @property
    def given(self) -> bool:
        """Whether any of it is."""
        return self.prepare or self.chunk is not None or self.executor is not None


def opened_sweep(
    folder: Path,
    task: slcp.Task,
    text: str | None,
    policies: Sequence[str] | None,
    chunk_worlds: int | None,
    where: Where,
    choices: dict[str, Any],
) -> StoredSweep:
    """The sweep of a folder, new or gone on with.

    Args:
        text: file.py:name of the task, where it is from there as it is.
        policies: as the commands name them.
        chunk_worlds: worlds of a chunk; None: about a second's.
        choices: of `TaskSweep`.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    texts = {} if text is None else {"task": text}
    texts |= {f"policy {policy_name(each)}": each for each in policies or () if of_python(each)}
    work = TaskSweep(task, policies_of_task(policies, task), chunk=chunk_worlds, **choices)
    return StoredSweep.open(folder, work, texts, chunk_worlds, None if where.executor is None else 1)


def executor_of(processes: int | None, dask: str | None, slurm: int | None, options: Sequence[str]) -> Any:
    """Workers as the command's options say; None: this process.

    Args:
        options: of SLURM, name=value.
    """
    given = [("--processes", processes), ("--dask", dask), ("--slurm", slurm)]
    names = [name for name, value in given if value is not None]
    if len(names) > 1:
        raise ValueError(f"{' and '.join(names)} are given; one of them")
    if options and slurm is None:
        raise ValueError("--slurm-option is given without --slurm")
    if processes is not None:
        return slcp.runs.processes(processes)
    if dask is not None:
        return slcp.runs.dask(int(dask) if dask.isdigit() else dask)
    if slurm is not None:
        return slcp.runs.slurm(slurm, **dict(_option(text) for text in options))
    return None


def _option(text: str) -> tuple[str, Any]:
    name, equals, value = text.partition("=")
    if not equals or not name.isidentifier():
        raise ValueError(f"--slurm-option is {text!r}; name=value is needed")
    return name, int(value) if value.isdigit() else value


def chunks_of(text: str, count: int) -> range:
    """The chunks of a text: 7 of "7"; 2, 18, 34, ... of "2/16", a share of 16."""
    first, slash, of = text.partition("/")
    if not first.isdigit() or (slash and not (of.isdigit() and int(of))):
        raise ValueError(f"--chunk is {text!r}; I, or I/N for a share of N, is needed")
    if not slash:
        if int(first) >= count:
            raise ValueError(f"--chunk is {first}; there are 0 to {count - 1}")
        return range(int(first), int(first) + 1)
    if not int(first) < int(of):
        raise ValueError(f"--chunk is {text}; a share from 0/{of} to {int(of) - 1}/{of} is needed")
    return range(int(first), count, int(of))


def finish_stored(stored: StoredSweep, where: Where) -> None:
    """Run what is missing, or of it a chunk or a share, and print the report of a whole sweep.

    Ends the command with `INTERRUPTED` or `TERMINATED` after a signal, as a shell says it.
    """
    if where.prepare:
        tell_plan(stored)
        return
    executor, chunk = where.executor, where.chunk
    with executor if executor is not None else nullcontext(), shown("sweep") as progress:
        if chunk is None:
            outcome = stored.run(executor, progress)
        else:
            outcome = stored.run_some(chunks_of(chunk, stored.job.count), progress)
    if outcome.again:
        typer.echo(f"slcp: {len(outcome.again)} damaged chunks were made again", err=True)
    left = len(stored.store.missing())
    folder = stored.store.folder
    if chunk is None and stored.store.finished():
        console.print(*report_tables(stored.report()), sep="\n")
    typer.echo(f"{stored.job.count - left} of {stored.job.count} chunks are in {folder}")
    if outcome.signal or (not outcome.complete and chunk is None):
        typer.echo(f"slcp: interrupted; go on by: slcp sweep --resume {shlex.quote(str(folder))}", err=True)
        raise typer.Exit(TERMINATED if outcome.signal == signal.SIGTERM else INTERRUPTED)


def tell_plan(stored: StoredSweep) -> None:
    """Print how many chunks a sweep has, and how many are left."""
    chunks, left = stored.job.work.chunks, len(stored.store.missing())
    resume = f"slcp sweep --resume {shlex.quote(str(stored.store.folder))}"
    typer.echo(
        f"{stored.store.folder}: {chunks.worlds} worlds in {len(chunks)} chunks, {left} of them to do; run "
        f"them by: {resume} --chunk I, I from 0 to {len(chunks) - 1}"
    )
