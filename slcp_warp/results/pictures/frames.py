"""Frames of a motion: the mechanism at some of its times, what touches coloured by the impulse."""

from typing import Any

import numpy as np

from .drawing import Drawing, view
from .mechanism import Mechanism
from .motion import Motion
from .style import IMPULSE, Normalize


def impulse_norm(motion: Motion) -> Normalize:
    """Colours of a motion's impulses; from 0 to 1 where nothing touches, and there are none."""
    return Normalize(0.0, float(motion.impulse.max()) if motion.touches else 1.0)


def frame_steps(motion: Motion, count: int) -> np.ndarray:
    """Steps to show: the middle of equal slots, or the largest impulse of a slot that has one."""
    impulse = motion.impulse
    edges = np.linspace(0, len(impulse), count + 1).astype(int)
    chosen = []
    for low, high in zip(edges[:-1], edges[1:]):
        slot = impulse[low:high]
        touching = len(slot) and motion.touches and slot.max() > 0.02 * impulse.max()
        chosen.append(low + int(np.argmax(slot)) if touching else (low + high) // 2)
    return np.array(chosen)


def free_shape(mechanism: Mechanism) -> int:
    """The shape that shows the impulse: the last one that touches."""
    return mechanism.scene.structure.pairs[-1].shape_b if mechanism.scene.structure.pairs else 0


def draw_frames(axes: Any, motion: Motion) -> Normalize:
    """Draw a frame into every axes; the colours of the impulses."""
    mechanism, nv = Mechanism.of(motion), motion.scene.nv
    norm, bounds = impulse_norm(motion), mechanism.bounds(motion.states[:, :nv])
    for ax, k in zip(axes, frame_steps(motion, len(axes))):
        drawing = Drawing(ax, mechanism, motion.states[k, :nv])
        faces = {free_shape(mechanism): IMPULSE(norm(motion.impulse[k]))} if motion.touches else None
        drawing.update(motion.states[k, :nv], faces)
        view(ax, bounds)
        ax.set_title(f"{motion.time[k]:.2f} s", fontsize=10)
    return norm
