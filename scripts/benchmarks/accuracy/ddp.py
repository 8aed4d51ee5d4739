"""Study "ddp": cost above the basin's optimum after every pass of DDP against CPU time.

The finger, N = 75, by method and precision, from u = 0, and from controls NEAR an optimum (that of second-
order DDP from u = 0). Local minima are many and runs from u = 0 end in different ones; the optimum of a run's
basin is where second-order DDP in float64 converges from its end point. Time: passes times that of a pass.
"""

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp

from ..shared.ours import PAPER, cpu_threads
from ..shared.rows import Rows, Say, report, timed
from ..shared.timing import Case

HORIZON = 75
PASSES = {"second-order": 120, "gauss-newton": 300}
DTYPES = ("float64", "float32")
POLISH = ddp.Options(max_iterations=500, gradient_tolerance=1e-9)
NEAR = 0.02  # deviation of the controls [N m]


@dataclass(frozen=True)
class Run:
    """A solve: costs after 0, 1, .. passes, the end point's controls (N, nu), and its status' name."""

    cost: np.ndarray
    us: np.ndarray
    status: str


def problem(dtype: str, horizon: int = HORIZON) -> ddp.Problem:
    """The paper's problem from the canonical start."""
    sim = slcp.Simulator(slcp.scenes.flicking_finger(), PAPER, device="cpu", dtype=dtype)
    return ddp.Problem(sim, slcp.tasks.flicking_finger().cost, horizon=horizon, params=sim.params)


def solve(space: ddp.Workspace, us: np.ndarray) -> Run:
    """From controls (N, nu) with the workspace's options."""
    done = space.solve(space.problem.dynamics.scene.x0, us).select(0)
    after, reduction = (a[: done.iterations] for a in (done.trace.cost, done.trace.reduction))
    first = after[0] + reduction[0] if done.iterations else done.cost
    return Run(np.r_[first, after], done.us.astype(float), ddp.Status(int(done.status)).name)


@functools.cache
def polisher(horizon: int) -> ddp.Workspace:
    """Second-order DDP in float64, run to its end."""
    return ddp.Workspace(problem("float64", horizon), 1, POLISH)


def basin(us: np.ndarray) -> tuple[float, np.ndarray]:
    """The local minimum that second-order DDP finds from controls (N, nu): its cost and controls."""
    done = solve(polisher(len(us)), us)
    return float(done.cost[-1]), done.us


def starts(horizon: int) -> dict[str, np.ndarray]:
    """Controls (N, nu) to start from, by name."""
    zero = np.zeros((horizon, 2))
    _, best = basin(zero)
    near = best + NEAR * np.random.default_rng(0).standard_normal(best.shape)
    return {"from u = 0": zero, "from near an optimum": near}


def study(passes: dict[str, int], dtypes: tuple[str, ...], repeats: int, horizon: int = HORIZON) -> Rows:
    """A row for every pass of every start, method and precision, one thread."""
    cases, runs = [], []
    with cpu_threads(1):  # launches are prepared for as many
        for name, us in starts(horizon).items():
            for dtype in dtypes:
                for method, count in passes.items():
                    options = ddp.Options(max_iterations=count, method=method)
                    space = ddp.Workspace(problem(dtype, horizon), 1, options)
                    run = solve(space, us)
                    facts = {"problem": f"finger {name}", "curve": f"{method}, {dtype}", "method": method,
                             "dtype": dtype, "optimum": basin(run.us)[0]}  # fmt: skip
                    again = functools.partial(solve, space, us)
                    cases.append(
                        Case(f"{name} {method} {dtype}", again, max(len(run.cost) - 1, 1), facts=facts)
                    )
                    runs.append(run)
        costs = timed(cases, repeats)
    return [point(run, k, cost) for run, cost in zip(runs, costs) for k in range(len(run.cost))]


def point(run: Run, k: int, cost: dict[str, Any]) -> dict[str, Any]:
    """The columns after k passes."""
    seconds = {name: max(k, 0.5) * cost[name] for name in cost if name.startswith("seconds")}
    return cost | seconds | {
        "study": "ddp", "program": "slcp-warp", "knob": "passes", "value": k, "h": 0.05, "sigma": 0.1,
        "residual": PAPER.residual, "scaling": PAPER.scaling, "device": "cpu", "threads": 1, "batch": 1,
        "cost": float(run.cost[k]), "error": abs(float(run.cost[k]) - cost["optimum"]),
        "error_of": "cost above the basin's optimum (float32: its own cost, so its rounding too)",
        "status": run.status, "pass_seconds": cost["seconds"],
        "cost_of": "passes so far (the start: half a pass)",
    }  # fmt: skip


def rows(say: Say) -> Rows:
    """All of the study."""
    done = study(PASSES, DTYPES, 3)
    last = {(row["problem"], row["curve"]): row for row in done}
    shown = ("problem", "curve", "value", "status", "cost", "optimum", "error", "pass_seconds")
    report(say, list(last.values()), *shown)
    return done
