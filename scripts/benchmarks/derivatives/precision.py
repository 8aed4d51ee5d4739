"""`slcp bench precision`: float32 derivatives beside those of float64 as sigma falls; NaN and Inf sought."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import slcp_warp as slcp

from ..shared.ours import PAPER
from .jacobians import states

SIGMAS = (0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
STEP_SIZE = 0.05
WITHIN = 1e-3
CHUNK = 1 << 16  # states a launch


def simulator(dtype: str, residual: str) -> slcp.Simulator:
    """The paper's finger, scaled as in the paper."""
    options = slcp.Options(residual=residual, scaling=PAPER.scaling)
    return slcp.Simulator(slcp.scenes.flicking_finger(), options, device="cpu", dtype=dtype)


def jacobian(sim: slcp.Simulator, x: np.ndarray, u: np.ndarray, params: Any = None) -> np.ndarray:
    """(A, B), (B, nx, nz) in float64; NaN where a step was not solved."""
    lin = sim.linearize(x, u, params)
    both = np.concatenate([lin.A, lin.B], 2).astype(float)
    both[lin.status != 0] = np.nan
    return both


def bench_precision(count: int, seed: int, say: Callable[[str], None]) -> list[dict[str, Any]]:
    """A row per sigma over states on the way of disturbed rollouts: (A, B) of float32 against float64's at
    the same rounded states, and what rounding the states alone changes in float64.
    """
    fine, coarse = (simulator(dtype, "rem-logistic") for dtype in ("float64", "float32"))
    x, u = states(fine, count, seed)
    x32, u32 = x.astype(np.float32), u.astype(np.float32)
    rows = []
    for sigma in SIGMAS:
        params = fine.params.replace(step_size=STEP_SIZE, sigma=sigma)
        exact = jacobian(fine, x, u, params)
        same = jacobian(fine, x32.astype(float), u32.astype(float), params)
        row: dict[str, Any] = {"sigma": sigma, "states": len(x)}
        for name, got, want in (
            ("float32", jacobian(coarse, x32, u32, params), same),
            ("rounded states", same, exact),
        ):
            error = np.abs(got - want).max((1, 2)) / np.abs(want).max((1, 2))
            error = error[np.isfinite(error)]
            row |= {
                f"{name}: median": float(np.median(error)),
                f"{name}: 99 %": float(np.percentile(error, 99)),
                f"{name}: largest": float(error.max()),
                f"{name}: within {WITHIN:g}": float((error <= WITHIN).mean()),
            }
        rows.append(row)
        say(", ".join(f"{k} {v:.3g}" for k, v in row.items()))
    return rows


def wild_states(sim: slcp.Simulator, count: int, seed: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """States and controls from everywhere, beyond limits and deep in contact too, a launch's at a time."""
    rng = np.random.default_rng(seed)
    for first in range(0, count, CHUNK):
        some = min(CHUNK, count - first)
        q = rng.uniform(-np.pi, np.pi, (some, sim.scene.nv))
        yield np.concatenate([q, 3.0 * rng.standard_normal(q.shape)], 1), rng.standard_normal((some, sim.nu))


def bench_finite(count: int, seed: int, say: Callable[[str], None]) -> list[dict[str, Any]]:
    """A row per precision and residual: solved states among random ones, and how many of those have a
    derivative that is no number.
    """
    rows = []
    for dtype in ("float32", "float64"):
        for residual in ("rem-logistic", "hard"):
            sim = simulator(dtype, residual)
            solved = broken = 0
            for x, u in wild_states(sim, count, seed):
                lin = sim.linearize(x.astype(dtype), u.astype(dtype))
                good = lin.status == 0
                solved += int(good.sum())
                finite = np.isfinite(lin.A).all((1, 2)) & np.isfinite(lin.B).all((1, 2))
                broken += int((good & ~finite).sum())
            row = {"dtype": dtype, "residual": residual, "random states": count, "solved": solved,
                   "solved, not finite": broken}  # fmt: skip
            rows.append(row)
            say(", ".join(f"{k} {v}" for k, v in row.items()))
    return rows
