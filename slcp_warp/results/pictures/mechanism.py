"""Where a planar mechanism's shapes, links and springs are at given coordinates, in plain NumPy."""

import functools
from dataclasses import dataclass

import numpy as np

from ...description.kinematics import joint_pose, turn
from ...description.scene import Scene
from .motion import Motion

EXTENT = 100.0  # half-planes are drawn this wide
POINT = 0.008  # points are drawn with this radius [m]
RIM = 0.06  # of a ring is drawn as wide [its radius]
HULL = 3  # discs of a body from which its outline is drawn


@dataclass(frozen=True)
class Mechanism:
    """What is drawn: a scene with the numbers of one world.

    Attributes:
        scene: topology.
        params: value of every parameter by name, without a world axis.
    """

    scene: Scene
    params: dict[str, np.ndarray]

    @classmethod
    def of(cls, motion: Motion) -> "Mechanism":
        """The mechanism that moves."""
        return cls(motion.scene, motion.numbers)

    def frames(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Origin (T, nb, 2) [m] and angle (T, nb) [rad] of every body's frame at q (T, nv)."""
        bodies = self.scene.structure.bodies
        origin, angle = np.zeros((len(q), len(bodies), 2)), np.zeros((len(q), len(bodies)))
        for b, body in enumerate(bodies):
            base, at = np.zeros(len(q)), np.zeros((len(q), 2))
            if body.parent >= 0:
                base, at = angle[:, body.parent], origin[:, body.parent]
            local, angle[:, b] = joint_pose(body, b, self.params, q, base)
            origin[:, b] = at + turn(base, local)
        return origin, angle

    def shapes(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Centre (T, ns, 2) [m] and angle (T, ns) [rad] of every shape at q (T, nv)."""
        origin, angle = self.frames(q)
        centre = np.zeros((len(q), len(self.scene.structure.shapes), 2))
        angles = np.tile(self.params["shape_angle"], (len(q), 1))
        for s, shape in enumerate(self.scene.structure.shapes):
            offset = np.tile(self.params["shape_offset"][s], (len(q), 1))
            if shape.body >= 0:
                angles[:, s] += angle[:, shape.body]
                offset = origin[:, shape.body] + turn(angle[:, shape.body], offset)
            centre[:, s] = offset
        return centre, angles

    @functools.cached_property
    def ropes(self) -> dict[int, int]:
        """Rings that hold in nothing but a point, without friction, by the shape of that point."""
        structure, found = self.scene.structure, dict[int, list[int]]()
        for pair in structure.pairs:
            for ring, other in ((pair.shape_a, pair.shape_b), (pair.shape_b, pair.shape_a)):
                if structure.shapes[ring].kind == "ring":
                    point = structure.shapes[other].kind == "disc" and not self.params["radius"][other].any()
                    found.setdefault(ring, []).append(other if point and not pair.friction else -1)
        return {ring: others[0] for ring, others in found.items() if len(others) == 1 and others[0] >= 0}

    def links(self, q: np.ndarray) -> list[np.ndarray]:
        """Lines (T, 2, 2) that show how bodies hang together: from joint to joint, to shapes, or to the
        tip of a body that has neither; and ropes.
        """
        origin, angle = self.frames(q)
        centre, _ = self.shapes(q)
        structure, lines = self.scene.structure, []
        for b, body in enumerate(structure.bodies):
            ends = [origin[:, i] for i, other in enumerate(structure.bodies) if other.parent == b]
            own = [
                s
                for s, shape in enumerate(structure.shapes)
                if shape.body == b and shape.kind != "halfplane" and s not in self.ropes
            ]
            if len(own) < HULL and (ends or body.joint != "free"):
                ends += [centre[:, s] for s in own]
            if not ends and not own:
                com = np.tile(self.params["com"][b], (len(q), 1))
                ends = [origin[:, b] + 2.0 * turn(angle[:, b], com)]  # a uniform rod's tip
            lines += [np.stack([origin[:, b], end], axis=1) for end in ends]
        lines += [np.stack([centre[:, a], centre[:, b]], axis=1) for a, b in self.ropes.items()]
        return lines

    def hulls(self, q: np.ndarray) -> dict[int, np.ndarray]:
        """Corners (n, 2) of the bodies that have at least three discs, by body, at q (nv,)."""
        centre, _ = self.shapes(q[None])
        out = {}
        for b in range(self.scene.structure.nb):
            discs = [
                s for s, sh in enumerate(self.scene.structure.shapes) if sh.body == b and sh.kind == "disc"
            ]
            if len(discs) >= HULL:
                corners = centre[0, discs] - centre[0, discs].mean(axis=0)
                out[b] = centre[0, discs][np.argsort(np.arctan2(corners[:, 1], corners[:, 0]))]
        return out

    def springs(self, q: np.ndarray) -> list[np.ndarray]:
        """Zigzag lines (n, 2) of the springs at q (nv,)."""
        origin, angle = self.frames(q[None])
        lines = []
        for i, pair in enumerate(self.scene.structure.springs):
            ends = []
            for body, point in zip(pair, self.params["spring_point"][i]):
                here = point[None] if body < 0 else origin[:, body] + turn(angle[:, body], point[None])
                ends.append(here[0])
            along = ends[1] - ends[0]
            across = np.array([-along[1], along[0]]) * 0.06
            share = np.array([0.0, *np.linspace(0.2, 0.8, 9), 1.0])
            side = np.array([0.0, 0.0, *([1.0, -1.0] * 3), 1.0, 0.0, 0.0])
            lines.append(ends[0] + share[:, None] * along + side[:, None] * across)
        return lines

    def size(self, s: int) -> np.ndarray:
        """Radii of a shape; of a rectangle its half sizes and corner radius."""
        rounded = self.scene.structure.shapes[s].kind == "rectangle"
        return np.append(self.params["radius"][s], self.params["corner_radius"][s] if rounded else ())

    def joints(self, q: np.ndarray) -> np.ndarray:
        """Positions (T, n, 2) of the revolute joints."""
        chosen = [b for b, body in enumerate(self.scene.structure.bodies) if body.joint == "revolute"]
        return self.frames(q)[0][:, chosen]

    def bounds(self, q: np.ndarray, margin: float = 0.06) -> tuple[float, float, float, float]:
        """Left, right, bottom and top [m] of the mechanism over time, half-planes left out; around it a
        margin, a share of the larger of width and height.
        """
        centre, _ = self.shapes(q)
        structure = self.scene.structure
        points = [line.reshape(-1, 2) for line in self.links(q)]
        for s, shape in enumerate(structure.shapes):
            if shape.kind != "halfplane" and s not in self.ropes:
                radius = self.params["radius"][s]
                reach = {"capsule": radius.sum(), "rectangle": np.hypot(*radius)}.get(
                    shape.kind, radius.max()
                )
                points += [centre[:, s] - reach, centre[:, s] + reach]
        low, high = np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)
        room = margin * (float((high - low).max()) or 1.0)
        low, high = low - room, high + room
        return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def outline(kind: str, size: np.ndarray, plane: float) -> np.ndarray:
    """Corners (n, 2) of a shape in its own axes; a half-plane's face is `plane` wide either side.

    `size` is that of `Mechanism.size`.
    """
    if kind == "halfplane":
        depth = EXTENT if plane == EXTENT else 0.06 * plane
        return np.array([[0.0, plane], [0.0, -plane], [-depth, -plane], [-depth, plane]])
    turn = np.linspace(-np.pi / 2, np.pi / 2, 25)
    if kind == "capsule":
        right = np.stack([size[1] + size[0] * np.cos(turn), size[0] * np.sin(turn)], axis=1)
        return np.concatenate([right, -right])
    if kind == "rectangle":
        turn = np.linspace(0.0, np.pi / 2, 9)
        core = np.maximum(size[:2] - size[2], 0.0)
        first = core + size[2] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        mirrored = first[::-1] * [-1.0, 1.0]
        return np.concatenate([first, mirrored, -first, -mirrored])
    if kind == "ring":
        turn = np.linspace(0.0, 2.0 * np.pi, 97)
        inside = size[0] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        return np.concatenate([inside, (1.0 + RIM) * inside[::-1]])
    size = np.maximum(size, POINT)
    turn = np.linspace(0.0, 2.0 * np.pi, 49)
    return np.stack([size[0] * np.cos(turn), size[1] * np.sin(turn)], axis=1)
