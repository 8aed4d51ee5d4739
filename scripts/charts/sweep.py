"""Pictures of sweeps: how fast and how dependably worlds spin, and how that grows with the library."""

from pathlib import Path
from typing import Any

import numpy as np

import slcp_warp as slcp

from ..stages.sweep import case_name
from ..support.tables import number, read_csv
from .style import BLACK, CASES, GREY, plt, save

RIDGE = 0.85  # height of the tallest histogram, in rows
LAST_GUESS = "a report of `slcp sweep`, a sensitivity, a map, a falsification or a table of `slcp paper size`"
SIZE_COLUMNS = ("plans", "controllers", "residual", "step_size", "worlds", "mean_rate", "mean_rate_low",
                "mean_rate_high", "share_above", "share_above_low", "share_above_high")  # fmt: skip


def sweep_chart(report: slcp.SweepReport, path: Path) -> Path:
    """Distribution of rates, share above the threshold, and recovery, per case."""
    count = len(report.cases)
    figure, axes = plt.subplots(1, 3, figsize=(11.0, 1.2 + 0.75 * count), layout="constrained",
                                width_ratios=(1.3, 1.0, 1.1))  # fmt: skip
    rows = np.arange(count)[::-1]
    bins = np.linspace(*_rate_range(report), 61)
    for case, row, colour in zip(report.cases, rows, CASES * count):
        chosen = _rows_of(report, case)
        _ridge(axes[0], report.table["rate"][chosen], bins, row, colour)
        _shares(axes[1], case, row, colour)
        _recovery(axes[2], report.table["recovery_time"][chosen], colour, case_name(case))
    threshold = report.spec["threshold"]
    axes[0].axvline(threshold, color=BLACK, lw=1.0, ls="--")
    axes[0].set_xlabel(f"mean rate over {report.spec['duration']:g} s [rad/s]")
    axes[0].set_yticks(rows + 0.2, [case_name(case) for case in report.cases])
    axes[0].set_title(f"rates of {report.cases[0]['worlds']} worlds each", loc="left")
    axes[1].set_yticks([])
    axes[1].set_ylim(axes[0].get_ylim())
    axes[1].set_xlabel("● all the time, ○ second half [%]")
    axes[1].set_title(f"above {threshold:g} rad/s, 95 % intervals", loc="left")
    axes[2].set_xlabel("time after the last kick [s]")
    axes[2].set_ylabel("share of worlds [%]")
    axes[2].set_title(f"spinning again (rate over {report.spec['window']:g} s)", loc="left")
    if axes[2].lines:
        axes[2].legend(loc="lower right")
    return save(figure, path)


def _rows_of(report: slcp.SweepReport, case: dict[str, Any]) -> np.ndarray:
    """Mask of a case's worlds in the table."""
    return (report.table["residual"] == case["residual"]) & (report.table["step_size"] == case["step_size"])


def _rate_range(report: slcp.SweepReport) -> tuple[float, float]:
    rate = report.table["rate"][np.isfinite(report.table["rate"])]
    low, high = np.quantile(rate, (0.001, 0.999)) if len(rate) else (0.0, 1.0)
    return min(float(low), 0.0) - 0.05, max(float(high), 1.0) + 0.05


def _ridge(ax: Any, rates: np.ndarray, bins: np.ndarray, row: float, colour: str) -> None:
    """A histogram that stands on its case's line, with the mean marked."""
    rates = rates[np.isfinite(rates)]
    heights, _ = np.histogram(rates, bins)
    heights = RIDGE * heights / max(heights.max(), 1)
    ax.fill_between(bins[:-1], row, row + heights, step="post", color=colour, alpha=0.85, linewidth=0)
    ax.axhline(row, color=colour, lw=0.8)
    mean = rates.mean() if len(rates) else np.nan
    ax.plot([mean, mean], [row, row + RIDGE], color=BLACK, lw=1.2)
    ax.annotate(f"{mean:.2f}", (mean, row + RIDGE), xytext=(3, -2), textcoords="offset points", va="top",
                fontsize=9)  # fmt: skip


def _shares(ax: Any, case: dict[str, Any], row: float, colour: str) -> None:
    """Shares of worlds with their intervals: over all the time, and in the second half."""
    for name, height, face in (("share_above", 0.4, colour), ("share_spinning", 0.15, "white")):
        share, low, high = 100.0 * np.array(case[name])
        ax.plot([low, high], [row + height] * 2, color=colour, lw=2.0, solid_capstyle="butt")
        ax.plot(share, row + height, "o", color=colour, markerfacecolor=face)
        ax.annotate(f"{share:.1f}", (share, row + height), xytext=(0, 5), textcoords="offset points",
                    ha="center", fontsize=8)  # fmt: skip


def _recovery(ax: Any, times: np.ndarray, colour: str, label: str) -> None:
    """Share of worlds that spin again, by time; worlds that never do count."""
    finite = np.sort(times[np.isfinite(times)])
    if not len(finite):
        return
    grid = np.unique(np.append(finite, finite[-1] + 0.5))
    ax.step(grid, 100.0 * np.searchsorted(finite, grid, side="right") / len(times), where="post",
            color=colour, label=label)  # fmt: skip


def read_sizes(path: Path) -> list[dict[str, Any]]:
    """Rows of `slcp size`. Raises FileError."""
    rows = read_csv(path, LAST_GUESS, SIZE_COLUMNS)
    finite = ("plans", "step_size")  # rates of sweeps in which nothing was solved are not
    return [
        row | {k: number(path, row, k, k in finite) for k in SIZE_COLUMNS if k != "residual"} for row in rows
    ]


def size_chart(path_in: Path, path: Path) -> Path:
    """Mean rate, and share of worlds above the threshold, against the number of plans."""
    rows = read_sizes(path_in)
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    cases = list(dict.fromkeys((row["residual"], row["step_size"]) for row in rows))
    for case, colour in zip(cases, CASES * len(cases)):
        mine = [row for row in rows if (row["residual"], row["step_size"]) == case]
        plans = [row["plans"] for row in mine]
        label = case_name({"residual": case[0], "step_size": case[1]})
        for ax, name, scale in ((axes[0], "mean_rate", 1.0), (axes[1], "share_above", 100.0)):
            value, low, high = (
                scale * np.array([row[name + end] for row in mine]) for end in ("", "_low", "_high")
            )
            ax.fill_between(plans, low, high, color=colour, alpha=0.2, linewidth=0)
            ax.plot(plans, value, "o-", color=colour, markersize=4, label=label)
    ticks = sorted({row["plans"] for row in rows})
    for ax, name in zip(axes, ("mean rate [rad/s]", "worlds above the threshold [%]")):
        ax.set_xscale("log")
        ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        ax.minorticks_off()
        ax.set_xlabel("plans in the library")
        ax.set_ylabel(name)
        ax.set_ylim(bottom=min(0.0, ax.get_ylim()[0]))
    axes[1].axhline(90.0, color=GREY, lw=1.0, ls="--")
    axes[0].legend(loc="lower right")
    return save(figure, path)
