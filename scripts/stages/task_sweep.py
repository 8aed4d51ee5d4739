"""Policies in the same disturbed worlds of a task, and what came out, as tables."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

import slcp_warp as slcp
from slcp_warp.ensembles.chunks import ARMS, KEYS
from slcp_warp.ensembles.outcome import overlap_text
from slcp_warp.ensembles.statistics.intervals import Interval

from ..support.asking import steps_of_sweep, watched, worlds_of_sweep
from ..support.policies import policies_of_task
from .sweep import percent

BESIDE = 6  # measures, at most, beside the success
NONE = "none finite"  # of a measure in all worlds: a time that none reaches


def changed_task(task: slcp.Task, disturbances: dict[str, Any], **changes: Any) -> slcp.Task:
    """The task with other disturbances and fields, where they are given."""
    return task.replace(
        disturbances=replace(task.disturbances, **disturbances),
        **{name: value for name, value in changes.items() if value is not None},
    )


def sweep_task(task: slcp.Task, given: Sequence[str] | None, **choices: Any) -> slcp.Report:
    """Sweep policies as the commands name them, see `named_policy`; `progress` is told how long they take."""
    policies, progress = policies_of_task(given, task), choices.get("progress")
    if progress is not None:
        sizes = [choices.get(name) for name in ("worlds", "cases", "step_sizes")]
        policies = watched(policies, steps_of_sweep(task, *sizes), progress.say)
        progress(0, worlds_of_sweep(task, *sizes) * max(1, len(policies or ())))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*begin in overlap", RuntimeWarning)  # `report_tables` say it
        report: slcp.Report = slcp.sweep(task, policies, **choices)
    if not report.source.keys:
        raise KeyboardInterrupt
    return report


def report_tables(report: slcp.Report) -> list[Table]:
    """Success of every policy and case with its 95 % interval, undisturbed too, and means of the measures: of
    many in a table of their own.
    """
    if len(report.measures) <= BESIDE:
        return [report_table(report, report.measures)]
    rows = [row for row in report.summary if row["arm"] == ARMS[0]]
    table = Table(title="means of measures", box=SIMPLE_HEAD, padding=0)
    table.add_column("measure")
    for row in rows:
        table.add_column(f"{row['policy']}\n{row['case']}, h = {row['step_size']:g}", justify="right")
    for name in report.measures:
        table.add_row(name, *(_mean(row, name) for row in rows))
    return [report_table(report, ()), table]


def report_table(report: slcp.Report, measures: Sequence[str]) -> Table:
    """The success of every policy and case with its 95 % interval, undisturbed too, and some means."""
    table = Table(
        title="success with its 95 % interval, and undisturbed [%]"
        + ("; means of measures" if measures else ""),
        box=SIMPLE_HEAD,
        padding=0,
    )
    found = {tuple(row[key] for key in KEYS): row for row in report.summary}
    deep = any(row["overlapping"].get("worlds") for row in found.values())
    for heading in ("policy", "case", "success [%]", "undisturbed", *measures, "unsolved",
                    *(["begin in overlap"] if deep else [])):  # fmt: skip
        table.add_column(heading, justify="left" if heading in KEYS else "right", no_wrap=heading == "case")
    for (policy, case, step_size, arm), row in found.items():
        if arm != ARMS[0]:
            continue
        still = found.get((policy, case, step_size, ARMS[1]))
        alone = "" if still is None else f"{100.0 * still['success'][0]:.0f}"
        means = [_mean(row, name) for name in measures]
        failed = str(row["worlds"] - row["statuses"]["SOLVED"])
        begin = [overlap_text(row["overlapping"])] if deep else []
        table.add_row(
            policy, f"{case}, h = {step_size:g}", percent(row["success"]), alone, *means, failed, *begin
        )
    return table


def _mean(row: dict[str, Any], name: str) -> str:
    """A measure's mean; with the share of the worlds where it is finite, if that is not all."""
    mean, share = f"{row[name][0]:.3g}", row["finite"][name] / max(row["worlds"], 1)
    if not share:
        return NONE
    return mean if share == 1.0 else f"{mean} in {100.0 * share:.1f} %"


def tell_incomplete(report: slcp.Report, path: str | Path) -> slcp.Report:
    """The report, after a word about what is missing in it."""
    if not report.complete:
        worlds = sum(report.source.worlds(key) for key in report.source.keys)
        typer.echo(f"slcp: {path} is not finished: of the {worlds} worlds that are there alone", err=True)
    return report


def comparison(
    report: slcp.Report, first: str, second: str, peeking: bool = False, other: slcp.Report | None = None
) -> Table:
    """Differences first - second in the same disturbed worlds, with their 95 % intervals; the second policy
    is the other report's, where there is one.
    """
    beside = report if other is None else other
    keys, others = ([k for k in each.source.keys if k[3] == ARMS[0]] for each in (report, beside))
    for name, own, which in ((first, keys, "the report"), (second, others, "the other report")):
        there = list(dict.fromkeys(key[0] for key in own))
        if name not in there:
            which = "the report" if other is None else which
            raise ValueError(f"there is no policy {name!r} in {which}; it has {', '.join(map(repr, there))}")
    names = ("success", *(name for name in report.measures if name in beside.measures))
    looks = ", at all looks" if peeking else ""
    of = "" if other is None else " of the other report"
    table = Table(title=f"{first} less {second}{of}, the same worlds, 95 % intervals{looks}", box=SIMPLE_HEAD)
    for heading in ("case", *names):
        table.add_column(heading, justify="left" if heading == "case" else "right")
    for policy, case, step_size, arm in keys:
        if policy != first or (second, case, step_size, arm) not in others:
            continue
        found = report.compare(first, second, case, step_size, peeking, other=other)
        if np.isnan(found["success"][0]):
            raise ValueError(
                f"{first} and {second} have no world in common in {case}, h = {step_size:g}: what is "
                "finished of them is of different worlds"
            )
        table.add_row(f"{case}, h = {step_size:g}", *(_difference(found[name]) for name in names))
    if not table.row_count:
        raise ValueError(f"{first} and {second} have no case in common at one step size")
    return table


def _difference(found: Interval) -> str:
    """A difference with its interval; of what is finite under both policies in no world there is none."""
    if np.isnan(found[0]):
        return NONE
    if not np.isfinite(found[1:]).all():
        return f"{found[0]:.3g} of one world"
    return f"{found[0]:.3g} [{found[1]:.3g}, {found[2]:.3g}]"
