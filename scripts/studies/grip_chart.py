"""The picture of `slcp grip`: what each noise level makes of the cost, and which grips hold."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..charts.style import BLACK, BLUE, CASES, plt, save


def grip_chart(
    path: Path,
    edge: float,
    sigmas: list[float],
    forces: list[float],
    shares: list[float],
    grid: np.ndarray,
    curve: np.ndarray,
    cost: Callable[[Any, float], Any],
) -> Path:
    """Left: a step's cost against the grip [N], per sigma, with DDP's optima. Right: share of worlds that
    hold (len(grid), 3: share and interval), with the same optima.
    """
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.0), layout="constrained")
    fine = edge * (1.0 + np.geomspace(1e-5, 1.4, 800))
    for sigma, force, share, colour in zip(sigmas, forces, shares, CASES * 2):
        left.plot(fine, cost(fine, sigma), color=colour, label=f"σ = {sigma:g} m/s")
        left.plot(force, cost(force, sigma), "o", color=colour)
        right.plot(force, 100.0 * share, "o", color=colour, zorder=3, label=f"optimum at σ = {sigma:g} m/s")
    right.fill_between(grid, *(100.0 * curve[:, 1:].T), color=BLUE, alpha=0.2, linewidth=0)
    right.plot(grid, 100.0 * curve[:, 0], color=BLACK, lw=1.2, label="any constant grip")
    for ax in (left, right):
        ax.axvline(edge, color=BLACK, lw=1.0, ls="--")
        ax.set_xlabel("grip of either finger [N]")
        ax.set_xlim(0.78 * edge, 2.42 * edge)
    right.annotate("edge of the\nfriction cone", (edge, 0.93), xycoords=("data", "axes fraction"), va="top",
                   xytext=(4, 0), textcoords="offset points", fontsize=9)  # fmt: skip
    left.set_ylim(0.0, 0.8)
    left.set_ylabel("effort + slip, cost of a step")
    left.set_title("the optimiser's model; ● optima that DDP found", loc="left")
    left.legend(loc="lower right")
    right.set_ylim(-2.0, 102.0)
    right.set_ylabel("worlds in which the object is held [%]")
    right.set_title("hard worlds, friction and mass unknown", loc="left")
    right.legend(loc="lower right")
    return save(figure, path)
