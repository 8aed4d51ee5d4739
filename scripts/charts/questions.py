"""Pictures of answers: which drawn numbers matter, and where a policy holds."""

from pathlib import Path
from typing import Any

import numpy as np

from slcp_warp.ensembles.questions.axes import meant
from slcp_warp.ensembles.questions.robustness_map import HEAD as MAP_COLUMNS
from slcp_warp.ensembles.statistics.sensitivity import HEAD as SENSITIVITY_COLUMNS
from slcp_warp.storage.files import FileError

from ..support.tables import number, read_csv
from .style import BLUE, ORANGE, plt, save

SHOWN = 24  # names, the most important ones
LEVELS = (0.5, 0.9, 0.99)


def read_sensitivity(file: Path) -> tuple[list[dict[str, str]], np.ndarray]:
    """Rows of `slcp sensitivity`, and (rows, 2, 3) indices of first and total order. Raises FileError."""
    rows = read_csv(file, "a table of `slcp sensitivity`", SENSITIVITY_COLUMNS)
    names = [order + end for order in ("first", "total") for end in ("", "_low", "_high")]
    values = np.array([[number(file, row, name, False) for name in names] for row in rows])
    return rows, values.reshape(-1, 2, 3)


def sensitivity_chart(file: Path, path: Path) -> Path:
    """Indices of first and of total order with their 95 % intervals, the most important first."""
    rows, indices = read_sensitivity(file)
    rows, indices = rows[:SHOWN], indices[:SHOWN]
    figure, ax = plt.subplots(figsize=(6.4, 1.2 + 0.38 * len(rows)), layout="constrained")
    places = np.arange(len(rows))[::-1]
    for order, shift, colour, label in (
        (0, 0.15, BLUE, "alone"), (1, -0.15, ORANGE, "with interactions"),
    ):  # fmt: skip
        if np.isfinite(indices[:, order, 0]).any():
            _bars(ax, places + shift, indices[:, order], colour, label)
    ax.set_yticks(places, [_short(row["drawn"]) for row in rows])
    ax.axvline(0.0, color="black", lw=0.8)
    ax.set_xlabel(f"share of the variance of {rows[0]['measure']} ({rows[0]['policy']})")
    if ax.containers:
        ax.legend(loc="lower right")
    return save(figure, path)


def _short(drawn: str) -> str:
    """The first of the names that share a draw, and how many these are."""
    first, *others = drawn.split(", ")
    return drawn if len(others) < 2 else f"{first} and {len(others)} more"


def _bars(ax: Any, places: np.ndarray, values: np.ndarray, colour: str, label: str) -> None:
    value, low, high = values.T
    ax.barh(places, value, height=0.28, color=colour, label=label, alpha=0.8)
    for place, a, b in zip(places, low, high):
        ax.plot([a, b], [place, place], color="black", lw=1.2)


def read_map(file: Path) -> tuple[dict[str, str], np.ndarray, np.ndarray, np.ndarray]:
    """A row of `slcp map`, its values of x (X,) and y (Y,), shares of successes (Y, X). Raises FileError."""
    rows = read_csv(file, "a table of `slcp map`", MAP_COLUMNS)
    names = ("x_value", "y_value", "success")
    x, y, share = (np.array([number(file, row, name) for row in rows]) for name in names)
    across, down = np.unique(x), np.unique(y)
    if len(rows) != len(across) * len(down):
        raise FileError(f"{file} has {len(rows)} cells; {len(down)} x {len(across)} are needed")
    grid = np.full((len(down), len(across)), np.nan)
    grid[np.searchsorted(down, y), np.searchsorted(across, x)] = share
    if np.isnan(grid).any():
        raise FileError(f"{file} has a cell twice")
    return rows[0], across, down, grid


def map_chart(file: Path, path: Path) -> Path:
    """Share of successes over the grid, with lines where it is a half, nine tenths and 99 %."""
    named, across, down, grid = read_map(file)
    figure, ax = plt.subplots(figsize=(5.6, 4.4), layout="constrained")
    mesh = ax.pcolormesh(across, down, grid, vmin=0.0, vmax=1.0, cmap="viridis", shading="nearest")
    if min(grid.shape) > 1 and grid.min() < grid.max():
        lines = ax.contour(across, down, grid, levels=LEVELS, colors="white", linewidths=1.2)
        ax.clabel(lines, fmt=lambda level: f"{100.0 * level:g} %")
    ax.set_xlabel(meant(named["x"]))
    ax.set_ylabel(meant(named["y"]))
    figure.colorbar(mesh, ax=ax, label=f"share of successes, {named['worlds']} worlds a cell")
    return save(figure, path)
