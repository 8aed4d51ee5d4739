"""Mechanical energy of states: of what moves, of what is lifted, of what is stretched."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from slcp_warp.kernels.gradients.generic.spans import TAIL

from ..parameters import Parameters
from ..storage.printed import Arrays
from .moving import MovingBodies, moving_bodies


@dataclass(frozen=True, repr=False)
class Energies(Arrays):
    """Energies of states, arrays (...) as these are, in float64 [J].

    Attributes:
        kinetic: v' M(q) v / 2, of bodies and of joints' armature.
        potential: -m g . c of all centres of mass c; zero where these are at the world's origin.
        elastic: of springs of joints, springs between points and tendons, k (l - L)^2 / 2. With a limit F of
            its force a tendon has F (|l - L| - F/2k) beyond F/k; one that an actuator drives is a motor,
            whose force the control decides, and is left out.
    """

    kinetic: np.ndarray
    potential: np.ndarray
    elastic: np.ndarray

    @property
    def total(self) -> np.ndarray:
        """The sum of all."""
        return self.kinetic + self.potential + self.elastic


def energies(states: Any, params: Parameters, *, staggered: bool = False) -> Energies:
    """The mechanical energy of states, in plain NumPy.

    What contacts and dampers take, and what motors and disturbances do, is what changes `total`; so does the
    integrator, whose own part vanishes with the step size.

    Args:
        states: (..., 2 nv) of the scene that the parameters are of; where these are of worlds, of as many
            worlds in the first axis.
        params: as of `Simulator.params` or `Trajectory.params`.
        staggered: the velocities are those half a step before the places, as a leapfrog's are (M63): the
            energy is that of then, at q - h v/2.

    Raises:
        ArgumentError: states of another shape, or not as many worlds.
        ArgumentTypeError: staggered is no truth value.
    """
    return _energies(moving_bodies(states, params, staggered))


def _energies(bodies: MovingBodies) -> Energies:
    kinetic, potential = np.zeros(bodies.q.shape[:-1]), np.zeros(bodies.q.shape[:-1])
    for b in range(len(bodies.structure.bodies)):
        centre, speed = bodies.at(b, bodies.p["com"][..., b, :])
        mass = bodies.p["mass"][..., b]
        inertia = bodies.p["inertia"][..., b] * bodies.rate[b] ** 2
        kinetic += 0.5 * (mass * np.sum(speed**2, -1) + inertia)
        potential -= mass * np.sum(bodies.p["gravity"] * centre, -1)
    if bodies.structure.armature:
        kinetic += 0.5 * np.sum(bodies.p["armature"] * bodies.v**2, -1)
    return Energies(kinetic, potential, _stretched(bodies))


def _stretched(bodies: MovingBodies) -> np.ndarray:
    """The energy of all that is elastic."""
    out = np.zeros(bodies.q.shape[:-1])
    if bodies.structure.sprung:
        out += 0.5 * np.sum(bodies.p["stiffness"] * (bodies.q - bodies.p["rest"]) ** 2, -1)
    for i, (a, b) in enumerate(bodies.structure.springs):
        ends, rest = bodies.p["spring_point"][..., i, :, :], bodies.p["spring_length"][..., i]
        span = bodies.at(b, ends[..., 1, :])[0] - bodies.at(a, ends[..., 0, :])[0]
        length = np.sqrt(np.sum(span**2, -1) + (TAIL[0] * rest + TAIL[1]) ** 2)
        out += 0.5 * bodies.p["spring_stiffness"][..., i] * (length - rest) ** 2
    s, start = bodies.structure, 0
    driven = {s.driven_tendon(a) for a in range(s.nu)}
    for i, dofs in enumerate(s.tendons):
        shares = bodies.p["tendon_coefficient"][..., start : start + len(dofs)]
        start += len(dofs)
        if i in s.limited and i in driven:
            continue
        stiffness = bodies.p["tendon_stiffness"][..., i]
        force = stiffness * (
            np.sum(shares * bodies.q[..., list(dofs)], -1) - bodies.p["tendon_length"][..., i]
        )
        within = np.abs(force)
        if i in s.limited:
            within = np.minimum(within, bodies.p["tendon_force_limit"][..., i])
        size = np.where(stiffness == 0.0, 1.0, stiffness)
        out += within * (np.abs(force) - 0.5 * within) / size  # of F and k: by |f|, F (|f| - F/2)/k
    return out
