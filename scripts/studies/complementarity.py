"""Plain complementarity problems: the numbers of docs/understand/residuals.md.

How often ERM misses its least minimum, its distance from REM, the time of a step, routes to the hard
solution. `python -m slcp_warp.scripts.studies.complementarity minima` (or `times`, `routes`): only these.
"""

import sys
import time
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import ndtr, spence

import slcp_warp as slcp
from slcp_warp.kernels.method import ERM

WORLDS = 4096
PROBLEMS, STARTS = 60, 24  # a group of ERM's, and of the searches in each
MISSED = (1e-3, 1e-6)  # more than the least objective by this part of it and of sigma^2


def expected_squares(lam: Any, a: Any, b: Any, d: Any, sigma: Any, name: str) -> tuple[float, np.ndarray]:
    """ERM's objective (15) and its gradient by lambda, in NumPy and SciPy."""
    own, w = d * lam, a @ lam + b
    t = (own - w) / sigma
    if name == "erm-normal":
        closed, density = ndtr(t), np.exp(-0.5 * t * t) / np.sqrt(2.0 * np.pi)
        value = own**2 * ndtr(-t) + (w * w + sigma**2) * closed - sigma * (own + w) * density
        mean = (own - w) * closed + sigma * density
    else:
        e = np.exp(-np.abs(t))
        closed, mean = np.where(t > 0.0, 1.0, e) / (1.0 + e), sigma * np.logaddexp(0.0, t)
        rest, tail = 2.0 * sigma**2 * spence(1.0 + e), 2.0 * own * sigma * np.log1p(e)
        value = np.where(t > 0.0, w * w + (np.pi * sigma) ** 2 / 3.0 + rest, own**2 - rest) - tail
    return value.sum(), d * 2.0 * own * (1.0 - closed) + a @ (2.0 * (own * closed - mean))


def least(rng: np.random.Generator, *problem: Any) -> float:
    """The least objective that SciPy's BFGS finds from random starts, half of them near A lambda = -b."""
    a, b, d, sigma, _name = problem
    starts = rng.normal(size=(STARTS, len(b))) * np.exp(rng.normal(size=(STARTS, 1)))
    starts *= (np.abs(b) + sigma) / (np.diag(a) + 0.05 * d)
    starts[::2] -= np.linalg.lstsq(a, b, rcond=1e-6)[0]
    ends = [minimize(expected_squares, x, problem, "BFGS", jac=True, options={"gtol": 1e-8}) for x in starts]
    return min(end.fun for end in ends)


def minima(rng: np.random.Generator, n: int, rank: int, scaling: str, name: str) -> tuple[int, int, int]:
    """Random problems, sigma .02 to .5: how many miss the least objective found, and more than 1 %, and how
    often the searches miss ours.
    """
    g = rng.normal(size=(PROBLEMS, n, rank))
    a = g @ g.swapaxes(1, 2)
    b = np.einsum("bij,bj->bi", a, rng.normal(size=(PROBLEMS, n)))
    b += 0.3 * np.abs(rng.normal(size=(PROBLEMS, n)))
    sigma = np.exp(rng.uniform(np.log(0.02), np.log(0.5), size=(PROBLEMS, 1))) * np.ones(n)
    erm = slcp.solve_complementarity(a, b, sigma, name, scaling)
    rem = slcp.solve_complementarity(a, b, sigma, name.replace("erm", "rem"), scaling)
    missed = np.zeros(3, dtype=int)
    for i in range(PROBLEMS):
        d = np.diag(a[i]) if scaling == "inertia" else np.ones(n)
        problem = (a[i], b[i], d, sigma[i], name)
        own, other = expected_squares(erm.impulse[i], *problem)[0], least(rng, *problem)
        slack = MISSED[0] * min(own, other) + MISSED[1] * sigma[i, 0] ** 2
        missed += [own > other + slack, own > 1.01 * other + slack, other > own + slack]
    bias = (np.abs(erm.w - rem.w) / sigma).max(axis=1).mean()
    print(
        f"{n} rows, rank {rank}, {scaling}, {name}: missed {missed[0]} (by 1 %: {missed[1]}) of {PROBLEMS}, "
        f"the searches {missed[2]}; not solved {(erm.status != 0).sum()}; w from REM's {bias:.2f} sigma",
        flush=True,
    )
    return tuple(missed)


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
        given: dict[str, Any] = {"residual": "hard", "method": method, "device": "cpu", "dtype": dtype}
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


def all_minima() -> None:
    """`minima` over 2 to 5 rows of every rank, with a sum for each residual and scaling."""
    for name in ERM:
        for scaling in ("inertia", "none"):
            total = np.zeros(3, dtype=int)
            count = 0
            for n in range(2, 6):
                for rank in range(1, n + 1):
                    seed = np.random.default_rng([n, rank, ERM.index(name), len(scaling)])
                    total += minima(seed, n, rank, scaling, name)
                    count += PROBLEMS
            print(f"{name}, {scaling}: missed {total[0]}, by 1 % {total[1]}, searches {total[2]}, of {count}")


if __name__ == "__main__":
    chosen = sys.argv[1:] or ["routes", "minima", "times"]
    if "routes" in chosen:
        for size in ((1, 1), (4, 4), (4, 2), (8, 8), (8, 4), (12, 12), (12, 5)):
            for number in ("float64", "float32"):
                routes(np.random.default_rng(2), *size, number)
    if "minima" in chosen:
        all_minima()
    if "times" in chosen:
        times(np.random.default_rng(0))
