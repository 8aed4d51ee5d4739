"""The trace of DDP: how the cost and the largest |Q_u| fall, pass by pass."""

from pathlib import Path

import numpy as np

from ..support.records import Record
from .style import BLUE, GREY, RED, plt, save


def trace_chart(record: Record, path: Path) -> Path:
    """Cost per pass; then, on a log scale, its distance from the end and the largest |Q_u|."""
    cost, gradient = record["trace_cost"], record["trace_gradient"]
    level, sigmas = record["trace_level"], record["level_sigma"]
    passes = np.arange(len(cost))
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    if "batch_cost" in record.arrays:
        batch = record["batch_cost"]
        since = int(record.header.get("batch_from", 0)) + np.arange(batch.shape[-1])
        left.plot(since, batch.T, color=GREY, lw=0.6, alpha=0.7)
        left.plot([], [], color=GREY, lw=0.8, label=f"the {len(batch)} starts and schedules")
        shown = batch[np.isfinite(batch)]
        high = float(np.quantile(shown, 0.95))
        margin = 0.05 * max(high - float(cost.min()), 1e-3 * abs(high))
        left.set_ylim(float(cost.min()) - margin, high + margin)
    left.plot(passes, cost, color=BLUE, lw=2.2, label="the best")
    left.annotate(f"{cost[-1]:.3f}", (passes[-1], cost[-1]), xytext=(6, 0), textcoords="offset points",
                  va="center", color=BLUE)  # fmt: skip
    left.set_xlabel("pass")
    left.set_ylabel("cost")
    left.legend(loc="upper right")
    distance = cost - np.array([cost[level == k][-1] for k in level])
    for values, colour, mark, label in (
        (distance, BLUE, "o", "cost less the final cost"),
        (gradient, RED, "s", "largest |Qᵤ|"),
    ):
        if (values > 0.0).any():  # a start that is stationary has neither
            shown = np.where(values > 0.0, values, np.nan)
            right.semilogy(passes, shown, color=colour, marker=mark, markersize=3, label=label)
    right.set_xlabel("pass")
    if right.lines:
        right.legend(loc="lower left")
    if len(sigmas) > 1:
        for k in range(len(sigmas)):
            first = int(np.argmax(level == k))
            for ax in (left, right):
                ax.axvline(first - 0.5, color=GREY, lw=0.8, ls=":")
            right.text(first, 1.0, f" σ = {sigmas[k]:g}", transform=right.get_xaxis_transform(), fontsize=7,
                       rotation=90, va="top", color="#555555")  # fmt: skip
    method = record.header["method"].replace("-", " ")
    figure.suptitle(
        f"DDP ({method}), N = {record.header['horizon']}, σ = {record.header['sigma']:g}", fontsize=11
    )
    return save(figure, path)
