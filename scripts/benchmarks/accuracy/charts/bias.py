"""Chart of study "bias": how smoothed solutions become the hard one as sigma falls, and what it costs."""

from pathlib import Path

from ....charts.style import GREY, plt, save
from .lines import Rows, choose, cost_ticks, curves, need, plot, points

IMPACT, BALL = "finger impact", "resting ball"


def draw(rows: Rows, out: Path) -> Path:
    """The finger's error over sigma, the ball's gap over sigma, and the finger's error over the cost."""
    rows = need(rows, "bias")
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(13.5, 4.4), layout="constrained")
    finger, ball = choose(rows, problem=IMPACT), choose(rows, problem=BALL)
    for label, part, colour in curves([row for row in finger if row["curve"] != "hard"]):
        plot(left, points(part, "value", "error"), color=colour, label=label)
        shown = [row | {"us": 1e6 * float(row["seconds"])} for row in part]
        plot(right, points(shown, "us", "error"), "o", color=colour, label=label)
    steps = [float(row["discretisation"]) for row in finger if row.get("discretisation")]
    for ax in (left, right) if steps else ():
        ax.axhline(steps[0], color=GREY, linestyle=":")
    if steps:
        smallest = min(float(row["value"]) for row in finger if row["value"])
        left.text(smallest, 1.15 * steps[0], "error of the step size", fontsize=8, color=GREY)
    for row in choose(finger, curve="hard"):
        right.axvline(1e6 * float(row["seconds"]), color=GREY, linewidth=0.9)
        right.text(1e6 * float(row["seconds"]), 0.1, " hard", fontsize=8, color=GREY,
                   transform=right.get_xaxis_transform())  # fmt: skip
    for label, part, colour in curves(ball, of=rows):
        plot(middle, points(part, "value", "closed_form"), "--", color=colour, label=f"{label}, closed form")
        plot(middle, points(part, "value", "error"), "o", color=colour, label=label)
    middle.set_ylim(1e-18, 1e-1)
    left.set(title="finger's impacts", xlabel="σ", ylabel="distance to the hard state at 2 s")
    middle.set(title="ball at rest, h = .02", xlabel="σ", ylabel="gap [m]")
    right.set(title="finger's impacts", xlabel="CPU time of a step [µs]")
    cost_ticks(right)
    left.legend(fontsize=8)
    middle.legend(fontsize=8)
    figure.suptitle("the bias of smoothing: smoothed solutions against the hard one as σ falls", fontsize=12)
    return save(figure, out)
