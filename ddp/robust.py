"""A plan for worlds of which nobody knows which it will be: made for unlucky ones, judged in many.

A plan of the nominal numbers asks for no more than these need: a grip that just holds the disc drops a
heavier one. Plans for the worlds in which it fails have the margin that these need, in the direction that
matters; whether they are worth what they cost is asked in all of the worlds.
"""

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from slcp_warp import Options as Contact
from slcp_warp import Task, draw_worlds, sweep
from slcp_warp.ensembles.statistics import share_interval
from slcp_warp.ensembles.worlds.seeds import seed_apart
from slcp_warp.inputs.checks import instance, whole
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.storage.printed import Printed, percent, percents
from slcp_warp.tasks.disturbances.follow import followed

from .options import Options
from .planning import Late, delay_of, plan_late, problem_of
from .policies import TrackingPolicy
from .problem import Problem
from .results.result import Result
from .solver import solve

OTHER = 0x706C616E  # with the seed: worlds are not those of a sweep of the same seed
NEW = 0x6E657773  # nor are those in which what was chosen is judged once more
PASSES = 100


@dataclass(frozen=True, repr=False)
class Robust(Printed):
    """Outcome of `plan_in_worlds`.

    Attributes:
        problem: the model that the best plan is of, the task's problem with other numbers.
        best: that plan.
        index: its place in `success`; 0 is the nominal one.
        success: (M,) share of the worlds in which each plan succeeds, tracked by its gains: that of the best,
            which was chosen by it, flatters.
        worlds: in which they were judged, and as many others in which those below were.
        nominal, chosen: (share, low, high) of other worlds in which the nominal plan and the best succeed,
            with 95 % intervals (M42).
    """

    problem: Problem
    best: Result
    index: int
    success: np.ndarray
    worlds: int
    nominal: tuple[float, float, float]
    chosen: tuple[float, float, float]

    def _line(self) -> str:
        first, found = self.success[0], self.success[self.index]
        return (
            f"plan {self.index} of {len(self.success)}, chosen by {self.worlds} worlds ({percent(found)} % "
            f"of them, the nominal one {percent(first)} %), succeeds in {percents(self.chosen)} % of as "
            f"many others, the nominal one in {percents(self.nominal)} %"
        )


def plan_in_worlds(
    task: Task,
    models: int = 8,
    worlds: int = 256,
    rounds: int = 2,
    seed: int = 0,
    *,
    starts: Any = 8,
    problem: Problem | None = None,
    case: Contact | None = None,
) -> Robust:
    """Plan a task for worlds in which its nominal plan fails, and keep the plan that succeeds in most.

    The nominal plan (`plan`) is tracked in disturbed worlds under hard contact, or another `case`. In every
    round up to `models` worlds in which the best plan so far fails lend their numbers to as many models; DDP
    goes on from that plan in each of them, one batch, and all are judged in the same worlds. Of equal ones
    the first is kept.

    Args:
        task: with disturbances and a success.
        models: of a round.
        worlds: in which plans are judged, with the task's disturbances.
        rounds: ends early where no world fails.
        seed: of the starts and the worlds; a sweep of the same seed runs others.
        starts: as of `plan`.
        problem: the task's, with options or numbers of its own; None: `problem_of` the task.
        case: `slcp_warp.Options` of the worlds in which plans are judged, as those under Coulomb's friction;
            None: the task's, of the hard problem.

    Raises:
        ArgumentError: the task has no success to judge by, or its runs are longer than its plans.
    """
    instance("task", task, Task, "a slcp_warp.Task")
    instance("problem", problem, Problem | None, "a ddp.Problem")
    models, worlds, rounds = whole("models", models), whole("worlds", worlds), whole("rounds", rounds, 0)
    if task.success is None:
        raise ArgumentError(f"task {task.name!r} has no success; plans cannot be judged without one")
    problem = problem_of(task) if problem is None else problem
    if problem.horizon < task.steps:
        raise ArgumentError(
            f"task {task.name!r} runs {task.steps} steps, and its plans have {problem.horizon}; plans as "
            "long as a run are needed"
        )
    instance("case", case, Contact | None, "a slcp_warp.Options")
    case = replace(task.options, residual="hard") if case is None else case
    judge = _Judge(task, worlds, whole("seed", seed, 0), case)
    delay, x0 = delay_of(task, problem), task.start[0]
    plans = [(problem, plan_late(Late.of(problem, delay), x0, starts, seed).best)]
    well = judge([plans[0][1]])
    for _ in range(rounds):
        best = int(np.argmax(well.sum(axis=1)))
        failed = np.flatnonzero(~well[best])[:models]
        if not len(failed):
            break
        more = [_in_world(problem, judge.params[world]) for world in failed]
        found = _solve_from(plans[best][1], more, judge.starts(x0, failed), delay)
        plans += list(zip(more, found, strict=True))
        well = np.concatenate([well, judge(found)])
    index = int(np.argmax(well.sum(axis=1)))
    others = _Judge(task, worlds, seed_apart(seed, NEW), case)
    again = others([plans[i][1] for i in sorted({0, index})])
    nominal, chosen = (share_interval(int(again[i].sum()), worlds) for i in (0, -1))
    return Robust(*plans[index], index, well.mean(axis=1), worlds, nominal, chosen)


class _Judge:
    """Worlds of a task in one case, the same for all plans.

    Attributes:
        params: (W,) dicts of the numbers that the worlds have of their own.
    """

    def __init__(self, task: Task, worlds: int, seed: int, case: Contact) -> None:
        self.task, self.period, self.case = task, task.scene.state_period, case
        self.seed = seed_apart(seed, OTHER)
        self.worlds = draw_worlds(task, worlds, self.seed)
        sim = task.simulator(dtype="float32")
        base, table, own = sim.params.table()[0].astype(np.float32), self.worlds.params, sim.params.layout
        self.params: list[dict[str, np.ndarray]] = [{} for _ in range(worlds)]
        for name, start, shape in [] if table is None else own.columns:
            columns = slice(start, start + int(np.prod(shape, dtype=int)))
            if (table[:, columns] != base[columns]).any():
                for each, row in zip(self.params, table[:, columns], strict=True):
                    each[name] = row.reshape(shape).astype(np.float64)

    def starts(self, x0: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Where plans for some worlds begin, (M, nx), near x0: what follows their numbers does so."""
        starts, table = np.repeat(x0[None], len(worlds), axis=0), self.worlds.params
        if table is None:
            return starts
        base = self.task.simulator(dtype="float32").params.table()[0].astype(np.float32)
        return followed(self.task.scene, self.task.disturbances.follow, starts, table[worlds], base)

    def __call__(self, plans: list[Result]) -> np.ndarray:
        """(M, W) which worlds succeed as the plans are tracked."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # these worlds say what gains are worth
            policies = {str(i): TrackingPolicy(each, self.period) for i, each in enumerate(plans)}
        report = sweep(self.task, policies, worlds=self.worlds, seed=self.seed, cases=self.case)
        return np.array([report.part(name)["success"] for name in policies], dtype=bool)


def _in_world(problem: Problem, numbers: dict[str, np.ndarray]) -> Problem:
    """The problem with a world's numbers."""
    return problem.with_params(**numbers) if numbers else problem


def _solve_from(first: Result, models: list[Problem], starts: np.ndarray, delay: int) -> list[Result]:
    """Plans of all models from one plan with its feedback, as one batch, from starts (M, nx); controls act so
    many steps late.
    """
    names = models[0].params.names
    rows = {name: np.stack([model.params[name] for model in models]) for name in names}
    late, many = Late.of(models[0].with_params(**rows), delay), len(models)
    us, xs, K = (np.repeat(getattr(first, name)[None, delay:], many, axis=0) for name in ("us", "xs", "K"))
    options = Options(max_iterations=PASSES, method=late.rest.quick_method)
    found = solve(late.rest, late.begin(starts), us, options, xs0=xs, K0=K)
    found = late.extend(found, starts)
    return [replace(found.select(i), simulated=each.simulated()) for i, each in enumerate(models)]
