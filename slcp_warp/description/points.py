"""Points of bodies, and centres of mass, that costs and measures are about, and what weights say of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from slcp_warp.kernels.control.cost_points import LINK, PART, POINT
from slcp_warp.kernels.generic.topology import JOINT

from ..inputs.checks import array, instance, shown
from ..inputs.errors import ArgumentError, ArgumentTypeError
from .kinematics import joint_pose, turn
from .names import index_of
from .scene import Scene

AXES = ("x", "y")
CENTRE: Literal["centre of mass"] = "centre of mass"


@dataclass(frozen=True)
class Point:
    """A point of a body, or of the world; or the centre of mass of one body or several.

    Attributes:
        body: its name; of a centre of mass several, too. None: the world; of a centre of mass all bodies.
        at: (x, y) in the frame of the body, whose origin is its joint [m]; or "centre of mass".
    """

    body: str | tuple[str, ...] | None = None
    at: tuple[float, float] | Literal["centre of mass"] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if isinstance(self.at, str):
            if self.at != CENTRE:
                raise ArgumentError(f"Point.at is {shown(self.at)}; (x, y), or {CENTRE!r}, is needed")
            if isinstance(self.body, list | tuple):
                object.__setattr__(self, "body", self._several(tuple(self.body)))
                return
        else:
            x, y = array("Point.at", self.at, (2,)).tolist()
            object.__setattr__(self, "at", (x, y))
        if self.body is not None and not isinstance(self.body, str):
            more = ", or several of them," if self.of_mass else ""
            raise ArgumentTypeError(
                f"Point.body is {shown(self.body)}; the name of a body{more} or None, is needed"
            )

    @staticmethod
    def _several(names: tuple[object, ...]) -> tuple[str, ...]:
        if not names or not all(isinstance(name, str) for name in names):
            raise ArgumentTypeError(f"Point.body is {shown(names)}; names of bodies are needed")
        if len(set(names)) < len(names):
            raise ArgumentError(f"Point.body is {shown(names)}; each body once is needed")
        return tuple(str(name) for name in names)

    @property
    def of_mass(self) -> bool:
        """Whether it is a centre of mass."""
        return self.at == CENTRE


def centre_of_mass(*bodies: str) -> Point:
    """The centre of mass of bodies by their names, none: of all of them; masses are the scene's own."""
    return Point(bodies or None, CENTRE)


def _parts(scene: Scene, point: Point, numbers: Mapping[str, Any]) -> list[tuple[Any, int, Any]]:
    """Points of bodies that a point is the weighed sum of: weight, body (-1: the world), place in it.

    Raises:
        ArgumentError: a body that the scene has not got.
    """
    names = [body.name for body in scene.bodies]
    if not point.of_mass:
        assert not isinstance(point.at, str)
        at = -1 if point.body is None else index_of("Point.body", point.body, names)  # type: ignore[arg-type]
        return [(1.0, at, point.at)]
    chosen = (point.body,) if isinstance(point.body, str) else point.body or names
    places = [index_of("Point.body", name, names) for name in chosen]
    mass, com = numbers["mass"], numbers["com"]
    whole = mass[..., places].sum(axis=-1)
    return [(mass[..., b] / whole, b, com[..., b, :]) for b in places]


def point_numbers(scene: Scene, points: Sequence[Point], start: int) -> list[float]:
    """What weights say of points after their first `start` numbers; see `kernels.control.cost_points`.

    Raises:
        ArgumentError: a body that the scene has not got.
    """
    numbers = scene.default_parameters()
    every = [_parts(scene, point, numbers) for point in points]
    first = start + POINT * len(points)
    link = first + PART * sum(len(parts) for parts in every)
    heads: list[float] = []
    listed: list[float] = []
    links: list[float] = []
    for parts in every:
        heads += [first + len(listed), len(parts)]
        for weight, b, at in parts:
            chain = _chain(scene, b)
            listed += [weight, link + len(links), len(chain), *at]
            for up in chain:
                body, own = scene.bodies[up], scene.structure.bodies[up]
                links += [JOINT[own.joint], own.dofs[0], *body.anchor, body.angle, *body.axis]
    assert len(heads) == POINT * len(points) and len(links) % LINK == 0 and len(listed) % PART == 0
    return [*heads, *listed, *links]


def _chain(scene: Scene, body: int) -> list[int]:
    """The bodies from the world on to this one."""
    chain: list[int] = []
    while body >= 0:
        chain.insert(0, body)
        body = scene.structure.bodies[body].parent
    return chain


def position(
    scene: Scene, point: Point, states: np.ndarray, numbers: Mapping[str, np.ndarray] | None = None
) -> np.ndarray:
    """Where a point of a scene's bodies, or a centre of mass, is, (..., 2) [m].

    Args:
        scene: whose bodies they are.
        point: which one.
        states: (..., 2 nv) of the scene.
        numbers: lengths, angles and masses by parameter name, as they are or with the axes of the states in
            front; None: the scene's own.

    Raises:
        ArgumentError: a body that the scene has not got, or states of another one.
    """
    instance("scene", scene, Scene, "a slcp_warp.Scene")
    instance("point", point, Point, "a costs.Point")
    states = array("states", states, finite=False)
    if states.shape[-1:] != (2 * scene.nv,):
        raise ArgumentError(f"states has shape {states.shape}; (..., {2 * scene.nv}) is needed")
    q, out = states[..., : scene.nv], np.zeros((*states.shape[:-1], 2))
    found = scene.default_parameters() if numbers is None else numbers
    for weight, body, at in _parts(scene, point, found):
        out = out + np.asarray(weight)[..., None] * _place(scene, body, at, q, found)
    return out


def _place(scene: Scene, body: int, at: Any, q: np.ndarray, numbers: Mapping[str, Any]) -> np.ndarray:
    """Where a point of a body is."""
    angle, place = np.zeros(q.shape[:-1]), np.zeros((*q.shape[:-1], 2))
    for b in _chain(scene, body):
        local, then = joint_pose(scene.structure.bodies[b], b, numbers, q, angle)
        place, angle = place + turn(angle, local), then
    return place + turn(angle, np.broadcast_to(at, place.shape))


def check_axis(label: str, axis: object) -> None:
    """Raise an error for what is neither "x", "y" nor None."""
    if axis is not None and not (isinstance(axis, str) and axis in AXES):
        raise ArgumentError(f"{label} is {shown(axis)}; 'x', 'y' or None, for both, is needed")
