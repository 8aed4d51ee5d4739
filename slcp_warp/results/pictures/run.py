"""A picture of one world's run: the mechanism on its way, and its numbers over time by their names."""

from typing import Any

import numpy as np

from .frames import draw_frames
from .motion import Motion
from .style import IMPULSE, STYLE, plt

FRAMES = 5
LINES = 12  # with a legend; further ones are drawn without a name


def figure(motion: Motion) -> Any:
    """Frames on top; below an axes for every unit of the states, for controls, tendons and impulses."""
    panels = _panels(motion)
    with plt.style.context(STYLE):
        sheet = plt.figure(figsize=(9.0, 2.2 + 1.6 * len(panels)), layout="constrained")
        grid = sheet.add_gridspec(1 + len(panels), FRAMES, height_ratios=[1.4, *[1.0] * len(panels)])
        draw_frames([sheet.add_subplot(grid[0, j]) for j in range(FRAMES)], motion)
        below: list[Any] = []
        for i, (label, lines, drawstyle) in enumerate(panels, start=1):
            ax = sheet.add_subplot(grid[i, :], sharex=below[0] if below else None)
            for j, (name, values) in enumerate(lines.items()):
                colour = IMPULSE(0.75) if label.startswith("impulse") else None
                shown = name if j < LINES else None
                ax.plot(motion.time, values, label=shown, drawstyle=drawstyle, color=colour, lw=1.3)
            ax.set_ylabel(label)
            ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
            below.append(ax)
        for ax in below[:-1]:
            ax.tick_params(labelbottom=False)
        below[-1].set_xlabel("time [s]")
        below[-1].set_xlim(0.0, motion.time[-1])
        sheet.suptitle(f"{motion.scene.name}, h = {motion.step_size:g} s", fontsize=11)
    return sheet


def _panels(motion: Motion) -> list[tuple[str, dict[str, np.ndarray], str]]:
    """(label, lines by name, how they are drawn) of every axes."""
    scene = motion.scene
    panels = []
    for unit in dict.fromkeys(scene.state_units):
        own = [j for j, each in enumerate(scene.state_units) if each == unit]
        panels.append((f"[{unit}]", {scene.state_names[j]: motion.states[:, j] for j in own}, "default"))
    if motion.controls is not None and scene.nu:
        lines = {name: _held(motion.controls[:, j]) for j, name in enumerate(scene.control_names)}
        panels.append(("control", lines, "steps-post"))
    if motion.pulls is not None:
        lines = {name: _held(motion.pulls[:, j]) for j, name in enumerate(scene.tendon_names)}
        panels.append(("tendon [N, N m]", lines, "steps-post"))
    if motion.pushes is not None:
        panels.append(("impulse [N s]", {"all pairs": _held(motion.pushes)}, "steps-post"))
    return panels


def _held(values: np.ndarray) -> np.ndarray:
    """Values of steps (T,) at the times of states (T+1,): the last one lasts to the end of its step."""
    return np.append(values, values[-1:])
