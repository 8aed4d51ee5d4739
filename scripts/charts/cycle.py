"""Pictures of a controlled trajectory: Fig. 4, the limit cycle; Fig. 5, frames of it; an animation."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize

from slcp_warp.storage.files import replacing

from ..support.records import Record
from ..support.simulators import FINGER, mechanism_name
from .mechanism import Drawing, Mechanism, view
from .space import add_path, add_surface, space_axes
from .style import BLACK, BLUE, IMPULSE, plt, save

FRAMES = 10
GIF_RATE = 10  # frames per second: the animation runs in real time


@dataclass(frozen=True)
class Cycle:
    """A piece of one world's trajectory.

    Attributes:
        time: (T+1,) from 0 [s].
        states: (T+1, nx).
        impulse: (T,) normal impulse, all pairs together [N s].
    """

    time: np.ndarray
    states: np.ndarray
    impulse: np.ndarray


def whole(record: Record, world: int = 0) -> Cycle:
    """The whole trajectory of a world."""
    states = record["states"][world].astype(float)
    impulse = record["contact_impulse"][world, :, :, 0].sum(axis=-1).astype(float)
    return Cycle(np.arange(len(states)) * record.step_size, states, impulse)


def last_turn(record: Record, world: int = 0, turns: int = 1) -> Cycle:
    """The finger's last stretch in which theta3 advances by `turns` periods; the whole trajectory if it never
    does, and of other mechanisms.
    """
    all_ = whole(record, world)
    if mechanism_name(record.scene) != FINGER:
        return all_
    period = np.pi
    angle = all_.states[:, 2]
    begin = np.flatnonzero(angle <= angle[-1] - turns * period)
    if not len(begin):
        return all_
    first = int(begin[-1])
    return Cycle(all_.time[first:] - all_.time[first], all_.states[first:], all_.impulse[first:])


def impulse_norm(cycle: Cycle) -> Normalize:
    """Colours of a cycle's impulses."""
    return Normalize(0.0, max(float(cycle.impulse.max()), 1e-9))


def cycle_chart(record: Record, path: Path, surface: Record | None = None, world: int = 0) -> Path:
    """Fig. 4: the limit cycle in configuration space, and what happens over time, coloured by impulse."""
    cycle = last_turn(record, world, turns=2)
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
    bar = figure.colorbar(ScalarMappable(norm, IMPULSE), cax=place, orientation="horizontal")
    bar.set_label("contact impulse of a step [N s]")
    residual = record.simulated.options.residual
    kind = "smoothed" if residual == "rem-logistic" else residual
    h = record.step_size
    figure.suptitle(f"Last two half turns of the controlled {kind} system, h = {h:g} s", fontsize=11)
    return save(figure, path)


def _coloured(ax: Any, cycle: Cycle, j: int, norm: Normalize) -> None:
    """State component j over time, coloured by impulse."""
    points = np.stack([cycle.time, cycle.states[:, j]], axis=1)
    lines = LineCollection(list(np.stack([points[:-1], points[1:]], axis=1)), cmap=IMPULSE, norm=norm,
                           linewidths=2.2, capstyle="round")  # fmt: skip
    lines.set_array(cycle.impulse)
    ax.add_collection(lines)
    ax.autoscale_view()


def frame_times(cycle: Cycle, count: int) -> np.ndarray:
    """Steps to show: the middle of equal slots, or the largest impulse of a slot that has one."""
    edges = np.linspace(0, len(cycle.impulse), count + 1).astype(int)
    chosen = []
    for low, high in zip(edges[:-1], edges[1:]):
        slot = cycle.impulse[low:high]
        touching = len(slot) and slot.max() > 0.02 * cycle.impulse.max() > 0.0
        chosen.append(low + int(np.argmax(slot)) if touching else (low + high) // 2)
    return np.array(chosen)


def free_shape(mechanism: Mechanism) -> int:
    """The shape that shows the impulse: the last one that touches."""
    return mechanism.scene.structure.pairs[-1].shape_b if mechanism.scene.structure.pairs else 0


def frames_chart(record: Record, path: Path, world: int = 0) -> Path:
    """Fig. 5: frames of the last turn, the free ellipse coloured by the impulse of the step."""
    cycle, mechanism = last_turn(record, world), Mechanism.of(record, world)
    nv = mechanism.scene.nv
    norm, bounds = impulse_norm(cycle), mechanism.bounds(cycle.states[:, :nv])
    height = 1.0 + 3.6 * (bounds[3] - bounds[2]) / (bounds[1] - bounds[0])
    figure, axes = plt.subplots(2, FRAMES // 2, figsize=(9.0, min(height, 6.5)), layout="constrained")
    for ax, k in zip(axes.flat, frame_times(cycle, FRAMES)):
        drawing = Drawing(ax, mechanism, cycle.states[k, :nv])
        drawing.update(cycle.states[k, :nv], {free_shape(mechanism): IMPULSE(norm(cycle.impulse[k]))})
        view(ax, bounds)
        ax.set_title(f"{cycle.time[k]:.2f} s", fontsize=10)
    bar = figure.colorbar(ScalarMappable(norm, IMPULSE), ax=axes, shrink=0.7, pad=0.02)
    bar.set_label("contact impulse of the step [N s]")
    return save(figure, path)


def animation(record: Record, path: Path, seconds: float = 8.0, world: int = 0) -> Path:
    """A GIF in real time of the trajectory's last seconds."""
    cycle, mechanism = whole(record, world), Mechanism.of(record, world)
    nv, h = mechanism.scene.nv, record.step_size
    count = max(1, int(min(seconds, cycle.time[-1]) * GIF_RATE))
    last = len(cycle.impulse) - 1
    chosen = np.round(last - (count - 1 - np.arange(count)) / GIF_RATE / h).astype(int).clip(0, last)
    shown = cycle.states[chosen, :nv]
    bounds, norm = mechanism.bounds(shown, margin=0.1), impulse_norm(cycle)
    aspect = (bounds[3] - bounds[2]) / (bounds[1] - bounds[0])
    width = min(3.6, 4.0 / aspect)
    figure = plt.figure(figsize=(width, width * aspect))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    drawing = Drawing(ax, mechanism, shown[0])
    view(ax, bounds)
    clock = ax.text(0.03, 0.03, "", transform=ax.transAxes, color=BLACK, fontsize=11)
    ax.text(0.97, 0.03, f"h = {h:g} s", transform=ax.transAxes, color=BLUE, fontsize=9, ha="right")
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = PillowWriter(fps=GIF_RATE)
    with replacing(path) as part, writer.saving(figure, str(part), dpi=80):
        for k, q in zip(chosen, shown):
            low = max(0, k - round(0.5 / GIF_RATE / h))
            peak = cycle.impulse[low : k + 1].max()  # a flick shorter than a frame is shown, too
            drawing.update(q, {free_shape(mechanism): IMPULSE(norm(peak))})
            clock.set_text(f"{(k - chosen[0]) * h:.1f} s")
            writer.grab_frame()
    plt.close(figure)
    return path
