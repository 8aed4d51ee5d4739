"""A sweep of a task in this process: chunk after chunk, and a report of what is finished."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..inputs import checks
from ..tasks.task import Task
from .chunks import Part
from .outcome import Report
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
    report, done = Report(task, []), 0
    found: dict[Part, list[dict[str, np.ndarray]]] = {}
    try:
        for index in range(len(work.chunks)):
            rows, part = work.run(index), work.chunks[index].part
            found.setdefault(part, []).append(rows)
            done += len(rows["world"])
            if progress is not None:
                progress(done, work.chunks.worlds)
    except KeyboardInterrupt:
        report.complete = False
    for part in list(found):
        chunks = found.pop(part)
        report.add(*part.keys, {name: np.concatenate([rows[name] for rows in chunks]) for name in chunks[0]})
    return report
