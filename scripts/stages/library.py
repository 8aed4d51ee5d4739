"""A library of local controllers by receding horizon (section IV.C)."""

import importlib.util
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.planning import noise_scale
from slcp_warp.runs.manifest import NAME as MANIFEST

from ..support.policies import planned_policy


class Interrupted(Exception):
    """Ctrl-C came while a library was built; `library` is what there was."""

    def __init__(self, library: ddp.Library) -> None:
        super().__init__("interrupted")
        self.library = library


def build(
    problem: ddp.Problem,
    x0: np.ndarray,
    plans: int,
    options: ddp.RecedingOptions,
    observe: int | None,
    rounds: int = 5,
    progress: Callable[[int, int], None] | None = None,
    out: Path | None = None,
) -> ddp.Library:
    """A library of `plans` plans with `options.entries` controllers of each.

    Args:
        observe: the state whose advance says where the controller gets somewhere; None: there are no rounds.
        rounds: how often new chains start where the controller gets nowhere (see `ddp.build_refined`); the
            test rollouts are in single precision.
        out: a folder that keeps every plan, from which the same call goes on.

    Raises:
        Interrupted: by Ctrl-C, with what there was.
    """
    if plans < 1:
        raise ValueError(f"--plans is {plans}; it must be at least 1")
    count = plans * options.entries
    sim = problem.dynamics
    trial = slcp.Simulator(sim.scene, sim.options, device=sim.device, dtype="float32")
    if observe is None:
        library = ddp.build_library(problem, x0, count, options, progress, out=out)
    else:
        score = ddp.turning(observe)
        library = ddp.build_refined(problem, x0, count, score, rounds, options, trial, progress, out=out)
    if len(library) < count:
        raise Interrupted(library)
    return library


def build_of_runs(
    task: slcp.Task,
    problem: ddp.Problem,
    plans: int,
    options: ddp.RecedingOptions,
    progress: Callable[[int, int], None] | None = None,
    plan: ddp.Result | None = None,
) -> ddp.Library:
    """A library of a task's disturbed worlds, by so many plans or a few more (`ddp.library_of_runs`).

    Plans of runs that do not succeed are made, and not kept.

    Args:
        options: its offset, passes, entries and seed.
        plan: that runs follow; None: one is made for disturbed worlds (`ddp.plan_in_worlds`).
    """
    if plans < 1:
        raise ValueError(f"--plans is {plans}; it must be at least 1")
    if plan is None:
        found = ddp.plan_in_worlds(task, seed=options.seed, problem=problem)
        problem, plan = found.problem, found.best
    how = {"replan": options.offset, "passes": options.passes, "seed": options.seed}
    mpc = planned_policy(task, problem, plan, starts=["shift", "plan"], **how)
    worlds = -(-plans // -(-task.steps // options.offset))
    if progress is not None:
        progress(0, worlds)
    return ddp.library_of_runs(task, mpc, worlds, options.entries, options.seed, progress)


def kept_folder(path: Path) -> Path:
    """Where plans of a library's file are kept while it is built."""
    return path.with_suffix(".kept")


@contextmanager
def kept_beside(path: Path, resume: bool) -> Iterator[Path | None]:
    """The folder beside a library's file that keeps every plan while it is built; gone once it is complete.

    None where it cannot be had: the extra `data` is not installed, and not asked for.

    Raises:
        ValueError: it is there from an earlier run, and that is not to go on.
    """
    folder = kept_folder(path)
    if folder.exists() and not resume:
        raise ValueError(f"{folder} is what an earlier run left: --resume goes on from it; else remove it")
    before = folder.exists()
    if before and not (folder / MANIFEST).exists():
        raise ValueError(f"{folder} is nothing that a run has left; choose another name for the file")
    if not resume and not all(importlib.util.find_spec(name) for name in ("pyarrow", "filelock")):
        yield None
        return
    try:
        yield folder
    except BaseException:
        if not before and not any(folder.rglob("*.parquet")):
            shutil.rmtree(folder, ignore_errors=True)
        raise
    shutil.rmtree(folder, ignore_errors=True)


def task_options(task: slcp.Task, **given: Any) -> ddp.RecedingOptions:
    """How a task's chains go on, where nothing else is given.

    Noise is a fifth of the control limits; velocities are kicked as far as the task's own starts are
    disturbed.
    """
    spread = task.disturbances.deviation(task.scene)[task.scene.nv :].max()
    own = {"noise": float(noise_scale(task).max()), "perturb_variance": float(spread) ** 2}
    return ddp.RecedingOptions(**own | {name: value for name, value in given.items() if value is not None})


def library_table(library: ddp.Library, observe: int | None = None) -> Table:
    """Size, how much the plans gain over zero controls, and how far the chains advanced a state."""
    table = Table(title="library", box=SIMPLE_HEAD)
    first = library.age == 0
    cells = {"controllers": str(len(library)), "plans": str(int(first.sum()))}
    kept = len(np.unique(library.chain))
    if "end" in library.header:  # of runs, of which those that succeed are kept
        cells["runs that succeeded"] = f"{kept} of {library.header['chains']}"
    else:
        cells["chains"] = str(kept)
    for name, share in (("gain 10 %", 0.1), ("median", 0.5), ("90 %", 0.9)):
        cells[name] = f"{np.quantile(library.gain[first], share):.1f}"
    if observe is not None:
        turned = [np.ptp(library.x[library.chain == c, observe]) for c in np.unique(library.chain)]
        cells["advanced"] = f"{sum(turned):.1f}"
    for heading in cells:
        table.add_column(heading, justify="right")
    table.add_row(*cells.values())
    return table
