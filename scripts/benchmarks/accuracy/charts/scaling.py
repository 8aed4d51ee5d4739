"""Charts of study "scaling": rates with their roofline, and the fraction of it that is reached."""

from pathlib import Path
from typing import Any

from ....charts.style import CASES, GREY, plt, save
from .lines import Rows, choose, curves, need, plot, points, titles

PANELS = (
    ("finger, steps", "steps against batch", "worlds in a call", "steps a second"),
    ("chain, steps by nv", "against size", "degrees of freedom, 4 rows of contact", "steps a second"),
    ("chain, steps by nr", "against contact", "rows of contact, 3 degrees of freedom", "steps a second"),
    ("finger, passes", "DDP against problems", "problems in a batch, N = 75", "passes a second"),
    ("finger, sweep", "worlds of a sweep", "worlds", "worlds a second"),
)  # fmt: skip


def draw(rows: Rows, out: Path) -> Path:
    """Six panels: five rates, each with its roofline dashed, and the best fraction of every curve."""
    rows = need(rows, "scaling")
    figure, grid = plt.subplots(2, 3, figsize=(13, 7.4), layout="constrained")
    axes = list(grid.flat)
    for ax, (problem, *_) in zip(axes, PANELS):
        _rates(ax, choose(rows, problem=problem))
    titles(axes, *(texts[1:] for texts in PANELS))
    lines = ahead(choose(rows, problem=PANELS[0][0]))
    if lines:
        axes[0].set_xlabel(f"{PANELS[0][2]}\n{lines}")
    _fractions(axes[-1], rows)
    figure.suptitle("how far the work scales, and the roofline of counted operations (dashed)", fontsize=12)
    return save(figure, out)


def ahead(rows: Rows) -> str:
    """Peers that make more steps than all of ours at a batch size; empty if there are none."""
    ours: dict[float, float] = {}
    for row in rows:
        if row["program"] == "slcp-warp":
            batch = float(row["value"])
            ours[batch] = max(ours.get(batch, 0.0), float(row["rate"]))
    peers = [row for row in rows if row["program"] != "slcp-warp" and float(row["value"]) in ours]
    faster = [row for row in peers if float(row["rate"]) > ours[float(row["value"])]]
    found = [f"{row['curve']} at {row['value']}" for row in faster]
    return f"ahead of ours: {', '.join(found)}" if found else ""


def _rates(ax: Any, rows: Rows) -> None:
    """Rates against the knob with the roofline of each curve; a row of zero contacts is drawn at a half."""
    for label, part, colour in curves(rows):
        shown = [row | {"value": max(float(row["value"]), 0.5)} for row in part]
        counted = [row for row in shown if row.get("roofline_seconds") not in (None, "")]  # ours
        shown_limits = [row | {"limit": 1.0 / float(row["roofline_seconds"])} for row in counted]
        style = "o-" if counted else "s:"
        plot(ax, points(shown, "value", "rate"), style, color=colour, label=label.removeprefix("finger, "))
        plot(ax, points(shown_limits, "value", "limit"), "--", color=colour, linewidth=0.9)
    ax.legend(fontsize=8)


def _fractions(ax: Any, rows: Rows) -> None:
    """A bar for every curve: the largest fraction of its roofline."""
    bars = []
    for i, (problem, *_) in enumerate(PANELS):
        for label, part, _ in curves(choose(rows, problem=problem)):
            text = label if label.startswith("finger") else f"{problem.split(',')[0]}, {label}"
            if problem.startswith("chain"):
                text += f", by {problem[-2:]}"
            if not any(row.get("fraction") for row in part):
                continue  # a peer's
            bars.append((text, max(float(row["fraction"]) for row in part), CASES[i % len(CASES)]))
    bars.reverse()
    ax.barh([b[0] for b in bars], [100.0 * b[1] for b in bars], color=[b[2] for b in bars], height=0.6)
    for i, (_, fraction, _) in enumerate(bars):
        ax.text(100.0 * fraction, i, f" {100.0 * fraction:.0f} %", va="center", fontsize=8, color=GREY)
    ax.set(title="best fraction of the roofline", xlabel="% of scalar peak (estimate)")
    ax.tick_params(axis="y", labelsize=7.5)
    ax.margins(x=0.12)
