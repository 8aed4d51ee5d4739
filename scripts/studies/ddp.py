"""`slcp study`: DDP on the flicking finger, as tables: tails, basins, methods, noise levels, no gravity."""

from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ddp.planning import random_starts

from ..support.options import Device, Seed
from ..support.screen import console, one_line_errors

HORIZON = 75
NOISE_LEVELS = (0.1, 0.07, 0.05, 0.035, 0.02, 0.01)
SHIFTS, OFFSET = 20, 4


@one_line_errors
def study_command(
    device: Device = None,
    seed: Seed = 0,
    starts: Annotated[int, typer.Option(min=1, help="Starts, times eight schedules.")] = 8,
) -> None:
    """Study DDP on the finger: tail, basins, methods, continuation, passes cold and warm, no gravity."""
    problem = _problem(slcp.scenes.flicking_finger(), device)
    scene = problem.dynamics.scene
    cold = _solve(problem, scene.x0, np.zeros((HORIZON, 2)))
    console.print(_tail(cold))
    console.print(_batch(problem, scene.x0, starts, seed))
    console.print(_methods(problem, scene.x0, cold))
    console.print(_continuation(problem, scene.x0, cold))
    console.print(_passes(problem, cold))
    console.print(_weightless(_problem(slcp.scenes.flicking_finger(gravity=0.0), device), seed))


def _problem(scene: slcp.Scene, device: str | None) -> ddp.Problem:
    sim = slcp.Simulator(scene, slcp.Options(scaling="none"), device=device)
    return ddp.Problem(sim, slcp.tasks.flicking_finger().cost, horizon=HORIZON)


def _solve(problem: ddp.Problem, x0: Any, us: Any, **options: Any) -> ddp.Result:
    return ddp.solve(problem, x0, us, ddp.Options(max_iterations=options.pop("passes", 300), **options))


def _table(title: str, rows: list[tuple[Any, ...]], *columns: str) -> Table:
    table = Table(title=title, title_justify="left")
    for column in columns:
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(*(f"{v:.6g}" if isinstance(v, float) else str(v) for v in row))
    return table


def _outcome(result: ddp.Result) -> tuple[Any, ...]:
    definite = "yes" if result.min_pivot > 0.0 else "no"
    return (
        float(result.cost),
        int(result.iterations),
        float(result.gradient),
        definite,
        ddp.Status(int(result.status)).name,
    )


def _tail(result: ddp.Result) -> Table:
    trace = result.trace
    last = [k for k in range(len(trace.cost)) if trace.reduction[k] > 0.0][-7:]
    rows = [(k, float(trace.cost[k]), float(trace.reduction[k]), float(trace.gradient[k])) for k in last]
    title = f"From u = 0: J = {float(result.cost):.6f} after {int(result.iterations)} passes; its last ones"
    return _table(title, rows, "pass", "cost", "reduction", "max |Q_u| before")


def _batch(problem: ddp.Problem, x0: np.ndarray, starts: int, seed: int) -> Table:
    us = random_starts(starts, HORIZON, 2, 1.0, seed)
    multi = ddp.solve_multistart(problem, x0, us, ddp.Options(max_iterations=300))
    costs = np.sort(multi.all.cost)
    rows = [("best", *_outcome(multi.best)), ("median", float(np.median(costs)), *[""] * 4)]
    converged = int(np.sum(multi.all.status == ddp.Status.CONVERGED))
    title = f"{len(costs)} starts and schedules, {converged} converged"
    return _table(title, rows, "", "cost", "passes", "max |Q_u|", "Q_uu > 0", "status")


def _methods(problem: ddp.Problem, x0: np.ndarray, solved: ddp.Result) -> Table:
    us = solved.us + 0.02 * np.random.default_rng(0).standard_normal(solved.us.shape)
    rows = [
        (method, *_outcome(_solve(problem, x0, us, method=method)))
        for method in ("second-order", "gauss-newton", "first-order")
    ]
    title = "From the solution with noise of .02 on its controls: one basin, 300 passes at most"
    return _table(title, rows, "method", "cost", "passes", "max |Q_u|", "Q_uu > 0", "status")


def _continuation(problem: ddp.Problem, x0: np.ndarray, cold: ddp.Result) -> Table:
    chain = ddp.solve_continuation(
        problem, x0, cold.us, NOISE_LEVELS, ddp.Options(max_iterations=300), xs0=cold.xs, K0=cold.K
    )
    rows = []
    for sigma, result in zip(NOISE_LEVELS, chain, strict=True):
        direct = _solve(problem.with_params(sigma=sigma), x0, np.zeros((HORIZON, 2)))
        rows.append((sigma, *_outcome(result), float(direct.cost), ddp.Status(int(direct.status)).name))
    columns = ("sigma", "cost", "passes", "max |Q_u|", "Q_uu > 0", "status", "from u = 0", "status")
    return _table("Continuation in sigma from the solution at .1, beside u = 0 directly", rows, *columns)


def _passes(problem: ddp.Problem, cold: ddp.Result) -> Table:
    """Passes of shifted problems to |Q_u| <= 1e-6 with the policy shifted by (19), with its feedback."""
    workspace = ddp.Workspace(problem, 1, ddp.Options(max_iterations=300))
    us, xs, K = cold.us, cold.xs, cold.K
    at = np.minimum(np.arange(HORIZON) + OFFSET, HORIZON - 1)
    counts = []
    for _ in range(SHIFTS):
        gains = K[at].copy()
        gains[HORIZON - OFFSET :] = 0.0
        states = np.concatenate([xs[OFFSET:], np.repeat(xs[-1:], OFFSET, axis=0)])
        result = workspace.solve(states[:1], us[at][None], states[None], gains[None]).select(0)
        us, xs, K = result.us, result.xs, result.K
        counts.append(int(result.iterations))
    rows = [
        ("from u = 0", int(cold.iterations), 60),
        (f"shifted by {OFFSET}, median of {SHIFTS}", float(np.median(counts)), 8),
    ]
    return _table(
        f"Passes to max |Q_u| <= 1e-6 (shifted: {min(counts)} to {max(counts)})",
        rows,
        "start",
        "passes",
        "the paper",
    )


def _weightless(problem: ddp.Problem, seed: int) -> Table:
    """Without gravity u = 0 never touches: noise, or a large sigma that is reduced, finds the contact."""
    x0, zero = problem.dynamics.scene.x0, np.zeros((HORIZON, 2))
    rows = [("u = 0", *_outcome(_solve(problem, x0, zero)))]
    noisy = ddp.solve_multistart(
        problem, x0, random_starts(8, HORIZON, 2, 1.0, seed), ddp.Options(max_iterations=300)
    )
    rows.append(("noise, best of 64", *_outcome(noisy.best)))
    levels = (3.0, 1.5, 0.8, 0.4, 0.2, 0.1)
    chain = ddp.solve_continuation(problem, x0, zero, levels, ddp.Options(max_iterations=300))
    rows.append((f"sigma from {levels[0]} to {levels[-1]}", *_outcome(chain[-1])))
    return _table(
        "No gravity (section VI)", rows, "start", "cost", "passes", "max |Q_u|", "Q_uu > 0", "status"
    )
