"""Cost against CPU time of ways to plan, a panel for every task."""

from pathlib import Path

import matplotlib.pyplot as plt


def starts_chart(path: Path, rows: list[dict[str, object]]) -> None:
    """Lines over the sizes of each way, with the range over seeds."""
    tasks = list(dict.fromkeys(row["task"] for row in rows))
    figure, axes = plt.subplots(1, len(tasks), figsize=(5.5 * len(tasks), 4.0), squeeze=False)
    for axis, task in zip(axes[0], tasks, strict=True):
        for way in dict.fromkeys(row["way"] for row in rows):
            own = [row for row in rows if row["task"] == task and row["way"] == way]
            seconds, cost, best, worst = (
                [float(str(row[name])) for row in own] for name in ("s", "cost", "best", "worst")
            )
            low = [c - b for c, b in zip(cost, best, strict=True)]
            high = [w - c for c, w in zip(cost, worst, strict=True)]
            axis.errorbar(seconds, cost, yerr=[low, high], marker="o", capsize=3, label=str(way))
        axis.set_xscale("log")
        if min(float(str(row["cost"])) for row in rows if row["task"] == task) > 0.0:
            axis.set_yscale("log")
        axis.set(title=str(task), xlabel="CPU time [s]", ylabel="cost of the plan")
    axes[0, 0].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)
