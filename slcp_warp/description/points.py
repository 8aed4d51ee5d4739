"""Points of bodies that terms of a cost are about, and what a cost's weights say of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slcp_warp.kernels.control.cost_points import LINK, POINT
from slcp_warp.kernels.generic.topology import JOINT

from ..inputs.checks import array, instance, shown
from ..inputs.errors import ArgumentError, ArgumentTypeError
from .kinematics import joint_pose, turn
from .names import index_of
from .scene import Scene

AXES = ("x", "y")


@dataclass(frozen=True)
class Point:
    """A point of a body, or of the world.

    Attributes:
        body: its name; None: the world.
        at: (x, y) in the frame of the body, whose origin is its joint [m].
    """

    body: str | None = None
    at: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if self.body is not None and not isinstance(self.body, str):
            raise ArgumentTypeError(
                f"Point.body is {shown(self.body)}; the name of a body, or None, is needed"
            )
        x, y = array("Point.at", self.at, (2,)).tolist()
        object.__setattr__(self, "at", (x, y))


def point_numbers(scene: Scene, points: Sequence[Point], start: int) -> list[float]:
    """What weights say of points after their first `start` numbers; see `kernels.control.cost_points`.

    Raises:
        ArgumentError: a body that the scene has not got.
    """
    heads: list[float] = []
    links: list[float] = []
    for point in points:
        chain = _chain(scene, point)
        first = start + POINT * len(points) + len(links)
        heads += [first, len(chain), *point.at]
        for b in chain:
            body, own = scene.bodies[b], scene.structure.bodies[b]
            links += [JOINT[own.joint], own.dofs[0], *body.anchor, body.angle, *body.axis]
    assert len(heads) == POINT * len(points) and len(links) % LINK == 0
    return [*heads, *links]


def _chain(scene: Scene, point: Point) -> list[int]:
    """The bodies from the world on to the one that a point is of."""
    at = -1 if point.body is None else index_of("Point.body", point.body, [b.name for b in scene.bodies])
    chain: list[int] = []
    while at >= 0:
        chain.insert(0, at)
        at = scene.structure.bodies[at].parent
    return chain


def position(scene: Scene, point: Point, states: np.ndarray) -> np.ndarray:
    """Where a point of a scene's bodies is, (..., 2) [m], by the scene's own lengths.

    Args:
        scene: whose bodies they are.
        point: which one.
        states: (..., 2 nv) of the scene.

    Raises:
        ArgumentError: a body that the scene has not got, or states of another one.
    """
    instance("scene", scene, Scene, "a slcp_warp.Scene")
    instance("point", point, Point, "a costs.Point")
    states = array("states", states, finite=False)
    if states.shape[-1:] != (2 * scene.nv,):
        raise ArgumentError(f"states has shape {states.shape}; (..., {2 * scene.nv}) is needed")
    q, numbers = states[..., : scene.nv], scene.default_parameters()
    angle, place = np.zeros(q.shape[:-1]), np.zeros((*q.shape[:-1], 2))
    for b in _chain(scene, point):
        local, then = joint_pose(scene.structure.bodies[b], b, numbers, q, angle)
        place, angle = place + turn(angle, local), then
    return place + turn(angle, np.broadcast_to(point.at, place.shape))


def check_axis(label: str, axis: object) -> None:
    """Raise an error for what is neither "x", "y" nor None."""
    if axis is not None and not (isinstance(axis, str) and axis in AXES):
        raise ArgumentError(f"{label} is {shown(axis)}; 'x', 'y' or None, for both, is needed")
