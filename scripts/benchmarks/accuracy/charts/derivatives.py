"""Chart of study "derivatives": error of A, B against the spacing of differences, and against cost."""

from pathlib import Path
from typing import Any

from ....charts.style import plt, save
from .lines import Rows, choose, curves, different, need, plot, points


def draw(rows: Rows, out: Path) -> Path:
    """A column for each kind of state: above over the spacing at the largest sigma, below over the cost."""
    rows = need(rows, "derivatives")
    kinds = different(rows, "problem")
    sigma = max(float(row["sigma"]) for row in rows if row.get("sigma"))
    figure, grid = plt.subplots(2, len(kinds), figsize=(4.5 * len(kinds), 8), sharey=True, squeeze=False,
                                layout="constrained")  # fmt: skip
    for i, kind in enumerate(kinds):
        part = [r for r in choose(rows, problem=kind) if not r.get("sigma") or float(r["sigma"]) == sigma]
        _spacing(grid[0][i], part, rows)
        _cost(grid[1][i], part + [r for r in choose(rows, problem=kind, knob="sigma") if r not in part], rows)
        grid[0][i].set(title=f"{kind}, σ = {sigma:g}", xlabel="spacing of the differences")
        grid[1][i].set(title=f"{kind}: a point for every spacing", xlabel="CPU time of a Jacobian [µs]")
    for line in grid:
        line[0].set_ylabel("error of A, B, relative to the largest entry")
    figure.legend(*grid[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8)
    figure.suptitle("Jacobians of a step against the converged derivative of the same model", fontsize=12)
    return save(figure, out)


def _style(row: dict[str, Any]) -> str:
    return "--" if row["program"] != "slcp-warp" else "-"


def _spacing(ax: Any, rows: Rows, everything: Rows) -> None:
    """Differences over their spacing; what is exact as a level line."""
    for label, part, colour in curves(rows, of=everything):
        if part[0]["knob"] == "eps":
            plot(ax, points(part, "value", "error"), f"o{_style(part[0])}", color=colour, label=label,
                 linewidth=1.2)  # fmt: skip
        else:
            ours = _style(part[0]) == "-"
            ax.axhline(float(part[0]["error"]), color=colour, label=label, linewidth=2.4 if ours else 1.2,
                       linestyle=_style(part[0]))  # fmt: skip


def _cost(ax: Any, rows: Rows, everything: Rows) -> None:
    """A point for every row; exact ones large."""
    for label, part, colour in curves(rows, of=everything):
        exact = part[0]["knob"] == "sigma"
        shown = [row | {"us": 1e6 * float(row["seconds"])} for row in part]
        mark = "*" if exact else "x" if _style(part[0]) == "--" else "o"
        plot(ax, points(shown, "us", "error"), mark, color=colour, label=label,
             markersize=11 if exact else 4)  # fmt: skip
