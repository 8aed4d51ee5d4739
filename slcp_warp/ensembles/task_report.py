"""A sweep of a task, chunk after chunk, and a report of what is finished."""

import os
from collections.abc import Callable, Mapping
from typing import Any

import warp as wp

from ..inputs import checks
from ..inputs.errors import ArgumentError
from ..runs.progress import Standing
from .outcome import Report
from .statistics.source import NOTED, MemorySource
from .statistics.starts import Starts
from .stored.sweep import StoredSweep
from .stored.travel import given
from .tasks import TaskSweep
from .worlds.others import warn_of_others

Progress = Callable[[int, int], None]


def sweep_task(
    task: Any,
    policies: Any,
    *,
    out: str | os.PathLike[str] | None = None,
    executor: Any = None,
    progress: Progress | None = None,
    **choices: Any,
) -> Report:
    """Run a task in many disturbed worlds, the same under every policy, and from every start undisturbed.

    Args:
        task: what is run, disturbed and measured; or its name or file, as of `load_task`.
        policies: a policy, or policies by name; each may be a text, as of `policies.load_policy`.
        out: folder where finished chunks are kept; the same call goes on where it was. None: in memory.
        executor: of other processes that run the chunks of `out`; None: this process runs them.
        progress: called with (worlds done, worlds in all).
        choices: of `TaskSweep`.

    A keyboard interrupt ends the sweep with what is finished (`complete` False). Worlds that begin in overlap
    are a RuntimeWarning.
    """
    checks.function("progress", progress, 2, optional=True)
    if executor is not None and out is None:
        raise ArgumentError("executor is given, but no out: other processes hand on chunks in a folder")
    found, named, texts = given(task, policies)
    work = TaskSweep(found, named, **choices)
    if work.given is not None:
        warn_of_others(found, work.given, 4)
    tell = progress or (lambda done, total: None)
    if out is None:
        report = _in_memory(work, tell)
    else:
        report = _on_disk(work, out, texts, executor, choices.get("chunk"), tell)
    Starts.of(report.source).tell(stacklevel=3)
    return report


def _in_memory(work: TaskSweep, progress: Progress) -> Report:
    source, done = MemorySource(), 0
    report = Report(work.task, source)
    assert work.task.duration is not None
    recorded = len(work.record.states) * work.record.count(work.task.duration)
    each = len(work.task.measures) + recorded + 2 + len(NOTED)  # world, success and status
    checks.memory("worlds: their rows", work.chunks.worlds * each, 8, wp.get_device("cpu"))
    try:
        for index in range(len(work.chunks)):
            rows = work.run(index)
            source.add(work.chunks[index].part.keys, rows)
            done += len(rows["world"])
            progress(done, work.chunks.worlds)
    except KeyboardInterrupt:
        report.complete = False
    return report


def _on_disk(
    work: TaskSweep,
    out: str | os.PathLike[str],
    texts: Mapping[str, str],
    executor: Any,
    chunk: int | None,
    progress: Progress,
) -> Report:
    stored = StoredSweep.open(out, work, texts, chunk, None if executor is None else 1)
    total = work.chunks.worlds

    def tell(standing: Standing) -> None:
        progress(standing.tally.get("rows", 0), total)

    stored.run(executor, tell)
    return stored.report()
