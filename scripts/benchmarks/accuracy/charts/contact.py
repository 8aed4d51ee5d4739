"""Work-precision diagrams of the contact study: a panel for every problem, ours solid, peers dashed."""

import textwrap
from pathlib import Path
from typing import Any

from matplotlib.lines import Line2D

from ....charts.style import BLACK, BLUE, GREEN, GREY, ORANGE, PINK, RED, SKY, plt, save
from .lines import Rows, choose, different, need
from .ratios import LEAST, OURS, compare, span

DEEP = 0.005  # penetration from which a point is drawn hollow [m]
COLUMNS = 4
OWN = (BLUE, SKY, GREEN, PINK, GREY, BLACK)  # curves in the order they come
PEERS = (RED, ORANGE, "#8C564B", "#7F6FB5")  # programs in the order they come
MARKERS = "o^sDvP"  # options of a peer in the order they come


def look(rows: Rows) -> dict[str, dict[str, Any]]:
    """Colour, marker and line of every curve: ours by curve, peers by program and marker."""
    found: dict[str, dict[str, Any]] = {}
    peers = [name for name in different(rows, "program") if name != OURS]
    options = list(dict.fromkeys(_option(row) for row in rows if row["program"] != OURS))
    for row in sorted(rows, key=lambda row: row["program"] != OURS):
        if row["curve"] in found:
            continue
        if row["program"] == OURS:
            colour = OWN[sum(f["linestyle"] == "-" for f in found.values()) % len(OWN)]
            found[row["curve"]] = {"color": colour, "marker": "o", "linestyle": "-", "linewidth": 1.5}
        else:
            colour = PEERS[peers.index(row["program"]) % len(PEERS)]
            marker = MARKERS[options.index(_option(row)) % len(MARKERS)]
            found[row["curve"]] = {"color": colour, "marker": marker, "linestyle": "--", "linewidth": 0.9}
    return found


def _option(row: dict[str, Any]) -> str:
    """The name of a peer's options: its curve without the program."""
    return str(row["curve"]).removeprefix(str(row["program"])).lstrip(", ")


def panel(ax: Any, rows: Rows, looks: dict[str, dict[str, Any]], x: str = "seconds", y: str = "error",
          scale: float = 1e6, size: float = 3.5) -> None:  # fmt: skip
    """Curves of one problem; hollow points penetrate deeply, crossed ones miss contacts."""
    for curve in different(rows, "curve"):
        part = sorted(choose(rows, curve=curve), key=lambda row: float(row["value"]))
        shown = [row for row in part if _finite(row.get(y, ""))]
        line = looks[curve]
        at = [(scale * float(row[x]), max(float(row[y]), LEAST)) for row in shown]
        ax.plot(
            *zip(*at), color=line["color"], linestyle=line["linestyle"], linewidth=line["linewidth"]
        ) if at else None
        for row, point in zip(shown, at):
            deep = float(row.get("penetration") or 0.0) > DEEP
            ax.plot(*point, line["marker"], color=line["color"], markersize=size, markeredgewidth=0.8,
                    markerfacecolor="white" if deep else line["color"])  # fmt: skip
            if float(row.get("missed") or 0) > 0:
                ax.plot(*point, "x", color=BLACK, markersize=size + 2.5, markeredgewidth=0.9)
    ax.set(xscale="log", yscale="log")


def _finite(value: Any) -> bool:
    return value not in ("", None) and float(value) < float("inf")


def handles(looks: dict[str, dict[str, Any]]) -> list[Line2D]:
    """A legend's entries: every curve, and what the marks mean."""
    labels = [f"{OURS}, {name}" if line["linestyle"] == "-" else name for name, line in looks.items()]
    lines = [Line2D([], [], markersize=4, label=label, **line) for label, line in zip(labels, looks.values())]
    marks = [
        Line2D([], [], linestyle="", marker="o", color=GREY, markerfacecolor="white", markersize=5,
               label=f"deeper than {1e3 * DEEP:g} mm"),
        Line2D([], [], linestyle="", marker="x", color=BLACK, markersize=6, label="passes through contacts"),
    ]  # fmt: skip
    return lines + marks


def caption(rows: Rows, program: str = "MuJoCo") -> str:
    """Of one problem: where a peer is ahead, else a program's cost over ours at equal error."""
    found = compare(rows)
    ahead = {c.curve: [error for error, _, ratio in c.equal_error if ratio < 1.0] for c in found}
    if any(ahead.values()):
        _, curve = min((min(errors), curve) for curve, errors in ahead.items() if errors)
        return f"{curve} ahead below {max(ahead[curve]):.0e}"
    ratios = [ratio for c in found if c.program == program for *_, ratio in c.equal_error]
    return f"{program}: {span(ratios)} times the CPU" if ratios else ""


def draw(rows: Rows, out: Path) -> Path:
    """Small panels of all problems, and the legend in the cells that are left."""
    rows = need(rows, "contact")
    problems, looks = different(rows, "problem"), look(rows)
    lines = -(-(len(problems) + 2) // COLUMNS)
    figure, grid = plt.subplots(lines, COLUMNS, figsize=(9.6, 2.35 * lines + 0.4), layout="constrained")
    axes = list(grid.flat)
    for ax, problem in zip(axes, problems):
        part = choose(rows, problem=problem)
        panel(ax, part, looks)
        ax.set_title(textwrap.fill(problem, 20), fontsize=9)
        ax.set_ylabel(f"error [{part[0]['error_of'].rpartition('[')[2]}", fontsize=8)
        ax.set_xlabel(caption(part), fontsize=7.5, style="italic")
        ax.tick_params(labelsize=7.5)
    for ax in axes[len(problems) :]:
        ax.axis("off")
    legend = axes[len(problems)].legend(
        handles=handles(looks), loc="center left", fontsize=7.2, ncols=2, columnspacing=1.0
    )
    legend.set_in_layout(False)
    figure.supxlabel("CPU time of a simulated second and world [µs]; steps of .05 to .001 s", fontsize=9)
    figure.suptitle("error against CPU time, lower left is better (in italics: at equal error)", fontsize=11)
    return save(figure, out)
