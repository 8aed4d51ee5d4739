"""The picture of `slcp paper success`: both arms of every task, and the line that they are to reach."""

from pathlib import Path
from typing import Any

from ...charts.style import BLUE, GREY, ORANGE, plt, save

COLOURS = {"library": ORANGE, "mpc": BLUE}


def arms_chart(path: Path, rows: list[dict[str, Any]], wanted: float) -> Path:
    """Success with its 95 % interval in percent, a line of the picture for every task."""
    tasks = list(dict.fromkeys(row["task"] for row in rows))
    figure, ax = plt.subplots(figsize=(8.0, 0.8 + 0.5 * len(tasks)), layout="constrained")
    ax.axvline(100.0 * wanted, color=GREY, linestyle="--")
    for i, (arm, colour) in enumerate(COLOURS.items()):
        own = [row for row in rows if row["arm"] == arm]
        share, low, high = ([100.0 * row[name] for row in own] for name in ("success", "low", "high"))
        errors = [[s - b for s, b in zip(share, low)], [t - s for s, t in zip(share, high)]]
        place = [tasks.index(row["task"]) + 0.24 * (i - 0.5) for row in own]
        worlds = " to ".join(f"{n:,}" for n in sorted({row["worlds"] for row in own}))
        ax.errorbar(
            share, place, xerr=errors, fmt="o", capsize=3, color=colour, label=f"{arm}, {worlds} worlds"
        )
    ax.set_yticks(range(len(tasks)), tasks)
    ax.invert_yaxis()
    ax.set_xlabel("disturbed worlds that succeed under hard contact [%], 95 % intervals")
    figure.legend(loc="outside upper center", ncols=len(COLOURS))
    return save(figure, path)
