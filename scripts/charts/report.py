"""Pictures of a task's report and of any library: how often policies succeed, what plans gain."""

import math
from pathlib import Path
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp.ensembles.chunks import KEYS
from slcp_warp.ensembles.statistics.intervals import Interval

from ..stages.task_sweep import tell_incomplete
from .style import BLUE, CASES, GREY, plt, save

Row = dict[str, Any]
ACROSS = 5  # pictures beside each other
SAME, NOTHING = 1e-5, 1e-12  # of a size; as one


def report_chart(file: Path, path: Path) -> Path:
    """Success of every policy and case with its 95 % interval, and the distribution of each measure.

    A measure that is finite in no median (a failure's time where most runs have none) is named below instead.
    """
    report = tell_incomplete(slcp.load_report(file), file)
    shares, spreads = (_by_key(rows) for rows in (report.summary, report.quantiles()))
    disturbed = [key for key in shares if key[3] == "disturbed"]
    shown = [m for m in report.measures if any(_finite(spreads[key][m]) for key in disturbed)]
    across = min(ACROSS, 1 + len(shown))
    lines = math.ceil((1 + len(shown)) / across)
    height, width = 0.9 + (1.0 + 0.35 * len(disturbed)) * lines, 1.4 + 2.6 * across
    figure, grid = plt.subplots(lines, across, figsize=(width, height), layout="constrained", squeeze=False)
    axes = grid.ravel()
    policies = list(dict.fromkeys(key[0] for key in disturbed))
    rows = np.arange(len(disturbed))[::-1]
    for row, key in zip(rows, disturbed):
        colour = CASES[policies.index(key[0]) % len(CASES)]
        _success(axes[0], shares[key], shares.get((*key[:3], "undisturbed")), row, colour)
        for ax, name in zip(axes[1:], shown):
            _spread(ax, spreads[key][name], row, colour)
    for ax in axes[1 : 1 + len(shown)]:
        _steady(ax)
    axes[0].set_xlim(-3.0, 103.0)
    for ax, name in zip(axes, ("success [%]; ○ undisturbed", *shown)):
        ax.set_yticks([])
        ax.set_xlabel(name)
        ax.set_ylim(-0.6, len(disturbed) - 0.4)
    for ax in grid[:, 0]:
        ax.set_yticks(rows, [f"{policy}, {case}, h = {h:g}" for policy, case, h, _ in disturbed])
    for ax in axes[1 + len(shown) :]:
        ax.set_visible(False)
    notes = ["bars: success with its 95 % interval"]
    if shown:
        notes.append("of measures the median (○), the middle half (thick) and nine tenths (thin)")
    if left := [name for name in report.measures if name not in shown]:
        notes.append(f"finite in less than half of the worlds: {', '.join(left)}")
    figure.supxlabel("\n".join(notes), fontsize=8)
    return save(figure, path)


def _by_key(rows: list[Row]) -> dict[tuple[Any, ...], Row]:
    return {tuple(row[key] for key in KEYS): row for row in rows}


def _success(ax: Any, part: Row, still: Row | None, row: float, colour: str) -> None:
    share, low, high = (100.0 * s for s in part["success"])
    ax.plot([low, high], [row, row], color=colour, lw=2.5, solid_capstyle="butt")
    ax.plot(share, row, "o", color=colour)
    if still is not None:
        ax.plot(100.0 * still["success"][0], row, "o", color=colour, markerfacecolor="white", zorder=1)


def _finite(quantiles: dict[float, Interval]) -> bool:
    """Whether the median is a number."""
    values = [value for value, _, _ in quantiles.values()]
    return bool(np.isfinite(values[len(values) // 2]))


def _spread(ax: Any, quantiles: dict[float, Interval], row: float, colour: str) -> None:
    """The median, the middle half and the middle nine tenths; nothing of what is infinite."""
    a, b, middle, c, d = (value for value, _, _ in quantiles.values())
    for ends, width in (((a, d), 1.0), ((b, c), 4.0)):
        if np.isfinite(ends).all():
            ax.plot(ends, [row, row], color=colour, lw=width, solid_capstyle="butt")
    if np.isfinite(middle):
        ax.plot(middle, row, "o", color=colour, markerfacecolor="white")


def _steady(ax: Any) -> None:
    """Where all that an axis shows is the same to single precision, no picture of roundings."""
    low, high = ax.get_xlim()
    size = max(abs(low), abs(high))
    if high - low <= SAME * size or size <= NOTHING:
        middle, room = (0.5 * (low + high), 0.05 * size) if size > NOTHING else (0.0, 1.0)
        ax.set_xlim(middle - room, middle + room)


def gains_chart(library: ddp.Library, path: Path) -> Path:
    """What the plans gain over zero controls, in the order of their making, and where they start."""
    first = library.age == 0
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    left.plot(np.arange(first.sum()), library.gain[first], ".", color=BLUE)
    left.axhline(0.0, color=GREY, lw=0.8)
    left.set_xlabel("plan")
    left.set_ylabel("gain over zero controls")
    dots = right.scatter(*library.x[first][:, :2].T, c=library.gain[first], s=14)
    right.set_xlabel("first coordinate")
    right.set_ylabel("second coordinate" if library.x.shape[1] > 2 else "its rate")
    figure.colorbar(dots, ax=right, label="gain")
    return save(figure, path)
