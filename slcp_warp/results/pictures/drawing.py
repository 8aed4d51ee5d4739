"""Drawing a planar mechanism with matplotlib."""

from typing import Any

import numpy as np

from ...description.kinematics import turn
from .mechanism import EXTENT, Mechanism, outline
from .style import BLACK, BLUE, GREY, ORANGE, SKY, Axes, Polygon

EDGE = 1.2


class Drawing:
    """A mechanism on an axes; `update` moves it. A ghost is pale and has no world around it."""

    def __init__(self, ax: Axes, mechanism: Mechanism, q: np.ndarray, ghost: bool = False) -> None:
        self.mechanism = mechanism
        structure = mechanism.scene.structure
        ax.set_aspect("equal")
        ax.grid(False)
        alpha = 0.22 if ghost else 1.0
        self.driven = structure.driven_bodies
        self.patches: list[Any] = []
        self.outlines: list[np.ndarray] = []
        for s, shape in enumerate(structure.shapes):
            face = self._colour(shape.body) if shape.body >= 0 else GREY
            order = 1 if shape.kind == "halfplane" else 2
            patch: Any = Polygon(
                np.zeros((3, 2)), facecolor=face, edgecolor=BLACK, linewidth=EDGE, zorder=order, alpha=alpha,
                visible=not (ghost and shape.body < 0) and s not in mechanism.ropes,
            )  # fmt: skip
            ax.add_patch(patch)
            self.patches.append(patch)
            width = self._width(shape.body) if shape.body >= 0 and shape.kind == "halfplane" else EXTENT
            self.outlines.append(outline(shape.kind, mechanism.size(s), width))
        style: Any = {"edgecolor": BLACK, "linewidth": EDGE, "zorder": 1.5, "alpha": alpha}
        self.hulls: dict[int, Any] = {
            b: ax.add_patch(Polygon(corners, facecolor=self._colour(b), **style))
            for b, corners in mechanism.hulls(q).items()
        }
        pale: Any = {"alpha": alpha, "solid_capstyle": "round"}
        self.links = [
            ax.plot([], [], color=BLACK, lw=2.0, zorder=1.8, **pale)[0] for _ in mechanism.links(q[None])
        ]
        self.springs = [ax.plot([], [], color=BLUE, lw=1.0, zorder=3, **pale)[0] for _ in structure.springs]
        (self.pins,) = ax.plot([], [], "o", color=BLACK, markersize=3.5, zorder=4, alpha=alpha)
        # The first axes, so that turning shapes are seen to turn.
        self.axes = [ax.plot([], [], color=BLUE, lw=0.9, zorder=3, alpha=alpha)[0] for _ in self.patches]
        self.update(q)

    def _colour(self, body: int) -> str:
        return SKY if body in self.driven else ORANGE

    def _width(self, body: int) -> float:
        """Half the width of a face that is drawn for a half-plane on a body: as far as its shapes reach."""
        own = [s for s, sh in enumerate(self.mechanism.scene.structure.shapes) if sh.body == body]
        reach = np.abs(self.mechanism.params["shape_offset"][own]).max(initial=0.0)
        return float(max(reach, 0.1))

    def update(self, q: np.ndarray, faces: dict[int, Any] | None = None) -> None:
        """Move to q (nv,), and paint shapes by index."""
        mechanism = self.mechanism
        centre, angle = mechanism.shapes(q[None])
        joints = mechanism.joints(q[None])[0]
        self.pins.set_data(joints[:, 0], joints[:, 1])
        for line, link in zip(self.links, mechanism.links(q[None])):
            line.set_data(link[0, :, 0], link[0, :, 1])
        for line, zigzag in zip(self.springs, mechanism.springs(q)):
            line.set_data(zigzag[:, 0], zigzag[:, 1])
        for b, corners in mechanism.hulls(q).items():
            self.hulls[b].set_xy(corners)
        for s, patch in enumerate(self.patches):
            corners = self.outlines[s]
            patch.set_xy(centre[0, s] + turn(angle[0, s], corners))
            if mechanism.scene.structure.shapes[s].kind in ("disc", "ellipse"):
                along = np.array([np.cos(angle[0, s]), np.sin(angle[0, s])])
                reach = mechanism.params["radius"][s][0] * along
                ends = np.stack([centre[0, s] - reach, centre[0, s] + reach])
                self.axes[s].set_data(ends[:, 0], ends[:, 1])
            if faces and s in faces:
                patch.set_facecolor(faces[s])


def view(ax: Axes, bounds: tuple[float, float, float, float]) -> None:
    """Set the window (left, right, bottom, top) without ticks."""
    ax.set_xlim(*bounds[:2])
    ax.set_ylim(*bounds[2:])
    ax.set_xticks([])
    ax.set_yticks([])
    for spine in ax.spines.values():
        spine.set_visible(False)


def square(bounds: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """The window widened to a square around its middle."""
    left, right, bottom, top = bounds
    half = max(right - left, top - bottom) / 2.0
    x, y = (left + right) / 2.0, (bottom + top) / 2.0
    return x - half, x + half, y - half, y + half
