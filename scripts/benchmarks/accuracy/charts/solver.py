"""Chart of study "solver": error of v' against the cost of a step, by tolerance, precision and strategy."""

from pathlib import Path
from typing import Any

from ....charts.style import GREY, plt, save
from .lines import Rows, choose, cost_ticks, curves, different, need


def draw(rows: Rows, out: Path) -> Path:
    """A row of panels for each scene, one for each noise level; whiskers reach up to nine states in ten."""
    rows = need(rows, "solver")
    problems, sigmas = different(rows, "problem"), different(rows, "sigma")
    figure, grid = plt.subplots(len(problems), len(sigmas), figsize=(4.2 * len(sigmas), 3.7 * len(problems)),
                                squeeze=False, sharey=True, layout="constrained")  # fmt: skip
    for line, problem in zip(grid, problems):
        for ax, sigma in zip(line, sigmas):
            _panel(ax, choose(rows, problem=problem, sigma=sigma), rows)
            ax.set(title=f"{problem}, σ = {float(sigma):g}", xlabel="CPU time of a step [µs]")
        line[0].set_ylabel("error of v′, relative to 1 + |v′|")
    grid[0][0].legend(fontsize=8, loc="upper right")
    figure.suptitle("the smoothed step: what a finer solution costs (numbers: tolerance)", fontsize=12)
    return save(figure, out)


def _panel(ax: Any, rows: Rows, everything: Rows) -> None:
    for label, part, colour in curves(rows, of=everything):
        part = sorted(part, key=lambda row: -float(row["value"]))
        x = [1e6 * float(row["seconds"]) for row in part]
        y = [float(row["error"]) for row in part]
        upper = [float(row["error_p90"]) - float(row["error"]) for row in part]
        ax.errorbar(x, y, [[0.0] * len(y), upper], fmt="o-", color=colour, label=label, markersize=5,
                    elinewidth=0.8)  # fmt: skip
        for row, a, b in zip(part, x, y):
            if row["tolerance"] != "rounding" and row["dtype"] == "float64":
                ax.annotate(f"{float(row['tolerance']):g}", (a, b), xytext=(5, 3), textcoords="offset points",
                            fontsize=7, color=GREY)  # fmt: skip
    ax.set(xscale="log", yscale="log")
    cost_ticks(ax)
