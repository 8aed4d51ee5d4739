"""`slcp bench differences`: exact derivatives against central differences over the named scenes."""

from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp.options import OptionError
from slcp_warp.strategy import StrategyError

SHIFTS = {1: 0.75, 2: -0.15, 3: 1.0 / 60.0}  # sixth-order central difference
STEPS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)  # of the differences; the best one counts, state by state
RELATIVE = 1e-6
GAPS = (("penetrating", -np.inf, -1e-4), ("touching", -1e-4, 1e-3), ("separated", 1e-3, np.inf))


def states(sim: Any, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """States (count, nx) on the way of disturbed rollouts, moved a little, and controls (count, nu)."""
    rng = np.random.default_rng(seed)
    worlds, steps = max(count // 8, 1), 60
    x0 = sim.scene.x0 + 0.05 * rng.standard_normal((worlds, sim.nx))
    us = rng.standard_normal((worlds, steps, sim.nu))
    traj = sim.rollout(x0, us)
    step = rng.integers(0, steps, (worlds, 8))
    x = traj.states[np.arange(worlds)[:, None], step].reshape(-1, sim.nx)[:count]
    x[:, : sim.nx // 2] += 1e-3 * rng.standard_normal((len(x), sim.nx // 2))
    return x, rng.standard_normal((len(x), sim.nu))


def errors(sim: Any, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Error of (A, B) relative to their largest entry, state by state, and the gap of the nearest row;
    NaN where a step was not solved.
    """
    lin = sim.linearize(x, u)
    exact = np.concatenate([lin.A, lin.B], 2)  # (B, nx, nz)
    here = sim.step(x, u)
    solved = (lin.status == 0) & (here.status == 0)
    best = np.full(len(x), np.inf)
    z = np.concatenate([x, u], 1)
    for step in STEPS:
        columns, good = [], solved.copy()
        for e in step * np.eye(z.shape[1]):
            total = np.zeros_like(x)
            for k, weight in SHIFTS.items():
                for sign in (-1, 1):
                    moved = z + sign * k * e
                    after = sim.step(moved[:, : sim.nx], moved[:, sim.nx :])
                    good &= after.status == 0
                    total += sign * weight * after.state
            columns.append(total / step)
        difference = np.abs(np.stack(columns, 2) - exact).max((1, 2))
        best = np.fmin(best, np.where(good, difference, np.inf))
    gap = here.gap.min(1) if sim.nr else np.full(len(x), np.inf)
    return np.where(solved, best / np.abs(exact).max((1, 2)), np.nan), gap


def bench_differences(
    names: tuple[str, ...], residuals: tuple[str, ...], count: int, seed: int, say: Any
) -> list[dict[str, Any]]:
    """A row per scene, residual and kind of state: how many, how far off."""
    rows = []
    for name in names:
        for residual in residuals:
            try:
                scene = slcp.scenes.NAMED[name]()
                sim = slcp.Simulator(scene, slcp.Options(residual=residual), device="cpu", dtype="float64",
                                     strategy="registers")  # fmt: skip
            except (OptionError, StrategyError) as why:
                say(f"{name}, {residual}: {why}")
                continue
            error, gap = errors(sim, *states(sim, count, seed))
            for kind, low, high in GAPS:
                chosen = (gap > low) & (gap <= high)
                found = error[chosen & np.isfinite(error)]
                if len(found):
                    rows.append({
                        "scene": name, "residual": residual, "state": kind, "states": len(found),
                        "median": float(np.median(found)), "largest": float(found.max()),
                        "within 1e-6": float((found <= RELATIVE).mean()),
                        "unsolved": int(np.isnan(error[chosen]).sum()),
                    })  # fmt: skip
                    say(", ".join(_text(k, v) for k, v in rows[-1].items()))
    return rows


def _text(name: str, value: Any) -> str:
    return f"{name} {value:.3g}" if isinstance(value, float) else str(value)
