"""The picture of `slcp paper mpc`: what a cycle costs against what it is worth."""

from pathlib import Path
from typing import Any

from ...charts.style import BLUE, ORANGE, RED, plt, save


def mpc_chart(path: Path, rows: list[dict[str, Any]]) -> Path:
    """Mean rate with its 95 % interval against CPU time a world and step; the library as a line."""
    figure, ax = plt.subplots(figsize=(10.0, 5.2), layout="constrained")
    base, points = rows[0], sorted(rows[1:], key=lambda row: row["ms a step"])
    ax.axhspan(base["low"], base["high"], color=ORANGE, alpha=0.25, linewidth=0)
    ax.axhline(base["rate"], color=ORANGE, label=f"library, {base['ms a step']:.2g} ms a step")
    for i, each in enumerate(points):
        sampled = "samples" in each["policy"]
        place, error = (each["ms a step"], each["rate"]), each["high"] - each["rate"]
        look: Any = {"fmt": "s", "color": RED} if sampled else {"fmt": "o", "color": BLUE}
        ax.errorbar(*place, error, **look, label=f"{i + 1}  {each['policy']}")
        ax.annotate(str(i + 1), place, xytext=(5, 3), textcoords="offset points", fontsize=9)
    ax.set_xscale("log")
    ax.set_xlabel("CPU time a world and step [ms]; real time: 50")
    ax.set_ylabel("mean rate of the ellipse [rad/s]")
    ax.set_title(f"{base['worlds']} kicked worlds, hard contact", loc="left")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
    return save(figure, path)
