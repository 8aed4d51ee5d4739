"""An animation of a motion."""

from pathlib import Path

import numpy as np

from ...storage.files import replacing
from .drawing import Drawing, view
from .frames import free_shape, impulse_norm
from .mechanism import Mechanism
from .motion import Motion
from .style import BLACK, BLUE, IMPULSE, STYLE, PillowWriter, plt


def animation(motion: Motion, path: Path, seconds: float = np.inf, rate: int = 10) -> Path:
    """Write a GIF in real time of a motion's last seconds, `rate` pictures a second."""
    mechanism, nv, h = Mechanism.of(motion), motion.scene.nv, motion.step_size
    count = max(1, int(min(seconds, motion.time[-1]) * rate))
    last = len(motion.impulse) - 1
    chosen = np.round(last - (count - 1 - np.arange(count)) / rate / h).astype(int).clip(0, last)
    shown = motion.states[chosen, :nv]
    bounds, norm = mechanism.bounds(shown, margin=0.04), impulse_norm(motion)
    aspect = (bounds[3] - bounds[2]) / (bounds[1] - bounds[0])
    width = min(3.6, 4.0 / aspect)
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = PillowWriter(fps=rate)
    with plt.style.context(STYLE):
        figure = plt.figure(figsize=(width, width * aspect))
        try:
            ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
            drawing = Drawing(ax, mechanism, shown[0])
            view(ax, bounds)
            clock = ax.text(0.03, 0.03, "", transform=ax.transAxes, color=BLACK, fontsize=11)
            ax.text(0.97, 0.03, f"h = {h:g} s", transform=ax.transAxes, color=BLUE, fontsize=9, ha="right")
            with replacing(path) as part, writer.saving(figure, str(part), dpi=80):
                for k, q in zip(chosen, shown):
                    low = max(0, k - round(0.5 / rate / h))
                    peak = motion.impulse[low : k + 1].max()  # a flick shorter than a frame is shown, too
                    faces = {free_shape(mechanism): IMPULSE(norm(peak))} if motion.touches else None
                    drawing.update(q, faces)
                    clock.set_text(f"{(k - chosen[0]) * h:.1f} s")
                    writer.grab_frame()
        finally:
            plt.close(figure)
    return path
