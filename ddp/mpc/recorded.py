"""A library of what model predictive control did in a task's disturbed worlds: local controllers by step.

A library of chains knows no time, and its plans put off what only the end of a run asks for. Here every world
is a chain: it runs as `MPC` controls it, disturbed as the task's worlds are, and the first steps of its plans
are kept with the step of the run that they were for.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from slcp_warp import Task
from slcp_warp.ensembles.chunks import ARMS
from slcp_warp.ensembles.tasks import TaskSweep
from slcp_warp.ensembles.worlds.seeds import seed_apart
from slcp_warp.inputs.checks import function, instance, whole
from slcp_warp.inputs.errors import ArgumentError

from ..library.entries import LIMITS, scene_digest
from ..library.library import Library
from ..library.receding import library_header
from ..options import Options
from ..problem import Problem
from ..workspace import Workspace
from .mpc import MPC

OTHER = 0x6C696272  # with the seed: worlds are not those of a sweep of the same seed
KEPT = ("x", "u", "K", "cost", "gain", "age", "chain", "plan")


def library_of_runs(
    task: Task,
    mpc: MPC,
    worlds: int = 20,
    entries: int | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Library:
    """Controllers of the plans by which `mpc` ran a task's disturbed worlds under hard contact.

    Its policy asks, at every step of a run, the entries of that step alone (`NearestPolicy`). Runs that do
    not succeed are left out.

    Args:
        task: whose worlds are run; its scene is the one of the problem.
        mpc: plans; its problem has the task's step size.
        worlds: runs.
        entries: controllers kept of every plan, at its steps 0, 1, ..; None: of all until the next one.
        seed: of the worlds; a sweep of the same seed runs others.
        progress: called with (worlds done, worlds in all).

    Raises:
        ArgumentError: another scene or step size, or no run succeeds.
    """
    instance("task", task, Task, "a slcp_warp.Task")
    instance("mpc", mpc, MPC, "a ddp.MPC")
    function("progress", progress, 2, optional=True)
    worlds, seed = whole("worlds", worlds), whole("seed", seed, 0)
    entries = mpc.replan if entries is None else whole("entries", entries)
    if entries > mpc.replan:
        raise ArgumentError(
            f"entries is {entries}; at most those until the next plan, {mpc.replan}, are there"
        )
    if scene_digest(task.scene) != scene_digest(mpc.model.scene):
        raise ArgumentError(f"mpc plans for scene {mpc.model.scene.name!r}, not {task.scene.name!r}")
    if not np.isclose(mpc.period, task.scene.step_size, rtol=1e-6):
        raise ArgumentError(
            f"mpc plans with steps of {mpc.period:g} s; the task's, {task.scene.step_size:g} s, are needed"
        )
    drawn = seed_apart(seed, OTHER)
    recorder = Recorder(mpc, entries)
    hard = replace(task.options, residual="hard")
    sweep = TaskSweep(task, recorder, worlds=worlds, seed=drawn, cases=hard, chunk=min(worlds, mpc.block))
    parts = []
    for index in range(len(sweep.chunks)):
        part, world0, count = sweep.chunks[index]
        if part.arm != ARMS[0]:
            continue
        rows = sweep.run(index)
        parts.append(recorder.columns(rows["success"].astype(bool)))
        if progress is not None:
            progress(world0 + count, worlds)
    columns = {name: np.concatenate([part[name] for part in parts]) for name in KEPT}
    if not len(columns["x"]):
        raise ArgumentError(
            f"mpc brings none of {worlds} worlds to success; a library is of runs that do: look at a sweep "
            "of policy mpc, and let the cost ask for what success means, or plan longer and with more passes"
        )
    lower, upper = (np.tile(a, (len(columns["x"]), 1)) for a in mpc.problem.limit_rows())
    made = {"offset": mpc.replan, "chains": worlds, "seed": seed, "end": task.steps}
    return Library(
        **columns,
        **dict(zip(LIMITS, (lower, upper), strict=True)),
        period=mpc.model.scene.state_period,
        header=library_header(mpc.problem) | made,
    )


class Recorder:
    """`MPC` as a policy on the host that keeps the first controllers of its plans.

    Args:
        mpc: plans.
        entries: controllers of every plan.
    """

    sees_states = True

    def __init__(self, mpc: MPC, entries: int) -> None:
        self.mpc, self.entries, self.period = mpc, entries, mpc.period

    def begin(self, sim: Any, worlds: np.ndarray) -> None:
        """See `policies.HostPolicy`."""
        self._worlds = np.asarray(worlds).copy()
        self._kept: list[dict[str, np.ndarray]] = []
        self._passive: Workspace | None = None
        self.mpc.begin(sim, worlds)

    def act(self, x: np.ndarray, time: float, worlds: np.ndarray) -> np.ndarray:
        """See `policies.HostPolicy`."""
        u = self.mpc.act(x, time, worlds)
        now = round(time / self.period)
        if now % self.mpc.replan == 0:
            self._keep(now // self.mpc.replan)
        return u

    def _keep(self, plan: int) -> None:
        """The first controllers of the plans that were just made."""
        problem, plans = self.mpc.plans()
        cost, passive = self._costs(problem, plans.xs[:, 0], plans.us)
        xs = np.concatenate([self.mpc.met()[:, :-1], plans.xs], axis=1)  # where they are sent
        for age in range(min(self.entries, problem.horizon)):
            rows = {"x": xs[:, age], "u": plans.us[:, age], "K": plans.K[:, age]}
            rows |= {"cost": cost, "gain": passive - cost, "chain": self._worlds}
            rows |= {name: np.full(len(cost), n) for name, n in (("age", age), ("plan", plan))}
            self._kept.append(rows)

    def _costs(self, problem: Problem, x: np.ndarray, us: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(B,) costs of plans, and of zero controls."""
        B, work = len(x), self._passive
        if work is None or work.problem is not problem or work.batch != 2 * B:
            work = self._passive = Workspace(problem, 2 * B, Options(max_iterations=0, limit_rounds=0))
        work.run(np.tile(x, (2, 1)), np.concatenate([us, np.zeros_like(us)]))
        cost = work.cost.numpy().astype(np.float64)
        return cost[:B].copy(), cost[B:].copy()

    def columns(self, keep: np.ndarray) -> dict[str, np.ndarray]:
        """What was kept of the worlds that are to be (B,), a row a controller; all its numbers are finite."""
        columns = {name: np.concatenate([rows[name][keep] for rows in self._kept]) for name in KEPT}
        finite = [np.isfinite(a).all(axis=tuple(range(1, a.ndim))) for a in columns.values()]
        good = np.all(finite, axis=0)
        return {name: a[good] for name, a in columns.items()}
