"""`slcp bench differences`: exact derivatives against central differences over the named scenes."""

from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import StrategyError
from slcp_warp.options import OptionError

SHIFTS = {1: 0.75, 2: -0.15, 3: 1.0 / 60.0}  # sixth-order central difference
STEPS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)  # of the differences; the best one counts, state by state
RELATIVE = 1e-6
TOUCHING = (-1e-4, 1e-3)  # gaps [m, rad]
DEEPEST = -0.05  # of the states that penetrate [m, rad]
GAPS = (("penetrating", -np.inf, TOUCHING[0]), ("touching", *TOUCHING), ("separated", TOUCHING[1], np.inf))


def nearest_gap(sim: Any, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gap of the nearest row of each state (K,) [m, rad], and whether its step is solved."""
    here = sim.step(x, np.zeros((len(x), sim.nu)))
    return (here.gap.min(1) if sim.nr else np.full(len(x), np.inf)), here.status == 0


def candidates(sim: Any, rng: np.random.Generator) -> np.ndarray:
    """States (K, nx) of disturbed rollouts, their configurations moved by about 1 mm, 3 cm and .3."""
    worlds, steps, kept = 48, 120, 16
    x0 = sim.scene.x0 + 0.05 * rng.standard_normal((worlds, sim.nx))
    traj = sim.rollout(x0, rng.standard_normal((worlds, steps, sim.nu)))
    step = rng.integers(0, steps, (worlds, kept))
    x = traj.states[np.arange(worlds)[:, None], step].reshape(-1, sim.nx)
    copies = []
    for scale in (1e-3, 0.03, 0.3):
        moved = x.copy()
        moved[:, : sim.nx // 2] += scale * rng.standard_normal((len(x), sim.nx // 2))
        copies.append(moved)
    return np.concatenate(copies)


def between(sim: Any, apart: np.ndarray, into: np.ndarray) -> np.ndarray:
    """Touching states on the straight lines from separated to penetrating ones (K, nx), by bisection."""
    low, high = np.zeros(len(apart)), np.ones(len(apart))
    for _ in range(30):
        t = 0.5 * (low + high)
        gap, _ = nearest_gap(sim, apart + t[:, None] * (into - apart))
        low = np.where(gap > TOUCHING[0], t, low)  # a touching state is both ends
        high = np.where(gap <= TOUCHING[1], t, high)
    return apart + low[:, None] * (into - apart)


def states(sim: Any, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """States (count, nx), a third each penetrating, touching and separated (what a scene without rows lacks
    goes to the others), and controls (count, nu).
    """
    rng = np.random.default_rng(seed)
    x = candidates(sim, rng)
    gap, solved = nearest_gap(sim, x)
    into = x[solved & (gap <= TOUCHING[0]) & (gap > DEEPEST)]
    apart = x[solved & (gap > TOUCHING[1])]
    third = count // 3
    chosen = [into[rng.permutation(len(into))[:third]]]
    if len(into) and len(apart):
        ends = (part[rng.integers(0, len(part), third)] for part in (apart, into))
        chosen.append(between(sim, *ends))
    rest = count - sum(len(part) for part in chosen)
    chosen.append((apart if len(apart) else into)[-rest:])
    x = np.concatenate(chosen)
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
                                     strategy="specialised")  # fmt: skip
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
