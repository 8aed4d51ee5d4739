"""A library of local controllers by receding horizon (section IV.C)."""

from collections.abc import Callable

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

import slcp_warp as slcp
from slcp_warp import ddp

from ..support.simulators import OBSERVED


class Interrupted(Exception):
    """Ctrl-C came while a library was built; `library` is what there was."""

    def __init__(self, library: ddp.Library) -> None:
        super().__init__("interrupted")
        self.library = library


def build(
    problem: ddp.Problem,
    x0: np.ndarray,
    plans: int,
    options: ddp.RecedingOptions,
    rounds: int = 5,
    progress: Callable[[int, int], None] | None = None,
) -> ddp.Library:
    """A library of `plans` plans with `options.entries` controllers of each.

    Args:
        rounds: how often new chains start where the controller gets nowhere (see `ddp.build_refined`); the
            test rollouts are in single precision.

    Raises:
        Interrupted: by Ctrl-C, with what there was.
    """
    if plans < 1:
        raise ValueError(f"--plans is {plans}; it must be at least 1")
    count = plans * options.entries
    sim = problem.dynamics
    trial = slcp.Simulator(sim.scene, sim.options, device=sim.device, dtype="float32")
    score = ddp.turning(OBSERVED[sim.scene.name])
    library = ddp.build_refined(problem, x0, count, score, rounds, options, trial, progress)
    if len(library) < count:
        raise Interrupted(library)
    return library


def library_table(library: ddp.Library) -> Table:
    """Size, and how much the plans gain over zero controls."""
    table = Table(title="library", box=SIMPLE_HEAD)
    for heading in ("controllers", "plans", "chains", "gain 10 %", "median", "90 %", "turned, rad"):
        table.add_column(heading, justify="right")
    first = library.age == 0
    low, middle, high = np.quantile(library.gain[first], (0.1, 0.5, 0.9))
    turned = [np.ptp(library.x[library.chain == c, 2]) for c in np.unique(library.chain)]
    table.add_row(
        *map(str, (len(library), int(first.sum()), len(turned))),
        *(f"{g:.1f}" for g in (low, middle, high)), f"{sum(turned):.1f}",
    )  # fmt: skip
    return table
