"""The trace of DDP: how the cost and the largest |Q_u| fall, pass by pass."""

from pathlib import Path
from typing import Any

import numpy as np

from ..support.records import Record
from .style import BLUE, GREY, RED, plt, save


def trace_chart(record: Record, path: Path) -> Path:
    """Cost per pass; then, on a log scale, its distance from the end and the largest |Q_u|.

    Of a batch of problems the cheapest's, before the costs of all.
    """
    drawn, others = _chosen(record.arrays)
    written = np.isfinite(drawn["trace_gradient"])
    cost, gradient = drawn["trace_cost"][written], drawn["trace_gradient"][written]
    level = record.arrays.get("trace_level", np.zeros(len(cost), int))
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    if others is not None:
        word = "starts and schedules" if "batch_cost" in record.arrays else "problems"
        _draw_others(left, others, int(record.header.get("batch_from", 0)), float(cost.min()), word)
    last = len(cost) - 1
    left.plot(cost, color=BLUE, lw=2.2, label="the best")
    left.annotate(f"{cost[-1]:.3f}", (last, cost[-1]), xytext=(6, 0), textcoords="offset points",
                  va="center", color=BLUE)  # fmt: skip
    left.set_xlabel("pass")
    left.set_ylabel("cost")
    left.legend(loc="upper right")
    distance = cost - np.array([cost[level == k][-1] for k in level])
    _draw_positive(right, distance, BLUE, "o", "cost less the final cost")
    _draw_positive(right, gradient, RED, "s", "largest |Qᵤ|")
    right.set_xlabel("pass")
    if right.lines:
        right.legend(loc="lower left")
    _draw_levels((left, right), level, record.arrays.get("level_sigma", np.zeros(1)))
    figure.suptitle(", ".join(_title(record.header)), fontsize=11)
    return save(figure, path)


def _draw_others(ax: Any, batch: np.ndarray, start: int, least: float, word: str) -> None:
    """Costs (B, passes) of others, from a pass on; the axis shows what most of them cost."""
    ax.plot(start + np.arange(batch.shape[-1]), batch.T, color=GREY, lw=0.6, alpha=0.7)
    ax.plot([], [], color=GREY, lw=0.8, label=f"the {len(batch)} {word}")
    high = float(np.quantile(batch[np.isfinite(batch)], 0.95))
    margin = 0.05 * max(high - least, 1e-3 * abs(high))
    ax.set_ylim(least - margin, high + margin)


def _draw_positive(ax: Any, values: np.ndarray, colour: str, mark: str, label: str) -> None:
    """Numbers by passes on a log scale; a start that is stationary has none."""
    if (values > 0.0).any():
        shown = np.where(values > 0.0, values, np.nan)
        ax.semilogy(shown, color=colour, marker=mark, markersize=3, label=label)


def _draw_levels(axes: tuple[Any, Any], level: np.ndarray, sigmas: np.ndarray) -> None:
    """Where noise levels begin, if there are several."""
    for k in range(len(sigmas) if len(sigmas) > 1 else 0):
        first = int(np.argmax(level == k))
        for ax in axes:
            ax.axvline(first - 0.5, color=GREY, lw=0.8, ls=":")
        axes[1].text(first, 1.0, f" σ = {sigmas[k]:g}", transform=axes[1].get_xaxis_transform(), fontsize=7,
                     rotation=90, va="top", color="#555555")  # fmt: skip


def _chosen(arrays: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """The trace that is drawn, and the costs (B, passes) behind it, if there are any."""
    if arrays["trace_cost"].ndim == 1:
        return arrays, arrays.get("batch_cost")
    cost = arrays["cost"]
    best = int(np.argmin(np.where(np.isfinite(cost), cost, np.inf)))
    return {name: each[best] for name, each in arrays.items() if len(each) == len(cost)}, arrays["trace_cost"]


def _title(header: dict[str, Any]) -> list[str]:
    """How the plan was made, as far as the file says."""
    method = header["method"].replace("-", " ") if "method" in header else ""
    title = [f"DDP ({method})" if method else "DDP", f"N = {header['horizon']}"]
    return [*title, f"σ = {header['sigma']:g}"] if header.get("sigma") is not None else title
