"""A plan in one call: starts of four kinds, Gauss-Newton from all of them, second order from the best."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from slcp_warp import Scene, Simulator, Task
from slcp_warp.costs import NO_COST
from slcp_warp.inputs.checks import array, function, instance, whole
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
from slcp_warp.kernels.device.launch import together
from slcp_warp.results.overlaps import OVERLAP

from ..multistart import Multistart
from ..options import Options, Regularization
from ..parts.gaps import GAP_PASSES
from ..parts.starts import unstable
from ..problem import Problem
from ..results.result import Result
from ..sampling.options import SHARE, Sampling, limit_share
from ..sampling.sampler import Sampler
from ..workspace import Workspace
from .late import Late, delay_of
from .set_points import set_points

METHODS = ("gauss-newton", "second-order")
SCHEDULES = Regularization(  # of the state, and of the control as Tassa, Mansard & Todorov (2014) have it
    initial=np.array([1.0e-3, 1.0]),
    factor=np.array([2.0, 1.6]),
    state_weight=np.array([1.0, 0.0]),
    control_weight=np.array([0.0, 1.0]),
)
NOISE_TIME = 8.0  # correlation time of random starts [steps]
WIDTHS = (5.0, 1.0, 2.5)  # of random starts after the first, in turn, in their scale
SAMPLED = 4  # random starts from which on there are others, too
PASSES, LAST_PASSES = 150, 400  # of all methods but the last, and of the last
FINISH = 2  # plans that every further method goes on from
SHARES = (
    (15, 0.5),
    (40, 0.25),
    (80, 0.15),
)  # passes of a method but the last, and plans that go on after them
LAST_RUNGS = ((20, 3), (100, 1))  # passes of the last method, and plans that go on after them

Tell = Callable[[str, int, int, float], bool | None]  # method, passes, plans that go on, lowest cost


def problem_of(task: Task, sim: Simulator | None = None) -> Problem:
    """The problem of a task: its cost, horizon, control limits and state limits.

    Args:
        sim: a simulator of the task's scene; None: `task.simulator()`.

    Raises:
        ArgumentError: a task without a cost, a horizon or controls: there is nothing to plan.
    """
    instance("task", task, Task, "a slcp_warp.Task")
    cost = task.cost is not NO_COST
    there = {"controls": task.scene.nu > 0, "cost": cost, "horizon": task.horizon is not None}
    if missing := [name for name, value in there.items() if not value]:
        raise ArgumentError(f"task {task.name!r} has no {' and no '.join(missing)}; there is nothing to plan")
    assert task.horizon is not None
    instance("sim", sim, Simulator | None, "a slcp_warp.Simulator")
    sim = task.simulator() if sim is None else sim
    limits = task.state_limit_rows()
    before = task.disturbances.fixed().before
    return Problem(sim, task.cost, task.horizon, None, task.control_limits, limits, before)


def random_starts(
    count: int, horizon: int, nu: int, scale: Any, seed: int, noise_time: float = NOISE_TIME
) -> np.ndarray:
    """Controls (count, N, nu): the first zero, the others smoothed noise of standard deviation `scale`.

    Args:
        scale: a number, or (nu,).
        noise_time: its correlation time [steps].
    """
    white = np.random.default_rng(seed).standard_normal((count, horizon, nu))
    keep = np.exp(-1.0 / noise_time)
    for k in range(1, horizon):
        white[:, k] = keep * white[:, k - 1] + np.sqrt(1.0 - keep**2) * white[:, k]
    white[0] = 0.0
    return scale * white


def noise_scale(task: Task, share: float = SHARE) -> np.ndarray:
    """(nu,) a share of the larger limit of every control, and 1 where it has none."""
    return limit_share(task.control_limits, task.scene.nu, share)[0]


def plan_starts(
    problem: Problem,
    x0: Any,
    count: int,
    seed: int,
    scale: Any = None,
    sampling: Sampling | None = None,
    method: str = METHODS[0],
) -> np.ndarray:
    """Controls (count, count + 1 or count + 2, N, nu) to plan from, within the limits.

    Zeros and smoothed noise, of servos about the set-points that hold the first state's place
    (`set_points`); where there are four of them the best of `sample` as well and, where the first state is
    unstable, what multiple shooting from that state held comes to once its gaps are closed.

    Args:
        scale: standard deviation of what is sampled and, times 1, 2.5 and 5 in turn, of the noise; None: a
            fifth of the limits, or 1.
        sampling: how is sampled; its scale is `scale` where that is given.
        method: of the passes that close gaps.
    """
    drawn = Sampling(scale=scale) if scale is not None else Sampling()
    scale = drawn.deviations(problem.control_limits, problem.nu)[0]
    lower, upper = problem.limit_rows()
    us = random_starts(count, problem.horizon, problem.nu, scale, seed)
    us = us * np.resize(WIDTHS, count)[:, None, None]
    held = set_points(getattr(problem.dynamics, "scene", None), np.asarray(x0, float))
    if held.any():
        us += held
    us = np.clip(us, lower[0], upper[0])
    if count < SAMPLED:
        return us
    sampler = Sampler(problem, 1, replace(sampling or Sampling(), scale=scale))
    sampler.run(x0, us[0] if held.any() else None, seed)
    found: list[Sampler | Workspace] = [sampler]
    work = Workspace(problem, 1, Options(method=method, start="hold", max_iterations=GAP_PASSES))
    if unstable(work, x0)[0]:
        work.start(x0, None, limit=GAP_PASSES)
        found.append(work)
    more = [each.us.numpy().copy() for each in found if np.isfinite(each.cost.numpy()[0])]
    return np.concatenate([us, *more])


def compile_kernels(problem: Problem, methods: tuple[str, ...] = METHODS, count: int = 0) -> None:
    """Compile what planning by these methods from so many random starts needs, several kernels at once."""
    with together():  # the last method's first: it has the largest, which nothing should wait for
        for method in reversed(methods):
            Workspace(problem, 1, Options(method=method))
        if count >= SAMPLED:
            Sampler(problem, 1)


def plan(
    task: Task | Problem,
    starts: Any = 8,
    seed: int = 0,
    *,
    explore: Any = None,
    x0: Any = None,
    sim: Simulator | None = None,
    options: Options | None = None,
    methods: tuple[str, ...] = METHODS,
    finish: int = FINISH,
    sampling: Sampling | None = None,
    progress: Tell | None = None,
) -> Multistart:
    """Plan a task or a problem from many starts, and keep the plan of lowest cost.

    The first method takes all the starts under two regularisation schedules, as one batch; every further one
    goes on from the `finish` plans of lowest cost, and takes the first start under both schedules again. A
    plan's cost never rises on the way. Plans of high cost are left behind (successive halving, the rungs of
    `Workspace.run`): of all methods but the last half, three quarters and 85 % of them after 15, 40 and 80
    passes, of the last all but three after 20 passes and all but the best after 100.

    Where a task's disturbances have a delay that is a number, controls act that much later than they are sent
    (`Result.delay`): nothing acts before the first, and what is planned begins where that leads to.

    Args:
        task: what is planned.
        starts: how many of zeros (of servos the set-points that hold x0) and smoothed noise, to which
            `plan_starts` adds sampled and stabilised ones from four on; or the controls themselves as they
            act, (S, N, nu).
        seed: of noise and sampling.
        explore: standard deviation of the noise of narrow starts, and of what is sampled, a number or (nu,);
            others have 2.5 and 5 times as much. None: as of `sampling`, else a fifth of the limits, or 1.
        x0: the initial state (nx,); None: the first of the task's.
        sim: as of `problem_of`.
        options: of every method's solve but for the method, where all but the last make 150 passes at most;
            None: two schedules, and 400 passes of the last method.
        methods: of `Options.method`, one after the other.
        finish: how many plans every further method goes on from.
        sampling: how controls are sampled.
        progress: called after every pass with the method, its passes so far, how many plans go on and the
            lowest cost; where it returns True, the best plan so far is returned. Before the first one,
            controls are sampled and kernels compiled.

    Returns:
        The best plan, with the passes of all methods that led to it; `all` are the plans of the last method,
        `index` the best one's place among them; those that were left behind have the status MAX_ITERATIONS.
    """
    if isinstance(task, Problem):
        problem, delay = task, 0
        if x0 is None or sim is not None:
            raise ArgumentTypeError("a ddp.Problem is planned from an x0, and has its simulator in it")
    else:
        problem = problem_of(task, sim)
        delay = delay_of(task, problem)
        x0 = task.start[0] if x0 is None else x0
    late = Late.of(problem, delay)
    x = array("x0", x0, (problem.nx,))
    if isinstance(task, Task):
        _tell_of_limits(task.scene, x)
    if explore is not None:
        try:
            sampling = replace(sampling or Sampling(), scale=explore)
            sampling.deviations(problem.control_limits, problem.nu)
        except ArgumentError as error:
            raise ArgumentError(f"explore: {error}") from None
    return plan_late(late, x, starts, seed, options, methods, finish, sampling, progress)


def _tell_of_limits(scene: Scene, x0: np.ndarray) -> None:
    """A RuntimeWarning of coordinates that begin beyond their limits: a plan may live on how these throw them
    back.
    """
    s, numbers = scene.structure, scene.default_parameters()
    said = []
    for j, name in enumerate(scene.state_names[: scene.nv]):
        below = numbers["lower"][j] - x0[j] if s.lower[j] else 0.0
        above = x0[j] - numbers["upper"][j] if s.upper[j] else 0.0
        if max(below, above) > OVERLAP:
            side, bound = ("lower", "below") if below > above else ("upper", "above")
            said.append(f"{name} {max(below, above):.3g} {bound} its {side} limit")
    if said:
        warnings.warn(
            f"x0 has {', '.join(said)}: the first step throws that back, by that over its step size",
            RuntimeWarning,
            stacklevel=3,
        )


def plan_late(
    late: Late,
    x0: np.ndarray,
    starts: Any = 8,
    seed: int = 0,
    options: Options | None = None,
    methods: tuple[str, ...] = METHODS,
    finish: int = FINISH,
    sampling: Sampling | None = None,
    progress: Tell | None = None,
) -> Multistart:
    """`plan` of controls that may act later than they are sent, from x0 (nx,)."""
    function("progress", progress, 4, optional=True)
    began = late.begin(x0)
    if not isinstance(starts, int):
        starts = late.controls(starts)
    us = _controls(late.rest, began, starts, whole("seed", seed, 0), sampling, methods)
    return late.extended(solve_starts(late.rest, began, us, options, methods, finish, progress), x0)


def solve_starts(
    problem: Problem,
    x0: Any,
    us: np.ndarray,
    options: Options | None = None,
    methods: tuple[str, ...] = METHODS,
    finish: int = FINISH,
    progress: Tell | None = None,
) -> Multistart:
    """`plan` for a problem, from controls us (S, N, nu)."""
    instance("options", options, Options | None, "a ddp.Options")
    _check_methods(methods)
    finish = whole("finish", finish)
    x = array("x0", x0, (problem.nx,))
    schedules = (SCHEDULES if options is None else options.regularization).rows()
    first, before, ended = us[0], dict[int, Result](), False

    def tell(method: str, passes: int, going: int, cost: float) -> bool:
        nonlocal ended
        ended = progress is not None and progress(method, passes, going, cost) is True
        return ended

    for place, method in enumerate(methods):
        settings = Options(max_iterations=LAST_PASSES) if options is None else options
        if place + 1 < len(methods):
            settings = replace(settings, max_iterations=min(PASSES, settings.max_iterations))
        rows = np.repeat(np.arange(len(schedules)), len(us))
        batch = np.tile(us, (len(schedules), 1, 1))
        if place:  # the best plans under the first schedule, then the first start under all
            rows = np.concatenate([np.zeros(len(us), dtype=int), np.arange(len(schedules))])
            batch = np.concatenate([us, np.tile(first, (len(schedules), 1, 1))])
        settings = replace(settings, method=method, regularization=Regularization.of(schedules[rows]))
        rungs = LAST_RUNGS if place + 1 == len(methods) else _rungs(len(batch), finish)
        work = Workspace(problem, len(batch), settings)
        result = work.solve(x, batch, rungs=rungs, progress=progress and partial(tell, method))
        order = np.argsort(np.where(np.isnan(result.cost), np.inf, result.cost), kind="stable")
        last = ended or place + 1 == len(methods)
        if last and problem.state_limits is not None:  # what was left behind kept none
            beyond = work.beyond_limits()[order] > settings.limit_tolerance
            order = order[np.argsort(beyond, kind="stable")]
        us = result.us[order[:finish]]
        kept = {i: result.select(int(n)) for i, n in enumerate(order[: max(finish, 1)])}
        before = {i: each.after(before.get(int(order[i]))) for i, each in kept.items()}
        if last:
            break
    return Multistart(before[0], int(order[0]), result)


def _rungs(batch: int, finish: int) -> list[tuple[int, int]]:
    """Of a method that another one goes on from: at least one plan more than that one takes is kept."""
    return [(passes, max(finish + 1, round(np.ceil(share * batch)))) for passes, share in SHARES]


def _check_methods(methods: Any) -> None:
    if not isinstance(methods, tuple | list) or not methods:
        raise ArgumentError(f"methods is {methods!r:.60}; at least one of {', '.join(METHODS)} is needed")


def _controls(
    problem: Problem, x0: np.ndarray, starts: Any, seed: int, sampling: Sampling | None, methods: Any
) -> np.ndarray:
    """(S, N, nu) controls to start from, within the limits."""
    instance("sampling", sampling, Sampling | None, "a ddp.Sampling")
    _check_methods(methods)
    if isinstance(starts, int) and not isinstance(starts, bool):
        scale, count = None if sampling is None else sampling.scale, whole("starts", starts)
        compile_kernels(problem, methods, count)
        return plan_starts(problem, x0, count, seed, scale, sampling, methods[0])
    us = array("starts", starts, ("S", problem.horizon, problem.nu))
    if not len(us):
        raise ArgumentError(f"starts has shape {us.shape}; at least one start is needed")
    compile_kernels(problem, methods)
    lower, upper = problem.limit_rows()
    return np.clip(us, lower[0], upper[0])
