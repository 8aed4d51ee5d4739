"""A plan of a task in one call: many starts, Gauss-Newton from all of them, second order from the best."""

from dataclasses import replace
from typing import Any

import numpy as np

from slcp_warp import Simulator, Task
from slcp_warp.inputs.checks import array, instance, whole
from slcp_warp.inputs.errors import ArgumentError
from slcp_warp.inputs.limits import limit_rows

from .multistart import Multistart
from .options import Options
from .problem import Problem
from .workspace import Workspace

METHODS = ("gauss-newton", "second-order")
SHARE = 0.2  # of the limits: standard deviation of random starts
NOISE_TIME = 8.0  # correlation time of random starts [steps]
PASSES = 150
FINISH = 2  # plans that every further method goes on from


def problem_of(task: Task, sim: Simulator | None = None) -> Problem:
    """The problem of a task: its cost, horizon, control limits and state limits.

    Args:
        sim: a simulator of the task's scene; None: `task.simulator()`.
    """
    instance("task", task, Task, "a slcp_warp.Task")
    instance("sim", sim, Simulator | None, "a slcp_warp.Simulator")
    sim = task.simulator() if sim is None else sim
    limits = task.state_limit_rows()
    return Problem(sim, task.cost, task.horizon, None, task.control_limits, limits)


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
    lower, upper = limit_rows(task.control_limits, task.scene.nu)
    reach = np.maximum(np.abs(lower[0]), np.abs(upper[0]))
    return np.where(np.isfinite(reach), share * np.where(np.isfinite(reach), reach, 0.0), 1.0)


def plan(
    task: Task,
    starts: Any = 8,
    seed: int = 0,
    *,
    x0: Any = None,
    sim: Simulator | None = None,
    options: Options | None = None,
    methods: tuple[str, ...] = METHODS,
    finish: int = FINISH,
) -> Multistart:
    """Plan a task from many starts, and keep the plan of lowest cost.

    The first method takes all the starts as one batch; every further one goes on from the `finish` plans of
    lowest cost. A plan's cost never rises on the way.

    Args:
        task: what is planned.
        starts: how many, zero controls and smoothed noise (a fifth of the control limits; 1 where there are
            none); or the controls themselves, (S, N, nu).
        seed: of the noise.
        x0: the initial state (nx,); None: the first of the task's.
        sim: as of `problem_of`.
        options: of every method's solve; its method and regularisation schedule are those of `Options`
            otherwise, and passes 150.
        methods: of `Options.method`, one after the other.
        finish: how many plans every further method goes on from.

    Returns:
        The best plan; `all` are the plans of the last method, `index` the best one's place among them.
    """
    problem = problem_of(task, sim)
    us = _controls(problem, task, starts, whole("seed", seed, 0))
    return solve_starts(problem, task.start[0] if x0 is None else x0, us, options, methods, finish)


def solve_starts(
    problem: Problem,
    x0: Any,
    us: np.ndarray,
    options: Options | None = None,
    methods: tuple[str, ...] = METHODS,
    finish: int = FINISH,
) -> Multistart:
    """`plan` for a problem, from controls us (S, N, nu)."""
    instance("options", options, Options | None, "a ddp.Options")
    if not isinstance(methods, tuple | list) or not methods:
        raise ArgumentError(f"methods is {methods!r:.60}; at least one of {', '.join(METHODS)} is needed")
    settings = Options(max_iterations=PASSES) if options is None else options
    finish = whole("finish", finish)
    x = array("x0", x0, (problem.nx,))
    for place, method in enumerate(methods):
        result = Workspace(problem, len(us), replace(settings, method=method)).solve(x, us)
        order = np.argsort(np.where(np.isnan(result.cost), np.inf, result.cost), kind="stable")
        if place + 1 < len(methods):
            us = result.us[order[:finish]]
    index = int(order[0])
    return Multistart(result.select(index), index, result)


def _controls(problem: Problem, task: Task, starts: Any, seed: int) -> np.ndarray:
    """(S, N, nu) controls to start from, within the limits."""
    if isinstance(starts, int) and not isinstance(starts, bool):
        count = whole("starts", starts)
        us = random_starts(count, problem.horizon, problem.nu, noise_scale(task), seed)
    else:
        us = array("starts", starts, ("S", problem.horizon, problem.nu))
        if not len(us):
            raise ArgumentError(f"starts has shape {us.shape}; at least one start is needed")
    lower, upper = problem.limit_rows()
    return np.clip(us, lower[0], upper[0])
