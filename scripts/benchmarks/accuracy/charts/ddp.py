"""Chart of study "ddp": cost above the basin's optimum against passes and against CPU time."""

from pathlib import Path

from ....charts.style import plt, save
from .lines import Rows, choose, curves, different, need, plot, points


def draw(rows: Rows, out: Path) -> Path:
    """A row of panels for each start: left over passes, right over CPU time."""
    rows = need(rows, "ddp")
    problems = different(rows, "problem")
    figure, grid = plt.subplots(len(problems), 2, figsize=(11, 4.2 * len(problems)), sharey="row",
                                squeeze=False, layout="constrained")  # fmt: skip
    for (left, right), problem in zip(grid, problems):
        for label, part, colour in curves(choose(rows, problem=problem), of=rows):
            style = "-" if part[0]["dtype"] == "float64" else "--"
            name = f"{label}, J* = {float(part[-1]['optimum']):.3f}"
            passes = [row | {"at": max(float(row["value"]), 0.5)} for row in part]
            options = {"color": colour, "label": name}
            plot(left, points(passes, "at", "error"), style, **options)
            plot(right, points(part, "seconds", "error"), style, **options)
        left.set(title=f"{problem}: over passes", xlabel="passes (the start at a half)",
                 ylabel="cost above the basin's optimum J*")  # fmt: skip
        right.set(title=f"{problem}: over time", xlabel="CPU time, one thread [s]")
        left.legend(fontsize=8, loc="best")
    figure.suptitle(
        "DDP of the finger, N = 75: how close a pass comes to the minimum of its basin", fontsize=12
    )
    return save(figure, out)
