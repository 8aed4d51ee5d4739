"""Piles that move: error against cost, by hard contact's motion and own limit, and penetration."""

import math
from pathlib import Path

from ....charts.style import plt, save
from .contact import handles, look, panel
from .lines import Rows, choose, different, need
from .ratios import compare, span

WIDE = 4
MOST = 10.0  # [m], beyond which points are off the chart
STILL = " rests"  # how the problems of what should not move end
MOVING = {"error": "error [m]", "error_self": "against own limit [m]", "penetration": "deepest [m]"}


def quotients(rows: Rows, y: str = "error") -> list[float]:
    """MuJoCo's cost over ours at every error that a curve of its has no cheaper; 0: we do not reach it."""
    found = compare([row | {"error": row.get(y, "")} for row in rows])
    return [ratio for c in found if c.program == "MuJoCo" for *_, ratio in c.equal_error]


def least(rows: Rows) -> float:
    """The least of them that is not 0: where we lose most."""
    return min((ratio for ratio in quotients(rows) if ratio > 0.0), default=math.inf)


def said(rows: Rows, y: str) -> str:
    """From which to which they go, and how many errors we do not reach."""
    found = quotients(rows, y)
    missed = sum(ratio == 0.0 for ratio in found)
    text = span(sorted(ratio for ratio in found if ratio > 0.0))
    return text + (f", {missed} of {len(found)} not reached" if missed else "")


def draw(rows: Rows, out: Path) -> Path:
    """What is thrown, falls and lands."""
    rows = [row for row in motions(rows) if not str(row["problem"]).endswith(STILL)]
    return panels(rows, MOVING, "piles that move, where we lose most first: error", out)


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
        raise ValueError(f"study 'many' has no rows of {title.partition(',')[0]}")
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
            ax.set_ylim(top=min(ax.get_ylim()[1], MOST))
            ax.set_ylabel(text, fontsize=8)
            ax.tick_params(labelsize=7)
            if y != "penetration":
                ax.set_xlabel(f"MuJoCo / ours: {said(part, y)}", fontsize=7, style="italic")
        grid[len(kinds) * (i // WIDE), i % WIDE].set_title(problem, fontsize=9)
    fig.legend(handles=handles(looks), loc="outside lower center", ncols=4, fontsize=7.5)
    axes = "against CPU time of a simulated second and world [µs] (in italics: at equal error; "
    axes += f"off the chart above {MOST:g} m)"
    fig.suptitle(f"{title}\n{axes}", fontsize=11)
    return save(fig, out)
