"""Worlds of a sweep, once more and step by step."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

import slcp_warp as slcp

from ..support.policies import policies_of_task
from ..support.rules import OneRule

CLOSE = 1e-6  # of a measure, by which a report and what is played agree
RECORD = ("controls", "impulse", "gap")


def worlds_of_report(
    path: Path, policy: str, label: str, step_size: float | None, most: int
) -> tuple[dict[str, np.ndarray], float]:
    """The rows of the first worlds of a report in which a policy did not succeed, and their step size [s]."""
    report = slcp.load_report(path)
    key = report.key(policy, label, step_size)
    rows = report.part(*key)
    failed = np.flatnonzero(~rows["success"].astype(bool))[:most]
    if not len(failed):
        raise ValueError(
            f"{path}: {policy!r} succeeded in all worlds of case {label!r}; --world says which to play"
        )
    return {name: np.asarray(values)[failed] for name, values in rows.items()}, key[2]


def play(
    task: slcp.Task,
    policy: str | None,
    rule: OneRule,
    *,
    numbers: Sequence[int] = (),
    given: slcp.Worlds | None = None,
    report: Path | None = None,
    most: int = 8,
    step_size: float | None = None,
    **choices: Any,
) -> tuple[slcp.Trajectory, Table]:
    """A trajectory of some worlds of a task, and a table of what they are judged by.

    Args:
        policy: as the commands name one.
        rule: what the steps solve; a report's case is the one that `slcp sweep` calls so.
        numbers: of the worlds that a sweep draws; with a report and without any, the first that failed.
        given: worlds of a file, instead.
        report: of a sweep, whose rows have to agree.
        most: worlds of a report.
        choices: seed, dtype and device of the sweep.
    """
    named = policies_of_task(policy, task)
    name, followed = next(iter(named.items())) if named else ("none", None)
    ((label, options),) = rule.cases(task.options, rule.residual or "smoothed").items()
    rows = None
    if report is not None and not numbers:
        rows, step_size = worlds_of_report(report, name, label, step_size, most)
        numbers = rows["world"].tolist()
    seed, drawn = choices.pop("seed"), {"dtype": choices["dtype"], "device": choices["device"]}
    worlds = given
    if worlds is None:
        worlds = slcp.draw_worlds(task, list(numbers), seed, **drawn)
    shared = {"seed": seed, **choices}
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*begin in overlap", RuntimeWarning)  # the table says it
        sizes = None if step_size is None else (step_size,)
        swept = slcp.sweep(task, {name: followed} if named else None, worlds=worlds, cases={label: options},
                           step_sizes=sizes, **shared)  # fmt: skip
    judged = swept.part(name)
    if rows is not None:
        _check_same(report, rows, judged, (*swept.measures, "success", "status"))
    run = slcp.replay(task, followed, worlds, record=RECORD, case=options, step_size=step_size, **shared)
    run.header.update({"policy": name, "seed": seed})
    numbers = range(len(worlds)) if worlds.numbers is None else worlds.numbers
    return run, _table(f"{label}, h = {run.step_size:g} s", numbers, judged, swept.measures)


def _check_same(
    path: Any, rows: dict[str, np.ndarray], judged: dict[str, np.ndarray], names: Sequence[str]
) -> None:
    """Raise ValueError where worlds are judged otherwise than in the rows of a report."""
    for name in names:
        told, found = np.asarray(rows[name], float), np.asarray(judged[name], float)
        same = np.isclose(found, told, rtol=CLOSE, atol=0.0, equal_nan=True)
        if not same.all():
            i = int(np.argmin(same))
            raise ValueError(
                f"{path} says {name} = {told[i]:g} of world {rows['world'][i]:.0f}, and here it is "
                f"{found[i]:g}: the sweep was of another task, policy, --seed, --dtype or options"
            )


def _table(of: str, numbers: Any, judged: dict[str, np.ndarray], measures: Sequence[str]) -> Table:
    table = Table(title=of, box=SIMPLE_HEAD, padding=0)
    for heading in ("world", "success", "status", *measures, "begins in overlap"):
        table.add_column(heading, justify="right")
    for i, number in enumerate(numbers):
        values = [f"{float(judged[name][i]):.4g}" for name in measures]
        status = slcp.Status(int(judged["status"][i])).name
        stopped = float(judged["unsolved_time"][i])
        when = f" from {stopped:g} s on" if np.isfinite(stopped) else ""
        deep = f"{float(judged['start_overlap'][i]):.2g}"
        success = "yes" if judged["success"][i] else "no"
        table.add_row(str(number), success, f"{status}{when}", *values, deep)
    return table
