"""A sweep of a task in this process: chunk after chunk, and a report of what is finished."""

from collections.abc import Callable
from typing import Any

from ..inputs import checks
from ..tasks.task import Task
from .outcome import Report
from .statistics.source import MemorySource
from .tasks import TaskSweep

Progress = Callable[[int, int], None]


def sweep_task(task: Task, policies: Any, *, progress: Progress | None = None, **choices: Any) -> Report:
    """Run a task in many disturbed worlds, the same under every policy, and from every start undisturbed.

    Args:
        task: what is run, disturbed and measured.
        policies: a policy, or policies by name.
        progress: called with (worlds done, worlds in all).
        choices: of `TaskSweep`.

    A keyboard interrupt ends the sweep with what is finished (`complete` False).
    """
    checks.function("progress", progress, 2, optional=True)
    work = TaskSweep(task, policies, **choices)
    source, done = MemorySource(), 0
    report = Report(task, source)
    try:
        for index in range(len(work.chunks)):
            rows = work.run(index)
            source.add(work.chunks[index].part.keys, rows)
            done += len(rows["world"])
            if progress is not None:
                progress(done, work.chunks.worlds)
    except KeyboardInterrupt:
        report.complete = False
    return report
