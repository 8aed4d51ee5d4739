"""Policies in the same disturbed worlds of a task, and what came out, as tables."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

import slcp_warp as slcp
from slcp_warp.ensembles.chunks import ARMS, KEYS
from slcp_warp.ensembles.outcome import paired
from slcp_warp.ensembles.statistics import mean_interval, share_interval
from slcp_warp.storage.files import FileError

from ..support.records import load_policy
from ..support.simulators import RESIDUALS
from ..support.tables import read_csv
from .sweep import percent, plus_minus

COLUMNS = (*KEYS, "world", "success", "status")


def task_cases(task: slcp.Task, residuals: str) -> dict[str, slcp.Options]:
    """The task's options with each of some residuals, by the names that were given."""
    names = [name.strip() for name in residuals.split(",")]
    unknown = [name for name in names if name not in RESIDUALS]
    if unknown:
        raise ValueError(f"--residuals names {unknown[0]!r}; choose from {', '.join(RESIDUALS)}")
    return {name: replace(task.options, residual=RESIDUALS[name]) for name in names}


def changed_task(
    task: slcp.Task,
    disturbances: dict[str, Any],
    scaling: str | None = None,
    integrator: str | None = None,
    **changes: Any,
) -> slcp.Task:
    """The task with other disturbances, options and fields, where they are given."""
    options: dict[str, Any] = {"scaling": scaling, "integrator": integrator}
    return task.replace(
        disturbances=replace(task.disturbances, **disturbances),
        options=replace(task.options, **{name: value for name, value in options.items() if value}),
        **{name: value for name, value in changes.items() if value is not None},
    )


def sweep_task(
    task: slcp.Task,
    files: Sequence[Path],
    worlds: int,
    seed: int,
    cases: dict[str, slcp.Options],
    step_sizes: Sequence[float] | None = None,
    device: str | None = None,
    dtype: str = "float32",
    progress: Callable[[int, int], None] | None = None,
) -> slcp.Report:
    """Sweep the policies of some files, named after them."""
    policies = {path.stem: load_policy(path, task.scene)[0] for path in files}
    if len(policies) < len(files):
        raise ValueError(f"two of the policies' files have the same name: {', '.join(map(str, files))}")
    report = slcp.sweep(
        task, policies, worlds=worlds, seed=seed, cases=cases, step_sizes=step_sizes, device=device,
        dtype=dtype, progress=progress,
    )  # fmt: skip
    if not report.parts:
        raise KeyboardInterrupt
    return report


def report_columns(path: Path) -> dict[str, np.ndarray]:
    """The columns of a report's table.

    Raises:
        FileError: no report, or one that is damaged.
    """
    rows = read_csv(path, "a report of `slcp sweep`", COLUMNS)
    return {name: _column(path, name, [row[name] for row in rows]) for name in rows[0]}


def _column(path: Path, name: str, texts: list[str]) -> np.ndarray:
    if name in ("policy", "case", "arm"):
        return np.array(texts)
    if name == "success":
        if not {"True", "False"} >= set(texts):
            raise FileError(f"{path}: success holds {(set(texts) - {'True', 'False'}).pop()!r:.60}")
        return np.array([text == "True" for text in texts])
    try:
        return np.array(texts, float)
    except ValueError as error:
        raise FileError(f"{path}: {name}: {error}") from None


def measure_names(columns: dict[str, np.ndarray]) -> list[str]:
    """The columns that are measures."""
    return [name for name in columns if name not in COLUMNS and not name.startswith("drawn_")]


def parts_of(columns: dict[str, np.ndarray]) -> dict[tuple[Any, ...], dict[str, np.ndarray]]:
    """The rows of every policy, case, step size and arm."""
    keys = list(zip(*(columns[key].tolist() for key in KEYS)))
    return {
        key: {name: column[[other == key for other in keys]] for name, column in columns.items()}
        for key in dict.fromkeys(keys)
    }


def report_table(columns: dict[str, np.ndarray]) -> Table:
    """Success of every policy and case with its 95 % interval, undisturbed too, and means of the measures."""
    parts, measures = parts_of(columns), measure_names(columns)
    table = Table(
        title="success with its 95 % interval, and undisturbed; means of measures", box=SIMPLE_HEAD, padding=0
    )
    for heading in ("policy", "case", "success [%]", "still [%]", *measures, "failed"):
        table.add_column(heading, justify="left" if heading in KEYS else "right", no_wrap=heading == "case")
    for key, part in parts.items():
        policy, case, step_size, arm = key
        if arm != ARMS[0]:
            continue
        still = parts.get((*key[:3], ARMS[1]))
        shares = percent(share_interval(int(part["success"].sum()), len(part["success"])))
        alone = "" if still is None else f"{100.0 * still['success'].mean():.0f}"
        row = [f"{mean_interval(part[name])[0]:.3g}" for name in measures]
        failed = int((part["status"] != slcp.Status.SOLVED).sum())
        table.add_row(policy, f"{case}, h = {step_size:g}", shares, alone, *row, str(failed))
    return table


def comparison(columns: dict[str, np.ndarray], first: str, second: str) -> Table:
    """Differences first - second in the same disturbed worlds, with their 95 % intervals."""
    parts = {key: part for key, part in parts_of(columns).items() if key[3] == ARMS[0]}
    there = list(dict.fromkeys(key[0] for key in parts))
    for name in (first, second):
        if name not in there:
            raise ValueError(f"there is no policy {name!r} in the report; there are {', '.join(there)}")
    names = ("success", *measure_names(columns))
    table = Table(title=f"{first} less {second}, the same worlds, 95 % intervals", box=SIMPLE_HEAD)
    for heading in ("case", *names):
        table.add_column(heading, justify="left" if heading == "case" else "right")
    for (policy, case, step_size, arm), part in parts.items():
        other = parts.get((second, case, step_size, arm))
        if policy != first or other is None:
            continue
        found = paired(part, other, names)
        table.add_row(f"{case}, h = {step_size:g}", *(plus_minus(found[name], ".3g") for name in names))
    return table
