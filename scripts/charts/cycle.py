"""Pictures of a controlled trajectory: Fig. 4, the limit cycle; Fig. 5, frames of it."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize

import slcp_warp as slcp
from slcp_warp.results.pictures.frames import draw_frames, impulse_norm
from slcp_warp.results.pictures.mechanism import Mechanism
from slcp_warp.results.pictures.motion import Motion

from ..support.paper import SCENE
from ..support.records import Record
from ..support.simulators import mechanism_name
from .space import add_path, add_surface, space_axes
from .style import IMPULSE, plt, save

FRAMES = 10


def last_turn(run: slcp.Trajectory, world: int = 0, turns: int = 1) -> Motion:
    """The finger's last stretch in which theta3 advances by `turns` periods; the whole trajectory if it never
    does, and of other mechanisms.
    """
    whole = run.motion(world)
    if mechanism_name(run.scene) != SCENE:
        return whole
    period = np.pi
    angle = whole.states[:, 2]
    begin = np.flatnonzero(angle <= angle[-1] - turns * period)
    return whole.since(int(begin[-1])) if len(begin) else whole


def cycle_chart(run: slcp.Trajectory, path: Path, surface: Record | None = None, world: int = 0) -> Path:
    """Fig. 4: the limit cycle in configuration space, and what happens over time, coloured by impulse."""
    cycle = last_turn(run, world, turns=2)
    norm = impulse_norm(cycle)
    figure = plt.figure(figsize=(10.0, 5.0))
    grid = figure.add_gridspec(3, 1, left=0.6, right=0.96, bottom=0.11, top=0.9, hspace=0.15)
    ax = space_axes(figure, (0.04, 0.16, 0.46, 0.84))
    if surface is not None:
        add_surface(ax, surface, alpha=0.14, legal_only=True)
    add_path(ax, cycle.states[:, :3], cycle.impulse, norm)
    over_time = [figure.add_subplot(grid[i]) for i in range(3)]
    names = ("θ₁, θ₂ [rad]", "θ₃ [rad]", "impulse [N s]")
    _coloured(over_time[0], cycle, 0, norm)
    _coloured(over_time[0], cycle, 1, norm)
    for j, name in ((0, "θ₁"), (1, "θ₂")):
        over_time[0].annotate(name, (cycle.time[-1], cycle.states[-1, j]), xytext=(5, 0),
                              textcoords="offset points", va="center")  # fmt: skip
    _coloured(over_time[1], cycle, 2, norm)
    over_time[2].fill_between(cycle.time[:-1], cycle.impulse, step="post", color=IMPULSE(0.75), linewidth=0)
    for axis, name in zip(over_time, names):
        axis.set_ylabel(name)
        axis.set_xlim(0.0, cycle.time[-1])
    for axis in over_time[:2]:
        axis.tick_params(labelbottom=False)
    figure.align_ylabels(over_time)
    over_time[2].set_xlabel("time [s]")
    over_time[2].set_ylim(0.0, None)
    place = figure.add_axes((0.12, 0.1, 0.3, 0.02))
    if cycle.touches:
        bar = figure.colorbar(ScalarMappable(norm, IMPULSE), cax=place, orientation="horizontal")
        bar.set_label("contact impulse of a step [N s]")
    else:
        place.set_axis_off()
    residual = run.options.residual
    kind = "smoothed" if residual == "rem-logistic" else residual
    h = run.step_size
    figure.suptitle(f"Last two half turns of the controlled {kind} system, h = {h:g} s", fontsize=11)
    return save(figure, path)


def _coloured(ax: Any, cycle: Motion, j: int, norm: Normalize) -> None:
    """State component j over time, coloured by impulse."""
    points = np.stack([cycle.time, cycle.states[:, j]], axis=1)
    lines = LineCollection(list(np.stack([points[:-1], points[1:]], axis=1)), cmap=IMPULSE, norm=norm,
                           linewidths=2.2, capstyle="round")  # fmt: skip
    lines.set_array(cycle.impulse)
    ax.add_collection(lines)
    ax.autoscale_view()


def frames_chart(run: slcp.Trajectory, path: Path, world: int = 0) -> Path:
    """Fig. 5: frames of the last turn, the free ellipse coloured by the impulse of the step."""
    cycle = last_turn(run, world)
    bounds = Mechanism.of(cycle).bounds(cycle.states[:, : run.scene.nv])
    height = 1.0 + 3.6 * (bounds[3] - bounds[2]) / (bounds[1] - bounds[0])
    figure, axes = plt.subplots(2, FRAMES // 2, figsize=(9.0, min(height, 6.5)), layout="constrained")
    norm = draw_frames(axes.flat, cycle)
    if cycle.touches:
        bar = figure.colorbar(ScalarMappable(norm, IMPULSE), ax=axes, shrink=0.7, pad=0.02)
        bar.set_label("contact impulse\nof the step [N s]")
    else:
        figure.supxlabel("nothing touches" if cycle.pushes is not None else "impulses were not recorded")
    return save(figure, path)
