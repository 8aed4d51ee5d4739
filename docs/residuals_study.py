"""Numbers of residuals.md: minima of ERM from other starts, its distance from REM, time of a step, routes to
the hard solution (`python docs/residuals_study.py routes`: only these).
"""

import sys
import time

import numpy as np
from scipy.optimize import minimize

import slcp_warp as slcp

SIGMA, PROBLEMS, STARTS, WORLDS = 0.2, 12, 6, 4096


def minima(rng: np.random.Generator, n: int, rank: int) -> None:
    """Where BFGS from random starts ends, against `solve_complementarity`."""
    g = rng.normal(size=(PROBLEMS, n, rank))
    a = g @ g.swapaxes(1, 2)
    b = np.einsum("bij,bj->bi", a, rng.normal(size=(PROBLEMS, n)))
    b += 0.3 * np.abs(rng.normal(size=(PROBLEMS, n)))
    erm = slcp.solve_complementarity(a, b, SIGMA, "erm-normal")
    rem = slcp.solve_complementarity(a, b, SIGMA, "rem-normal")
    elsewhere, better = 0, 0
    for matrix, right, own in zip(a, b, erm.impulse, strict=True):

        def objective(lam: np.ndarray, matrix: np.ndarray = matrix, right: np.ndarray = right) -> float:
            w = matrix @ lam + right
            return slcp.residual("erm-normal", np.diag(matrix) * lam, w, SIGMA).sum()

        starts = [own + rng.normal(size=n) * (1.0 + np.abs(own)) for _ in range(STARTS)]
        ends = [minimize(objective, x, method="BFGS", options={"gtol": 1e-7}) for x in starts]
        elsewhere += any(np.abs(matrix @ (e.x - own)).max() > 1e-2 for e in ends)
        better += min(e.fun for e in ends) < objective(own) - 1e-7
    bias = np.abs(erm.w - rem.w).max(axis=1).mean() / SIGMA
    print(
        f"{n} rows, rank {rank}: elsewhere {elsewhere}, better {better} of {PROBLEMS}; bias {bias:.2f} sigma"
    )


def times(rng: np.random.Generator) -> None:
    """Process time of a float32 step of the finger near contact."""
    x = np.array([-1.2, -0.9, 0.4, 0, 0, 0]) + 0.5 * rng.standard_normal((WORLDS, 6))
    u = rng.standard_normal((WORLDS, 2))
    for name in slcp.options.CHOICES["residual"]:
        sim = slcp.Simulator(slcp.scenes.flicking_finger(), slcp.Options(residual=name), "cpu", "float32")
        step, best = sim.step(x, u), np.inf
        for _ in range(5):
            start = time.process_time()
            sim.step(x, u)
            best = min(best, time.process_time() - start)
        print(f"{name}: {best / WORLDS * 1e6:.2f} us, not solved {(step.status != 0).sum()}")


def routes(rng: np.random.Generator, n: int, rank: int, dtype: str) -> None:
    """Iterations and process time of the two methods for hard problems."""
    g = rng.normal(size=(WORLDS, n, rank))
    a = g @ g.swapaxes(1, 2)
    b = np.einsum("bij,bj->bi", a, rng.normal(size=(WORLDS, n))) + 0.3 * np.abs(rng.normal(size=(WORLDS, n)))
    for method in ("direct", "continuation"):
        given = {"residual": "hard", "method": method, "device": "cpu", "dtype": dtype}
        sol, best = slcp.solve_complementarity(a, b, **given), np.inf
        for _ in range(3):
            start = time.process_time()
            slcp.solve_complementarity(a, b, check=False, **given)
            best = min(best, time.process_time() - start)
        own = np.einsum("bii->bi", a) * sol.impulse
        w = np.einsum("bij,bj->bi", a, sol.impulse.astype(float)) + b
        error = np.abs(np.minimum(own, w)).max(axis=1) / np.abs(b).max(axis=1)
        print(
            f"{dtype} n {n}, rank {rank}, {method}: solved {(sol.status == 0).sum()} of {WORLDS}, iterations "
            f"{sol.iterations.mean():.1f} (most {sol.iterations.max()}), {best / WORLDS * 1e6:.1f} us, "
            f"residual/|b| {error[sol.status == 0].max():.0e}"
        )


if __name__ == "__main__":
    generator = np.random.default_rng(1)
    for size in ((1, 1), (4, 4), (4, 2), (8, 8), (8, 4), (12, 12), (12, 5)):
        for number in ("float64", "float32"):
            routes(np.random.default_rng(2), *size, number)
    if sys.argv[1:] != ["routes"]:
        for size in ((2, 1), (3, 1), (3, 2), (3, 3)):
            minima(generator, *size)
        times(np.random.default_rng(0))
