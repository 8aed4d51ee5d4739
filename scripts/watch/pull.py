"""The mouse's spring: from a point of a body to the cursor, as an external force of the step."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from slcp_warp.description.kinematics import turn
from slcp_warp.results.pictures.mechanism import Mechanism

REACH = 0.15  # of the picture's height: how far beside a body it is still caught
HERTZ = 2.0  # of the spring with the body's own mass
ITERATIONS = 6
PROBE = 1e-3  # m: the spring's force at this length, by which its effect is felt

Move = Callable[[np.ndarray], np.ndarray]  # forces (3, bodies, 3) -> positions (3, nv) after a step


@dataclass
class Pull:
    """A spring that is held.

    Attributes:
        world: in which.
        body: which is caught.
        point: where, in the body's frame [m].
        target: where the cursor is [m].
        stiffness: [N/m]; the damping is critical for the body's mass.
        most: the largest force [N].
        force: of the last step [N], (2,).
    """

    world: int
    body: int
    point: np.ndarray
    target: np.ndarray
    stiffness: float
    damping: float
    most: float
    force: np.ndarray = field(default_factory=lambda: np.zeros(2))

    def advance(self, mechanism: Mechanism, q: np.ndarray, step_size: float, move: Move) -> np.ndarray:
        """The force and torque (bodies, 3) of the next step, at the centre of mass.

        The spring acts where the body will be: F = k (p* - p') - c (p' - p)/h with p' = p'(F) of the step
        itself, contacts included, by Newton's method from the last force, as many iterations as a picture
        has time for. An explicit spring diverges at ordinary steps (k h^2 > m).

        Args:
            mechanism: of the world.
            q: (nv,) positions.
            step_size: h [s].
            move: where three copies of the world go under three sets of forces.
        """
        here = self.where(mechanism, q)
        length = max(self.stiffness * PROBE, 1e-6)
        stiff = self.stiffness + self.damping / step_size
        for _ in range(ITERATIONS):
            probes = self.force + length * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
            wrenches = np.stack([self.wrench(mechanism, q, f) for f in probes])
            after = np.stack([self.where(mechanism, q_next) for q_next in move(wrenches)])
            effect = (after[1:] - after[0]).T / length  # dp'/dF
            wanted = self.stiffness * (self.target - after[0]) - self.damping * (after[0] - here) / step_size
            if np.linalg.norm(wanted - self.force) < length:
                break
            force = self.force + np.linalg.solve(np.eye(2) + stiff * effect, wanted - self.force)
            size = float(np.linalg.norm(force))
            self.force = force * min(1.0, self.most / size) if 0.0 < size < np.inf else np.zeros(2)
        return self.wrench(mechanism, q, self.force)

    def where(self, mechanism: Mechanism, q: np.ndarray) -> np.ndarray:
        """The caught point (2,) [m]."""
        origin, angle = mechanism.frames(q[None])
        return np.asarray(origin[0, self.body] + turn(angle[0, self.body], self.point))

    def wrench(self, mechanism: Mechanism, q: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(bodies, 3): force at the caught point as force and torque at the centre of mass."""
        return wrench(mechanism, q, self.body, self.point, force)


def wrench(
    mechanism: Mechanism, q: np.ndarray, body: int, point: np.ndarray, force: np.ndarray
) -> np.ndarray:
    """(bodies, 3): force and torque at the centres of mass.

    Args:
        mechanism: of the world.
        q: (nv,) positions.
        body: which the force acts on.
        point: where, in its frame [m].
        force: (2,) in the directions of the world [N].
    """
    _, angle = mechanism.frames(q[None])
    arm = turn(angle[0, body], point - mechanism.params["com"][body])
    out = np.zeros((mechanism.scene.structure.nb, 3))
    out[body] = *force, arm[0] * force[1] - arm[1] * force[0]
    return out


def catch(mechanism: Mechanism, q: np.ndarray, at: np.ndarray, height: float, world: int = 0) -> Pull | None:
    """The spring of a body at a point of the picture, or the nearest within reach; None: nothing there.

    Args:
        mechanism: of the world.
        q: (nv,) positions.
        at: (2,) the point [m].
        height: of the picture [m].
        world: which.
    """
    centre, angle = mechanism.shapes(q[None])
    best, body = REACH * height, -1
    for s, shape in enumerate(mechanism.scene.structure.shapes):
        if shape.body >= 0 and shape.kind != "halfplane" and s not in mechanism.ropes:
            away = _distance(shape.kind, mechanism.size(s), turn(-angle[0, s], at - centre[0, s]))
            best, body = (away, shape.body) if away < best else (best, body)
    origin, turned = mechanism.frames(q[None])
    for b in range(mechanism.scene.structure.nb):  # bodies that have no shape of their own
        middle = origin[0, b] + turn(turned[0, b], mechanism.params["com"][b])
        away = float(np.linalg.norm(at - middle))
        best, body = (away, b) if away < best else (best, body)
    if body < 0:
        return None
    point = turn(-turned[0, body], at - origin[0, body])
    mass = float(mechanism.params["mass"][body])
    stiffness = mass * (2.0 * np.pi * HERTZ) ** 2
    damping, most = 2.0 * np.sqrt(stiffness * mass), stiffness * max(height, 1e-3)
    return Pull(world, body, point, np.array(at, float), stiffness, float(damping), float(most))


def _distance(kind: str, size: np.ndarray, local: np.ndarray) -> float:
    """How far a point of a shape's own axes is from it; negative inside (of an ellipse, nearly)."""
    if kind == "capsule":
        along = np.clip(local[0], -size[1], size[1])
        return float(np.hypot(local[0] - along, local[1]) - size[0])
    if kind == "rectangle":
        over = np.abs(local) - size[:2] + size[2]
        return float(np.linalg.norm(np.maximum(over, 0.0)) + min(over.max(), 0.0) - size[2])
    if kind == "ring":
        return float(abs(np.linalg.norm(local) - size[0]))
    size = np.maximum(size, 1e-3)
    level = float(np.linalg.norm(local / size))
    return (level - 1.0) * float(size.min())
