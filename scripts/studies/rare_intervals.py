"""How often the interval of multilevel splitting holds a probability that a formula gives.

    python -m slcp_warp.scripts.studies.rare_intervals [REPETITIONS]

Five sets of standard normal vectors with known probabilities: a half-space in 10 and in 100 dimensions, two
half-spaces apart, the outside of a ball, and a half-space whose margin falls in steps; for several lengths of
chains, with as many particles.
"""

import math
import sys
import time
from collections.abc import Callable

import numpy as np

from slcp_warp.ensembles.questions.rare.interval import island_interval
from slcp_warp.ensembles.questions.rare.splitting import Effort, Moves, Score, pilot, run_islands

ISLANDS, PARTICLES = 20, 500
LENGTHS = (5, 10, 20)


def upper(beta: float) -> float:
    """Probability that a standard normal number exceeds beta."""
    return 0.5 * math.erfc(beta / math.sqrt(2.0))


def halfspace(beta: float) -> Callable[[np.ndarray], np.ndarray]:
    """Falls evenly along the diagonal."""
    return lambda z: np.asarray(beta - z.sum(axis=1) / math.sqrt(z.shape[1]))


def stairs(z: np.ndarray) -> np.ndarray:
    """Falls in steps of a quarter."""
    s = 3.719 - z[:, 0]
    return np.where(s <= 0.0, s, np.ceil(4.0 * s) / 4.0)


CASES: dict[str, tuple[Score, int, float]] = {
    "half-space, 10 numbers": (halfspace(4.265), 10, upper(4.265)),
    "half-space, 100 numbers": (halfspace(3.719), 100, upper(3.719)),
    "two half-spaces": (lambda z: 3.9 - np.abs(z[:, 0]), 20, 2.0 * upper(3.9)),
    "outside of a disc": (lambda z: 5.0 - np.hypot(z[:, 0], z[:, 1]), 2, math.exp(-12.5)),
    "steps": (stairs, 6, upper(3.719)),
}


def trial(score: Score, width: int, length: int, seed: int) -> tuple[float, float, float]:
    """An estimate with its interval."""
    rng, effort, moves = np.random.default_rng(seed), Effort(PARTICLES, length), Moves(width)
    levels = pilot(score, moves, effort, 4 * PARTICLES, rng)
    return island_interval(run_islands(score, levels, moves, effort, ISLANDS, rng).shares)


def main() -> None:
    """Print a row for every set and length."""
    repetitions = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    print(f"{'set':26s} {'p':>8s} {'length':>6s} {'held':>6s} {'mean / p':>8s} {'sd / p':>6s} {'s':>5s}")
    for name, (score, width, truth) in CASES.items():
        for length in LENGTHS:
            began = time.process_time()
            found = np.array([trial(score, width, length, seed) for seed in range(repetitions)])
            held = int(((found[:, 1] <= truth) & (truth <= found[:, 2])).sum())
            spread = found[:, 0].std() / truth
            seconds = (time.process_time() - began) / repetitions
            print(f"{name:26s} {truth:8.2g} {length:6d} {held:3d}/{repetitions:<3d} "
                  f"{found[:, 0].mean() / truth:8.3f} {spread:6.3f} {seconds:5.2f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
