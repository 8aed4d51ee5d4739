"""Chart of study "many": what a step costs against the size of a pile and the batch, worst first."""

import math
from pathlib import Path
from typing import Any

from ....charts.style import BLACK, BLUE, GREEN, GREY, ORANGE, RED, SKY, plt, save
from .lines import Rows, choose, cost_ticks, different, need, points

COLOURS = {"hard": BLUE, "smoothed": GREEN, "coulomb": ORANGE}
SIZES = {
    "stack": "boxes in a stack",
    "heap": "discs in a heap",
    "discs": "discs wedged between walls",
    "beam": "supports of a beam",
}


def draw(rows: Rows, out: Path) -> Path:
    """A panel for every kind of pile and motion, and the batch: ours solid, float32 thin, MuJoCo dashed."""
    rows = [row for row in need(rows, "many") if row.get("cost_of") == "step"]
    problems = [p for p in different(rows, "problem") if len(different(choose(rows, problem=p), "value")) > 1]
    problems.sort(key=lambda p: worst(choose(rows, problem=p)))
    lines = -(-(len(problems) + 1) // 3)
    figure, grid = plt.subplots(lines, 3, figsize=(11.5, 3.3 * lines), layout="constrained", squeeze=False)
    axes = list(grid.flat)
    for ax, problem in zip(axes, problems):
        part = choose(rows, problem=problem)
        _panel(ax, part)
        ratio = worst(part)
        ax.set_title(problem, fontsize=10)
        ax.set_xlabel(f"{_along(part)}\nat worst {_times(ratio)} MuJoCo's time", fontsize=8.5)
        ax.set_ylabel("CPU time of a step of a world [µs]", fontsize=8.5)
    for ax in axes[len(problems) :]:
        ax.axis("off")
    handles = dict(
        pair for ax in axes[: len(problems)] for pair in zip(*reversed(ax.get_legend_handles_labels()))
    )
    axes[len(problems)].legend(handles.values(), handles.keys(), loc="center left", fontsize=8.5)
    figure.suptitle(
        "a step with many contacts, one thread: where we lose most first (crossed: worlds unsolved)",
        fontsize=11,
    )
    return save(figure, out)


def _along(rows: Rows) -> str:
    if rows[0]["knob"] == "batch":
        return "worlds in a call"
    return SIZES.get(str(rows[0]["scene"]).partition(":")[0], "bodies")


def worst(rows: Rows) -> float:
    """The least MuJoCo's time is of ours in float64."""
    found = [
        float(row["ratio"])
        for row in rows
        if row.get("ratio") not in (None, "") and row["dtype"] == "float64"
    ]
    return min(found, default=math.inf)


def _times(ratio: float) -> str:
    return f"{1.0 / ratio:.3g} times" if ratio < math.inf else "not beside"


def name(curve: str) -> str:
    """A curve as the legend has it: MuJoCo's boxes and spheres are its own shapes."""
    return curve.replace("boxes", "own shapes").replace("spheres", "own shapes")


def look(curve: str) -> dict[str, Any]:
    """Colour and line of a curve: ours by law, thin in float32; MuJoCo's models dashed."""
    if curve.startswith("MuJoCo"):
        return {"color": RED if "same pairs" in curve else GREY, "linestyle": "--", "marker": "s"}
    law, _, dtype = curve.partition(", ")
    thin = dtype == "float32"
    return {"color": COLOURS.get(law, SKY), "linestyle": ":" if thin else "-", "marker": "o",
            "linewidth": 1.0 if thin else 1.6}  # fmt: skip


def _panel(ax: Any, rows: Rows) -> None:
    for curve in different(rows, "curve"):
        part = [row | {"us": 1e6 * float(row["seconds"])} for row in choose(rows, curve=curve)]
        ax.loglog(
            *zip(*points(part, "value", "us")), markersize=3.5, label=name(str(curve)), **look(str(curve))
        )
        for row in part:
            if row.get("solved_share") not in (None, "") and float(row["solved_share"]) < 1.0:
                ax.plot(float(row["value"]), row["us"], "x", color=BLACK, markersize=6)
    if rows[0]["knob"] == "size":
        cost_ticks(ax)
