"""Tasks on one sheet: where runs begin, and where the cost wants the mechanism to be."""

from pathlib import Path

import slcp_warp as slcp
from slcp_warp.tasks.picture import draw

from .style import plt, save

COLUMNS = 4


def sheet(tasks: list[slcp.Task], path: Path) -> Path:
    """Draw the tasks beside each other."""
    rows = -(-len(tasks) // COLUMNS)
    figure, axes = plt.subplots(rows, COLUMNS, figsize=(2.4 * COLUMNS, 2.5 * rows), layout="constrained")
    for ax in axes.flat:
        ax.set_axis_off()
    for ax, task in zip(axes.flat, tasks):
        draw(ax, task)
    return save(figure, path)
