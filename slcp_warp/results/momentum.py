"""Momentum of states, and where their centre of mass is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..description.kinematics import across
from ..inputs import checks
from ..inputs.errors import ArgumentError
from ..parameters import Parameters
from ..storage.printed import Arrays
from .moving import moving_bodies


@dataclass(frozen=True, repr=False)
class Momentum(Arrays):
    """Momentum of states, arrays (...) as these are, in float64.

    Attributes:
        mass: of all bodies that count [kg].
        place: (..., 2) of their centre of mass [m].
        linear: (..., 2) momentum [kg m/s]: in flight gravity alone changes it, on the ground what contacts
            give, too.
        angular: about the centre of mass, counter-clockwise [kg m^2/s].
    """

    mass: np.ndarray
    place: np.ndarray
    linear: np.ndarray
    angular: np.ndarray

    @property
    def velocity(self) -> np.ndarray:
        """(..., 2) of the centre of mass [m/s]."""
        return self.linear / self.mass[..., None]


def momentum(
    states: Any,
    params: Parameters,
    bodies: Sequence[str] | str | None = None,
    *,
    staggered: bool = False,
) -> Momentum:
    """Momentum and centre of mass of states, in plain NumPy.

    Steps in joint coordinates keep momentum in flight to first order of the step size (Euler) or to second
    (the leapfrog and the trapezoidal rule), where several bodies turn: what a fast limb gains so a plan may
    live on. A rotor's inertia (`Body.armature`) has no momentum of its own here.

    Args:
        states: (..., 2 nv) of the scene that the parameters are of; where these are of worlds, of as many
            worlds in the first axis.
        params: as of `Simulator.params` or `Trajectory.params`.
        bodies: names of those that count; None: all.
        staggered: the velocities are those half a step before the places, as a leapfrog's are (M63): momenta
            are those of then, at q - h v/2; `place` stays that of the states.

    Raises:
        ArgumentError: states of another shape, not as many worlds, or a body that is not there.
        ArgumentTypeError: staggered is no truth value.
    """
    moving, late = (moving_bodies(states, params, way) for way in (staggered, False))
    names = [body.name for body in params.scene.bodies]
    chosen = names if bodies is None else list(dict.fromkeys(checks.names("bodies", bodies, names)))
    if not chosen:
        raise ArgumentError("bodies is empty; at least one is needed")
    mass, linear = np.zeros(moving.q.shape[:-1]), np.zeros((*moving.q.shape[:-1], 2))
    place, middle, parts = np.zeros_like(linear), np.zeros_like(linear), []
    for b in (names.index(name) for name in chosen):
        own, (centre, speed) = moving.p["mass"][..., b], moving.at(b, moving.p["com"][..., b, :])
        mass, linear = mass + own, linear + own[..., None] * speed
        middle = middle + own[..., None] * centre
        place = place + own[..., None] * late.at(b, late.p["com"][..., b, :])[0]
        parts.append((own, centre, speed, moving.p["inertia"][..., b] * moving.rate[b]))
    place, middle = place / mass[..., None], middle / mass[..., None]
    angular = np.zeros_like(mass)
    for own, centre, speed, spin in parts:
        angular = angular + spin + own * np.sum(across(centre - middle) * speed, -1)
    return Momentum(mass, place, linear, angular)
