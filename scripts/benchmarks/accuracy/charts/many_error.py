"""Piles that move: error against cost, by hard contact's motion and own limit, and penetration."""

import math
from pathlib import Path

from ....charts.style import plt, save
from .contact import handles, look, panel
from .lines import Rows, choose, different, need
from .ratios import compare, figure

WIDE = 4
STILL = " rests"  # how the problems of what should not move end
MOVING = {"error": "error [m]", "error_self": "against own limit [m]", "penetration": "deepest [m]"}


def least(rows: Rows, y: str = "error") -> float:
    """The least of MuJoCo's cost over ours at equal error; 0 where we do not reach an error of its."""
    found = compare([row | {"error": row.get(y, "")} for row in rows])
    return min((c.worst[2] for c in found if c.equal_error and c.program == "MuJoCo"), default=math.inf)


def draw(rows: Rows, out: Path) -> Path:
    """What is thrown, falls and lands."""
    rows = [row for row in motions(rows) if not str(row["problem"]).endswith(STILL)]
    return panels(rows, MOVING, "piles that move: error against CPU time, where we lose most first", out)


def motions(rows: Rows) -> Rows:
    """The rows of the study with errors.

    Raises:
        ValueError: it has costs only.
    """
    found = [row for row in need(rows, "many") if row.get("cost_of") == "simulated second"]
    if not found:
        raise ValueError("study 'many' has costs only; the errors of its problems are not among the rows")
    return found


def panels(rows: Rows, kinds: dict[str, str], title: str, out: Path) -> Path:
    """A column for every problem, a row for every one of `kinds`, columns by column and its label."""
    problems = sorted(different(rows, "problem"), key=lambda p: least(choose(rows, problem=p)))
    if not problems:
        raise ValueError(f"study 'many' has no rows of {title.partition(':')[0]}")
    looks = look(rows)
    blocks = -(-len(problems) // WIDE)
    fig, grid = plt.subplots(len(kinds) * blocks, WIDE, figsize=(11.5, 2.3 * len(kinds) * blocks + 1.2),
                             layout="constrained", squeeze=False)  # fmt: skip
    for ax in grid.flat:
        ax.axis("off")
    for i, problem in enumerate(problems):
        part = choose(rows, problem=problem)
        for k, (y, text) in enumerate(kinds.items()):
            ax = grid[len(kinds) * (i // WIDE) + k, i % WIDE]
            ax.axis("on")
            panel(ax, part, looks, y=y)
            ax.set_ylabel(text, fontsize=8)
            ax.tick_params(labelsize=7)
            if y != "penetration":
                text = f"MuJoCo / ours at equal error: at least {figure(least(part, y), 2)}"
                ax.set_xlabel(text, fontsize=7, style="italic")
        grid[len(kinds) * (i // WIDE), i % WIDE].set_title(problem, fontsize=9)
    fig.legend(handles=handles(looks), loc="outside lower center", ncols=4, fontsize=7.5)
    fig.supxlabel("CPU time of a simulated second and world [µs]; steps of .05 to .001 s", fontsize=9)
    fig.suptitle(title, fontsize=11)
    return save(fig, out)
