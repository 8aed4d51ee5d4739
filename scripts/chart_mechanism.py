"""Drawing a planar mechanism: where its shapes are at given coordinates, and what they look like."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse, Polygon

import slcp_warp as slcp

from .chart_style import BLACK, BLUE, GREY, ORANGE, SKY
from .common import named_scene
from .records import Record

EXTENT = 100.0  # half-planes are drawn this wide
EDGE = 1.2


@dataclass(frozen=True)
class Mechanism:
    """What is drawn: a scene with the numbers of one world.

    Attributes:
        scene: topology. params: value of every parameter by name, without a world axis.
    """

    scene: slcp.Scene
    params: dict[str, np.ndarray]

    @classmethod
    def of(cls, record: Record, world: int = 0) -> "Mechanism":
        """The mechanism of a world of a trajectory file."""
        scene = named_scene(record.header["scene"])
        own = slcp.Parameters(scene)
        values = {}
        for name in own.names:
            value = record[f"param_{name}"]
            values[name] = value[world] if value.ndim > own[name].ndim else value
        return cls(scene, values)

    def frames(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Origin (T, nb, 2) [m] and angle (T, nb) [rad] of every body's frame at q (T, nv)."""
        bodies = self.scene.structure.bodies
        origin, angle = np.zeros((len(q), len(bodies), 2)), np.zeros((len(q), len(bodies)))
        for b, body in enumerate(bodies):
            own = q[:, list(body.dofs)]
            base, turn = np.zeros((len(q), 2)), np.zeros(len(q))
            if body.parent >= 0:
                base, turn = origin[:, body.parent], angle[:, body.parent]
            place = np.tile(self.params["anchor"][b], (len(q), 1))
            if body.joint == "prismatic":
                place = place + own * self.params["axis"][b]
            elif body.joint == "free":
                place = place + own[:, :2]
            origin[:, b] = base + turned(place, turn)
            angle[:, b] = turn + self.params["angle"][b] + (0.0 if body.joint == "prismatic" else own[:, -1])
        return origin, angle

    def shapes(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Centre (T, ns, 2) [m] and angle (T, ns) [rad] of every shape at q (T, nv)."""
        origin, angle = self.frames(q)
        centre = np.zeros((len(q), len(self.scene.structure.shapes), 2))
        turn = np.tile(self.params["shape_angle"], (len(q), 1))
        for s, shape in enumerate(self.scene.structure.shapes):
            offset = np.tile(self.params["shape_offset"][s], (len(q), 1))
            if shape.body >= 0:
                turn[:, s] += angle[:, shape.body]
                offset = origin[:, shape.body] + turned(offset, angle[:, shape.body])
            centre[:, s] = offset
        return centre, turn

    def joints(self, q: np.ndarray) -> np.ndarray:
        """Positions (T, n, 2) of the revolute joints."""
        chosen = [b for b, body in enumerate(self.scene.structure.bodies) if body.joint == "revolute"]
        return self.frames(q)[0][:, chosen]

    def bounds(self, q: np.ndarray, margin: float = 0.2) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of all shapes over time, half-planes left out."""
        centre, _ = self.shapes(q)
        round_ = [s for s, shape in enumerate(self.scene.structure.shapes) if shape.kind != "halfplane"]
        reach = self.params["radius"][round_].max(axis=1)[None, :, None] + margin
        low, high = (centre[:, round_] - reach).min((0, 1)), (centre[:, round_] + reach).max((0, 1))
        return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def turned(vectors: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Vectors (T, 2) turned by angles (T,)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * vectors[:, 0] - s * vectors[:, 1], s * vectors[:, 0] + c * vectors[:, 1]], axis=-1)


class Drawing:
    """A mechanism on an axes; `update` moves its patches."""

    def __init__(self, ax: Axes, mechanism: Mechanism, q: np.ndarray) -> None:
        self.mechanism = mechanism
        ax.set_aspect("equal")
        ax.grid(False)
        self.patches: list[Any] = []
        driven = {mechanism.scene.structure.dof_body[d] for d in mechanism.scene.structure.actuators}
        for s, shape in enumerate(mechanism.scene.structure.shapes):
            face = SKY if shape.body in driven else ORANGE if shape.body >= 0 else GREY
            style: dict[str, Any] = {"facecolor": face, "edgecolor": BLACK, "linewidth": EDGE, "zorder": 2}
            if shape.kind == "halfplane":
                patch: Any = Polygon(np.zeros((4, 2)), **(style | {"zorder": 1}))
            else:
                diameter = 2.0 * mechanism.params["radius"][s]
                patch = Ellipse((0.0, 0.0), diameter[0], diameter[1], **style)
            self.patches.append(ax.add_patch(patch))
        (self.pins,) = ax.plot([], [], "o", color=BLACK, markersize=3.5, zorder=4)
        # The major axes, so that turning shapes are seen to turn.
        self.axes = [ax.plot([], [], color=BLUE, lw=0.9, zorder=3)[0] for _ in self.patches]
        self.update(q)

    def update(self, q: np.ndarray, faces: dict[int, Any] | None = None) -> None:
        """Move to q (nv,), and paint shapes by index."""
        centre, angle = self.mechanism.shapes(q[None])
        joints = self.mechanism.joints(q[None])[0]
        self.pins.set_data(joints[:, 0], joints[:, 1])
        for s, patch in enumerate(self.patches):
            along = np.array([np.cos(angle[0, s]), np.sin(angle[0, s])])
            if isinstance(patch, Polygon):
                across = np.array([-along[1], along[0]]) * EXTENT
                near, far = centre[0, s], centre[0, s] - EXTENT * along
                patch.set_xy(np.array([near + across, near - across, far - across, far + across]))
            else:
                patch.set_center(tuple(centre[0, s]))
                patch.set_angle(float(np.degrees(angle[0, s])))
                reach = self.mechanism.params["radius"][s][0] * along
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
