"""Charts of study "sweep": the error of its statistics against worlds and against time."""

from pathlib import Path
from typing import Any

from ....charts.style import GREY, plt, save
from .lines import Rows, choose, curves, different, need, plot, points


def draw(rows: Rows, out: Path) -> Path:
    """A row of panels for each statistic: error over worlds with the expected 1/sqrt(N), and over time."""
    rows = need(rows, "sweep")
    statistics = different(rows, "problem")
    figure, grid = plt.subplots(len(statistics), 2, figsize=(10, 3.7 * len(statistics)), squeeze=False,
                                layout="constrained")  # fmt: skip
    for (left, right), name in zip(grid, statistics):
        chosen = choose(rows, problem=name)
        expected = points(choose(chosen, curve=chosen[0]["curve"]), "value", "expected")
        plot(left, expected, "--", color=GREY, label="expected: sampling, of the truth too")
        for i, (label, part, colour) in enumerate(curves(chosen)):
            size: dict[str, Any] = {
                "markersize": 9 - 5 * i,
                "linewidth": 3.2 - 1.8 * i,
            }  # they lie on each other
            plot(left, points(part, "value", "error"), color=colour, label=label, **size)
            plot(right, points(part, "seconds", "error"), color=colour, label=label)
        what = chosen[0]["error_of"].removesuffix(", rms")
        left.set(title=f"{name}: error against worlds", xlabel="worlds N", ylabel=f"rms error\n{what}")
        right.set(
            title=f"{name}: error against time", xlabel="wall time of the sweep [s]", ylabel="rms error"
        )
        left.legend(fontsize=8)
        right.legend(fontsize=8)
    figure.suptitle("a sweep's statistics: sampling decides, precision does not", fontsize=12)
    return save(figure, out)
