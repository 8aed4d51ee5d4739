"""The finger's impact in large: error, and deepest penetration, against cost."""

from pathlib import Path

from ....charts.style import plt, save
from .contact import handles, look, panel
from .lines import Rows, choose, different, need

PROBLEM = "finger impact"


def draw(rows: Rows, out: Path) -> Path:
    """Two panels with one legend.

    Raises:
        ValueError: the contact study has no rows of this problem.
    """
    rows = need(rows, "contact")
    part = choose(rows, problem=PROBLEM)
    if not part:
        raise ValueError(f"there are no rows of {PROBLEM!r}; there are {different(rows, 'problem')}")
    everything = look(rows)
    looks = {name: everything[name] for name in different(part, "curve")}
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.6), layout="constrained")
    panel(left, part, looks, size=5)
    deep = [row | {"penetration_mm": 1e3 * float(row["penetration"])} for row in part]
    panel(right, deep, looks, y="penetration_mm", size=5)
    right.set_yscale("symlog", linthresh=1e-3)
    for ax in (left, right):
        ax.set_xlabel("CPU time of a simulated second and world [µs]")
    left.set(title="mean error against the exact motion at T = 2 s", ylabel="error [rad, rad/s]")
    right.set(title="deepest penetration", ylabel="[mm]")
    figure.legend(handles=handles(looks), loc="outside lower center", ncols=4, fontsize=8)
    figure.suptitle(
        "the finger strikes and pushes the ellipse, 32 starts; steps of .05 to .001 s", fontsize=11
    )
    return save(figure, out)
