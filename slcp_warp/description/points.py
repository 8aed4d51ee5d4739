"""Points of bodies that terms of a cost are about, and what a cost's weights say of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slcp_warp.kernels.control.cost_points import FREE, LINK, POINT, PRISMATIC, REVOLUTE

from ..inputs.checks import array, instance, shown
from ..inputs.errors import ArgumentError, ArgumentTypeError
from .names import index_of
from .scene import Scene

AXES = ("x", "y")
JOINTS = {"revolute": REVOLUTE, "prismatic": PRISMATIC, "free": FREE}


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
    names = [body.name for body in scene.bodies]
    heads: list[float] = []
    links: list[float] = []
    for point in points:
        chain = []
        at = -1 if point.body is None else index_of("Point.body", point.body, names)
        while at >= 0:
            chain.append(at)
            at = scene.structure.bodies[at].parent
        first = start + POINT * len(points) + len(links)
        heads += [first, len(chain), *point.at]
        for b in reversed(chain):
            body, own = scene.bodies[b], scene.structure.bodies[b]
            links += [JOINTS[own.joint], own.dofs[0], *body.anchor, body.angle, *body.axis]
    assert len(heads) == POINT * len(points) and len(links) % LINK == 0
    return [*heads, *links]


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
    names = [body.name for body in scene.bodies]
    at = -1 if point.body is None else index_of("Point.body", point.body, names)
    states = array("states", states, finite=False)
    if states.shape[-1:] != (2 * scene.nv,):
        raise ArgumentError(f"states has shape {states.shape}; (..., {2 * scene.nv}) is needed")
    place = np.broadcast_to(np.array(point.at), (*states.shape[:-1], 2))
    while at >= 0:  # from the body on to the world
        body, own = scene.bodies[at], scene.structure.bodies[at]
        q = states[..., list(own.dofs)]
        shift = {"revolute": 0.0 * q[..., :1] * np.zeros(2), "prismatic": q[..., :1] * np.array(body.axis),
                 "free": q[..., :2]}[own.joint]  # fmt: skip
        turn = body.angle + (0.0 * q[..., 0] if own.joint == "prismatic" else q[..., -1])
        c, s = np.cos(turn), np.sin(turn)
        x, y = place[..., 0], place[..., 1]
        place = np.array(body.anchor) + shift + np.stack([c * x - s * y, s * x + c * y], -1)
        at = own.parent
    return place


def check_axis(label: str, axis: object) -> None:
    """Raise an error for what is neither "x", "y" nor None."""
    if axis is not None and not (isinstance(axis, str) and axis in AXES):
        raise ArgumentError(f"{label} is {shown(axis)}; 'x', 'y' or None, for both, is needed")
