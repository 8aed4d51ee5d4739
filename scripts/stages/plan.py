"""A plan of a task by DDP, from one start or many, at one or more noise levels."""

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.planning import Late, compile_kernels, plan_starts, solve_starts
from slcp_warp.results.simulated import Simulated
from slcp_warp.runs.stopping import Stop

from ..support.policies import of_python
from ..support.records import Record, device_facts, load_plan, read_kind
from ..support.rules import NO_RULE, OneRule
from ..support.simulators import make_params
from ..support.tasks import task_simulator
from .trajectory import simulate

HEAD, TAIL = 4, 14  # rows of a long trace that are printed


def task_problem(
    task: slcp.Task,
    horizon: int | None = None,
    sigma: float | None = None,
    step_size: float | None = None,
    settings: list[str] | None = None,
    rules: OneRule = NO_RULE,
    device: str | None = None,
    dtype: str = "float64",
) -> ddp.Problem:
    """The problem of a task with the options' numbers; None: the task's."""
    sim = task_simulator(task, rules, device, dtype)
    params = make_params(sim, step_size, sigma, settings)
    task = task if horizon is None else task.replace(horizon=horizon)
    return replace(ddp.problem_of(task, sim), params=params)


def shown_controls(late: Late, x0: np.ndarray, source: str, task: slcp.Task) -> np.ndarray:
    """Controls (1, N, nu), of what is left to plan, that a plan has or that a policy sends in the undisturbed
    task, within the limits.

    Args:
        source: a plan's file, or a policy as the commands name one.

    Raises:
        RecordError, ArgumentError: a plan of another scene, or of another number of steps.
        ValueError: a run of the policy that is not SOLVED.
    """
    sim, limits = late.whole.dynamics, late.whole.limit_rows()
    assert isinstance(sim, slcp.Simulator)
    if not of_python(source) and Path(source).exists() and read_kind(Path(source)) == "plan":
        found = load_plan(Path(source), sim.scene)["us"][None]
    else:
        run = simulate(sim, late.whole.params, x0[None], late.whole.horizon, source, ("controls",), task)
        if (code := int(run.recorded("status")[0])) != slcp.Status.SOLVED:
            raise ValueError(f"--from {source}: its run is {slcp.Status(code).name}, no start of a plan")
        found = run.recorded("controls")
    return np.clip(late.controls(found), *(side[0] for side in limits))


def first_controls(
    late: Late,
    x0: np.ndarray,
    count: int,
    seed: int,
    scale: Any,
    methods: tuple[str, ...],
    given: np.ndarray | None = None,
) -> np.ndarray:
    """Controls to plan from (S, N, nu): zeros, noise and what `ddp.plan` adds; given ones in place of zeros.

    What these and passes of the methods need is compiled together.
    """
    compile_kernels(late.rest, methods, count)
    guesses = plan_starts(late.rest, late.begin(x0), count, seed, scale, method=methods[0])
    return guesses if given is None else np.concatenate([given, guesses[1:]])


def optimise(
    late: Late,
    x0: np.ndarray,
    starts: np.ndarray,
    options: ddp.Options,
    schedules: bool = False,
    sigmas: np.ndarray | None = None,
    methods: tuple[str, ...] = (),
    tell: Callable[[str, int, int, float], bool | None] | None = None,
    stop: Stop | None = None,
) -> tuple[Record, list[ddp.Result]]:
    """Solve, and describe the outcome as a plan; the results are those of the noise levels, one or many.

    Args:
        late: the problem, with the delay of its controls.
        starts: controls (S, N, nu) of what is left to plan.
        schedules: try eight regularisation schedules for each of them.
        sigmas: noise levels of a continuation that begins at the best solution.
        methods: one after the other, as `ddp.plan` has them; none: that of the options.
        tell: `progress` of `ddp.plan`, where there are methods.
        stop: where it is wished for meanwhile, there is no continuation.
    """
    arrays: dict[str, np.ndarray] = {}
    header: dict[str, Any] = device_facts(late.whole.dynamics)
    problem, began = late.rest, late.begin(x0)
    if methods:
        many = solve_starts(problem, began, starts, options, methods, progress=tell)
        results = [many.best]
        arrays["batch_cost"] = late.extend(many.all, x0).trace.cost
        arrays["batch_status"] = many.all.status
        options = replace(options, method=methods[-1], regularization=ddp.Regularization())
        header["chosen"] = many.index
        header["batch_from"] = int(many.best.iterations - many.all.iterations[many.index])  # passes before
    elif len(starts) > 1 or schedules:
        rows = ddp.multistart.SCHEDULES if schedules else ddp.Regularization()
        many = ddp.solve_multistart(problem, began, starts, options, rows)
        results = [many.best]
        arrays["batch_cost"] = late.extend(many.all, x0).trace.cost
        arrays["batch_status"] = many.all.status
        header["chosen"] = many.index
    else:
        results = [ddp.solve(problem, began, starts[0], options)]
    sigmas = None if stop else sigmas
    falling = [] if sigmas is None else sigmas.tolist()
    levels = [Late.of(late.whole.with_params(sigma=each), late.delay) for each in falling]
    for level in levels:
        results.append(_follow(level, x0, results[-1], options))
    results = [each.extend(result, x0) for each, result in zip([late, *levels], results, strict=True)]
    first, simulated = (
        Simulated.of(late.whole.dynamics, each.whole.params) for each in (late, [late, *levels][-1])
    )
    sigma = first.header()["sigma"]  # None: hard contact, which has none
    noise = np.array([sigma, *falling], float)
    arrays |= results[-1].record().arrays
    for f in fields(ddp.Trace):
        arrays[f"trace_{f.name}"] = np.concatenate([_passes(r, f.name) for r in results])
    arrays["trace_level"] = np.repeat(np.arange(len(results)), [len(_passes(r, "cost")) for r in results])
    arrays["level_sigma"], arrays["level_cost"] = noise, np.array([float(r.cost) for r in results])
    header |= {
        "horizon": late.whole.horizon,
        "method": options.method,
        "sigma": sigma if sigmas is None else float(noise[-1]),
    }
    header |= results[-1].header
    return Record("plan", arrays, simulated, header), results


def _follow(level: Late, x0: np.ndarray, last: ddp.Result, options: ddp.Options) -> ddp.Result:
    """Solve at the next noise level, from the policy before."""
    start = {"xs0": last.xs, "K0": last.K}
    found: ddp.Result = ddp.solve(level.rest, level.begin(x0), last.us, options, **start)
    if np.isfinite(found.cost):
        return found
    return ddp.solve(level.rest, level.begin(x0), last.us, options)


def _passes(result: ddp.Result, name: str) -> np.ndarray:
    """A column of one result's trace, without the rows that were never written."""
    written = np.isfinite(result.trace.gradient)
    return np.asarray(getattr(result.trace, name))[written]


def trace_table(result: ddp.Result) -> Table:
    """The passes of one solve; the middle of a long trace is left out."""
    paid = "" if result.state_limits is None else "; cost: with what is paid for the limits of states"
    title = f"passes (ratio: actual to expected reduction; pivot: smallest of Q_uu{paid})"
    table = Table(title=title, box=SIMPLE_HEAD)
    columns: tuple[tuple[str, str, str], ...] = (
        ("cost", "cost", ".5f"), ("less", "reduction", ".2e"), ("ratio", "reduction_ratio", ".2f"),
        ("alpha", "step_size", ".3g"), ("mu", "regularization", ".1e"), ("max |Q_u|", "gradient", ".1e"),
        ("pivot", "min_pivot", ".3g"),
    )  # fmt: skip
    table.add_column("pass", justify="right")
    for heading, _, _ in columns:
        table.add_column(heading, justify="right")
    values = {name: _passes(result, name) for _, name, _ in columns}
    count = len(values["cost"])
    for k in range(count):
        if HEAD <= k < count - TAIL:
            if k == HEAD:
                table.add_row(*(["..."] * (len(columns) + 1)))
            continue
        cells = (values[name][k] for _, name, _ in columns)
        table.add_row(str(k), *("" if np.isnan(v) else format(v, f) for v, (_, _, f) in zip(cells, columns)))
    return table


def outcome_table(record: Record, results: list[ddp.Result]) -> Table:
    """One row per noise level."""
    table = Table(title="result", box=SIMPLE_HEAD)
    for heading in ("sigma", "cost", "passes", "max |Q_u|", "Q_uu > 0", "status"):
        table.add_column(heading, justify="right")
    for sigma, result in zip(record["level_sigma"], results):
        row: tuple[Any, ...] = (
            "" if np.isnan(sigma) else f"{sigma:g}",
            f"{float(result.cost):.4f}",
            int(result.iterations),
        )
        good = "yes" if result.positive_definite else "no"
        meaning = ddp.Status(int(result.status)).explanation
        table.add_row(*map(str, row), f"{float(result.gradient):.1e}", good, meaning)
    return table
