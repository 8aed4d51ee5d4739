"""Pictures of tasks: where runs begin, and where the cost wants the mechanism to be."""

from typing import Any

import numpy as np

from ..results.pictures.drawing import Drawing, square, view
from ..results.pictures.mechanism import Mechanism
from ..results.pictures.style import GREEN, STYLE, Axes, plt
from .goal import goal

STARTS = 5  # drawn at most


def figure(task: Any) -> Any:
    """A matplotlib figure of one task."""
    with plt.style.context(STYLE):
        sheet, ax = plt.subplots(figsize=(4.0, 4.0), layout="constrained")
        draw(ax, task)
    return sheet


def draw(ax: Axes, task: Any) -> None:
    """The first start in full, further ones pale, the cost's goal as green outlines."""
    nv = task.scene.nv
    mechanism = Mechanism(task.scene, task.scene.default_parameters())
    starts, wanted = task.start[:STARTS, :nv], goal(task)
    for q in starts[:0:-1]:
        Drawing(ax, mechanism, q, ghost=True)
    Drawing(ax, mechanism, starts[0])
    poses = starts
    if wanted is not None and np.abs(wanted[:nv] - starts[0]).max() > 1e-9:
        outline = Drawing(ax, mechanism, wanted[:nv], ghost=True)
        for patch in (*outline.patches, *outline.hulls.values()):
            patch.set(facecolor="none", edgecolor=GREEN, linestyle="--", alpha=0.9, zorder=5)
        for line in (*outline.links, *outline.axes, outline.pins):
            line.set(color=GREEN, alpha=0.6)
        poses = np.concatenate([starts, wanted[None, :nv]])
    view(ax, square(mechanism.bounds(poses, margin=0.04)))
    ax.set_title(task.name, fontsize=10)
