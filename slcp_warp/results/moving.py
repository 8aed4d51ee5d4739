"""Where bodies are and how they move, in plain NumPy."""

from typing import Any

import numpy as np

from ..description.kinematics import across, joint_pose, slides, turn
from ..inputs.arrays import kind_of, to_numpy
from ..inputs.checks import array, flag, instance
from ..inputs.errors import ArgumentError
from ..parameters import Parameters


class MovingBodies:
    """Where bodies are, and how they move.

    Attributes:
        place, speed, angle, rate: of every body's frame, by its index; the world is -1.
    """

    def __init__(self, structure: Any, numbers: dict[str, np.ndarray], q: np.ndarray, v: np.ndarray) -> None:
        self.structure, self.p, self.q, self.v = structure, numbers, q, v
        none = np.zeros((*q.shape[:-1], 2))
        self.place, self.speed = {-1: none}, {-1: none}
        self.angle, self.rate = {-1: none[..., 0]}, {-1: none[..., 0]}
        for b, body in enumerate(structure.bodies):
            up = body.parent
            local, self.angle[b] = joint_pose(body, b, numbers, q, self.angle[up])
            arm = turn(self.angle[up], local)
            slid = none + 0.0
            for j, axis in slides(body, b, numbers).items():
                slid = slid + axis * v[..., j, None]
            self.place[b] = self.place[up] + arm
            slide = turn(self.angle[up], slid)
            self.speed[b] = self.speed[up] + self.rate[up][..., None] * across(arm) + slide
            turns = 0.0 if body.joint == "prismatic" else v[..., body.dofs[-1]]
            self.rate[b] = self.rate[up] + turns

    def at(self, body: int, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Place and velocity of a point of a body."""
        arm = turn(self.angle[body], local + 0.0 * self.place[body])
        return self.place[body] + arm, self.speed[body] + self.rate[body][..., None] * across(arm)

    def velocity(self, body: int, place: np.ndarray) -> np.ndarray:
        """Velocity of what a body has at a place in the world."""
        return self.speed[body] + self.rate[body][..., None] * across(place - self.place[body])


def moving_bodies(states: Any, params: Parameters, staggered: bool = False) -> MovingBodies:
    """The bodies of the scene that parameters are of, in its states (..., 2 nv); where parameters are of
    worlds, of as many in the first axis; `staggered`: where they were half a step before.

    Raises:
        ArgumentError: states of another shape, or not as many worlds.
        ArgumentTypeError: staggered is no truth value.
    """
    scene = instance("params", params, Parameters, "slcp_warp.Parameters").scene
    x = array("states", states if kind_of(states) == "numpy" else to_numpy(states), finite=False)
    if x.shape[-1:] != (2 * scene.nv,):
        raise ArgumentError(f"states has shape {x.shape}; (..., {2 * scene.nv}) is needed")
    numbers = {name: np.asarray(params[name], float) for name in params.names}
    if params.worlds is not None:
        if x.ndim < 2 or x.shape[0] != params.worlds:
            raise ArgumentError(f"states has shape {x.shape}; params are of {params.worlds} worlds")
        numbers = {name: _beside(params, name, value, x.ndim) for name, value in numbers.items()}
    q, v = x[..., : scene.nv], x[..., scene.nv :]
    if flag("staggered", staggered):
        q = q - 0.5 * numbers["step_size"][..., None] * v
    return MovingBodies(scene.structure, numbers, q, v)


def _beside(params: Parameters, name: str, value: np.ndarray, axes: int) -> np.ndarray:
    """A number's worlds, if it has some, as the first of as many axes as states have before their last."""
    own = params.layout.shape(name)
    if value.ndim == len(own):
        return value
    return value.reshape((len(value), *(1,) * (axes - 2), *own))
