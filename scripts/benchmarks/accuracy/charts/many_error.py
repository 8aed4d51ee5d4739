"""Error against cost of piles of bodies: positions, drift at rest and penetration, worst first."""

import math
from pathlib import Path

from ....charts.style import plt, save
from .contact import handles, look, panel
from .lines import Rows, choose, different, need
from .ratios import compare, figure

WIDE = 4
KINDS = {"error": "error [m]", "error_self": "error against own limit [m]", "penetration": "deepest [m]"}


def least(rows: Rows, y: str = "error") -> float:
    """The least of MuJoCo's cost over ours at equal error; 0 where we do not reach an error of its."""
    found = compare([row | {"error": row.get(y, "")} for row in rows])
    return min((c.worst[2] for c in found if c.equal_error and c.program == "MuJoCo"), default=math.inf)


def draw(rows: Rows, out: Path) -> Path:
    """Three rows of panels: error, error against each program's own limit, penetration."""
    rows = [row for row in need(rows, "many") if row.get("cost_of") == "simulated second"]
    problems = sorted(different(rows, "problem"), key=lambda p: least(choose(rows, problem=p)))
    if not problems:
        raise ValueError("study 'many' has costs only; the errors of its problems are not among the rows")
    looks = look(rows)
    blocks = -(-len(problems) // WIDE)
    fig, grid = plt.subplots(len(KINDS) * blocks, WIDE, figsize=(11.5, 2.3 * len(KINDS) * blocks + 0.8),
                             layout="constrained", squeeze=False)  # fmt: skip
    for ax in grid.flat:
        ax.axis("off")
    for i, problem in enumerate(problems):
        part = choose(rows, problem=problem)
        for k, (y, text) in enumerate(KINDS.items()):
            ax = grid[len(KINDS) * (i // WIDE) + k, i % WIDE]
            ax.axis("on")
            panel(ax, part, looks, y=y)
            ax.set_ylabel(text, fontsize=8)
            ax.tick_params(labelsize=7)
            if y != "penetration":
                ax.set_xlabel(
                    f"MuJoCo / ours at equal error: at least {figure(least(part, y), 2)}",
                    fontsize=7,
                    style="italic",
                )
        grid[len(KINDS) * (i // WIDE), i % WIDE].set_title(problem, fontsize=9)
    fig.legend(handles=handles(looks), loc="outside lower center", ncols=4, fontsize=7.5)
    fig.supxlabel("CPU time of a simulated second and world [µs]; steps of .05 to .001 s", fontsize=9)
    fig.suptitle(
        "piles of bodies: error against CPU time, lower left is better; where we lose most first", fontsize=11
    )
    return save(fig, out)
