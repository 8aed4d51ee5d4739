"""Mechanical energy of states: of what moves, of what is lifted, of what is stretched."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from slcp_warp.kernels.gradients.generic.spans import TAIL

from ..description.kinematics import across, joint_pose, slides, turn
from ..inputs.arrays import kind_of, to_numpy
from ..inputs.checks import array, instance
from ..inputs.errors import ArgumentError
from ..parameters import Parameters


@dataclass(frozen=True)
class Energies:
    """Energies of states, arrays (...) as these are, in float64 [J].

    Attributes:
        kinetic: v' M(q) v / 2, of bodies and of joints' armature.
        potential: -m g . c of all centres of mass c; zero where these are at the world's origin.
        elastic: of springs of joints, springs between points and tendons, k (l - L)^2 / 2.
    """

    kinetic: np.ndarray
    potential: np.ndarray
    elastic: np.ndarray

    @property
    def total(self) -> np.ndarray:
        """The sum of all."""
        return self.kinetic + self.potential + self.elastic


def energies(states: Any, params: Parameters) -> Energies:
    """The mechanical energy of states, in plain NumPy.

    What contacts and dampers take, and what motors and disturbances do, is what changes `total`; so does the
    integrator, whose own part vanishes with the step size.

    Args:
        states: (..., 2 nv) of the scene that the parameters are of; where these are of worlds, of as many
            worlds in the first axis.
        params: as of `Simulator.params` or `Trajectory.params`.

    Raises:
        ArgumentError: states of another shape, or not as many worlds.
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
    return _Bodies(scene.structure, numbers, x[..., : scene.nv], x[..., scene.nv :]).energies()


def _beside(params: Parameters, name: str, value: np.ndarray, axes: int) -> np.ndarray:
    """A number's worlds, if it has some, as the first of as many axes as states have before their last."""
    own = params.layout.shape(name)
    if value.ndim == len(own):
        return value
    return value.reshape((len(value), *(1,) * (axes - 2), *own))


class _Bodies:
    """Where bodies are, and how they move."""

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

    def energies(self) -> Energies:
        kinetic, potential = np.zeros(self.q.shape[:-1]), np.zeros(self.q.shape[:-1])
        for b in range(len(self.structure.bodies)):
            centre, speed = self.at(b, self.p["com"][..., b, :])
            mass = self.p["mass"][..., b]
            inertia = self.p["inertia"][..., b] * self.rate[b] ** 2
            kinetic += 0.5 * (mass * np.sum(speed**2, -1) + inertia)
            potential -= mass * np.sum(self.p["gravity"] * centre, -1)
        if self.structure.armature:
            kinetic += 0.5 * np.sum(self.p["armature"] * self.v**2, -1)
        return Energies(kinetic, potential, self.stretched())

    def stretched(self) -> np.ndarray:
        """The energy of all that is elastic."""
        out = np.zeros(self.q.shape[:-1])
        if self.structure.sprung:
            out += 0.5 * np.sum(self.p["stiffness"] * (self.q - self.p["rest"]) ** 2, -1)
        for i, (a, b) in enumerate(self.structure.springs):
            ends, rest = self.p["spring_point"][..., i, :, :], self.p["spring_length"][..., i]
            span = self.at(b, ends[..., 1, :])[0] - self.at(a, ends[..., 0, :])[0]
            length = np.sqrt(np.sum(span**2, -1) + (TAIL[0] * rest + TAIL[1]) ** 2)
            out += 0.5 * self.p["spring_stiffness"][..., i] * (length - rest) ** 2
        start = 0
        for i, dofs in enumerate(self.structure.tendons):
            shares = self.p["tendon_coefficient"][..., start : start + len(dofs)]
            start += len(dofs)
            length = np.sum(shares * self.q[..., list(dofs)], -1) - self.p["tendon_length"][..., i]
            out += 0.5 * self.p["tendon_stiffness"][..., i] * length**2
        return out
