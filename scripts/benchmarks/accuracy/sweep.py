"""Study "sweep": error of a sweep's statistics against the number of worlds, by precision, and its cost.

The finger tracks its plan from a kicked start. The worlds of one sweep are independent, so its blocks of N
worlds are as many sweeps of N: their rms distance from the truth is the error. Truth is the largest sweep, in
float64, with another seed; its own error is in the column `truth_error`.
"""

import functools
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ensembles.sweep import sweep_scene
from slcp_warp.kernels.device import launch

from ..shared.ours import PAPER
from ..shared.rows import Rows, Say, report, timed, timed_once
from ..shared.timing import Case

COUNTS = (64, 256, 1024, 4096, 16_384, 65_536)
TRUTH = 262_144
BLOCKS = 4  # of the largest number of worlds
DTYPES = ("float32", "float64")
HORIZON, KICK, FAST = 75, 1.0, 0.5  # steps; of the starts' velocities [rad/s]; a success turns faster [rad/s]
STATISTICS = {
    "success share": f"share of worlds that turn faster than {FAST:g} rad/s, rms",
    "mean rate": "mean rate of the ellipse [rad/s], rms",
}


@functools.cache
def controller() -> ddp.TrackingPolicy:
    """The finger's plan from the canonical start, u = 0, with its feedback."""
    sim = slcp.Simulator(slcp.scenes.flicking_finger(), PAPER, device="cpu", dtype="float64")
    problem = ddp.Problem(sim, slcp.tasks.flicking_finger().cost, horizon=HORIZON, params=sim.params)
    start = np.zeros((HORIZON, sim.nu))
    return ddp.TrackingPolicy(ddp.solve(problem, sim.scene.x0, start, ddp.Options(max_iterations=300)))


def kicked(worlds: int, seed: int = 0) -> slcp.SweepSpec:
    """The canonical start with normal velocities of deviation KICK."""
    return slcp.SweepSpec(worlds=worlds, duration=3.5, residuals=("rem-logistic",), step_sizes=(0.05,),
                          velocity_sd=KICK, observe=2, seed=seed)  # fmt: skip


def run_sweep(spec: slcp.SweepSpec, dtype: str, device: str = "cpu") -> slcp.SweepReport:
    """The sweep under `controller`, all threads."""
    scene = slcp.scenes.flicking_finger()
    return sweep_scene(scene, controller(), spec, scaling=PAPER.scaling, dtype=dtype, device=device)


def outcomes(done: slcp.SweepReport) -> dict[str, np.ndarray]:
    """Every statistic's contribution of each world (B,)."""
    rate = done.table["rate"].astype(float)
    return {"success share": (rate > FAST).astype(float), "mean rate": rate}


def block_error(values: np.ndarray, count: int, truth: float) -> float:
    """Rms distance from the truth of the means over blocks of `count` values."""
    blocks = len(values) // count
    means = values[: blocks * count].reshape(blocks, count).mean(axis=1)
    return float(np.sqrt(np.mean((means - truth) ** 2)))


def study(counts: tuple[int, ...], truth_worlds: int, repeats: int, dtypes: tuple[str, ...] = DTYPES) -> Rows:
    """Rows of both statistics and precisions over the numbers of worlds."""
    exact = outcomes(run_sweep(kicked(truth_worlds, seed=1), "float64"))
    kept: dict[str, dict[str, Any]] = {}
    for dtype in dtypes:
        done = run_sweep(kicked(BLOCKS * max(counts)), dtype)  # it compiles, too
        solved = float((done.table["status"] == slcp.Status.SOLVED).mean())
        kept[dtype] = {"dtype": dtype, "values": outcomes(done), "solved_share": solved}
    rows: Rows = []
    for count in counts:
        cases = [Case(dtype, functools.partial(run_sweep, kicked(count), dtype), 1,
                      facts={"worlds": count} | kept[dtype]) for dtype in dtypes]  # fmt: skip
        rows += timed(cases, repeats, None) if count < max(counts) else [timed_once(c) for c in cases]
    return [point(row, name, exact[name]) for name in STATISTICS for row in rows]


def point(row: dict[str, Any], statistic: str, exact: np.ndarray) -> dict[str, Any]:
    """The diagram's columns of one statistic at one number of worlds."""
    facts = {k: v for k, v in row.items() if k not in ("values", "worlds")}
    count, values = row["worlds"], row["values"][statistic]
    return {
        "study": "sweep", "problem": statistic, "program": "slcp-warp", "curve": row["dtype"],
        "knob": "worlds", "value": count, "batch": count, "h": 0.05, "residual": PAPER.residual,
        "scaling": PAPER.scaling, "device": "cpu", "threads": launch.thread_count(),
        "error": block_error(values, count, float(exact.mean())), "error_of": STATISTICS[statistic],
        "blocks": len(values) // count, "truth": float(exact.mean()),
        "truth_error": float(exact.std(ddof=1) / np.sqrt(len(exact))),
        "expected": float(exact.std(ddof=1) * np.sqrt(1.0 / count + 1.0 / len(exact))),
        "cost_of": "sweep", **facts,
    }  # fmt: skip


def rows(say: Say) -> Rows:
    """All of the study."""
    return report(say, study(COUNTS, TRUTH, 3), "problem", "curve", "value", "error", "expected", "seconds")
