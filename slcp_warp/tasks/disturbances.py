"""What is uncertain in the runs of a task: starts, parameters, controls, kicks."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..description.scene import Scene
from ..inputs.checks import instance, number, shown
from ..inputs.errors import ArgumentError
from ..inputs.rules import PERTURBABLE

MOST_SPREAD = 2.0  # of a logarithm: a factor of 50 at two standard deviations


@dataclass(frozen=True)
class Disturbances:
    """What is drawn for every world, from the seed and the world's number.

    Attributes:
        position, velocity: standard deviation of normal noise on every coordinate, and on every velocity, of
            the start.
        start: the same for single components by their names, instead of these.
        parameters: name -> standard deviation of the logarithm of a factor (one per body, shape, contact or
            degree of freedom; mass and inertia of a body share theirs).
        torque: of white noise on the controls, a number a step.
        kick_times: when velocities are kicked [s].
        kick: standard deviation of a kick on every velocity [m/s, rad/s].
    """

    position: float = 0.0
    velocity: float = 0.0
    start: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    torque: float = 0.0
    kick_times: tuple[float, ...] = ()
    kick: float = 0.0

    def __post_init__(self) -> None:
        put = object.__setattr__
        for name in ("position", "velocity", "torque", "kick"):
            put(self, name, number(f"Disturbances.{name}", getattr(self, name), 0.0))
        for name in ("start", "parameters"):
            given = instance(
                f"Disturbances.{name}", getattr(self, name), Mapping, "a dict of numbers by name"
            )
            values = {}
            for key, value in given.items():
                if not isinstance(key, str):
                    raise ArgumentError(f"Disturbances.{name} has the name {shown(key)}; a text is needed")
                values[key] = number(f"Disturbances.{name}[{key!r}]", value, 0.0)
            put(self, name, values)
        self._check_parameters()
        if not isinstance(self.kick_times, list | tuple):
            raise ArgumentError(f"Disturbances.kick_times is {shown(self.kick_times)}; a tuple is needed")
        times = tuple(number("Disturbances.kick_times", time, 0.0) for time in self.kick_times)
        put(self, "kick_times", tuple(sorted(times)))

    def _check_parameters(self) -> None:
        for name, spread in self.parameters.items():
            if name not in PERTURBABLE:
                raise ArgumentError(
                    f"Disturbances.parameters names {name!r}; choose from {', '.join(PERTURBABLE)}"
                )
            if spread >= MOST_SPREAD:
                raise ArgumentError(
                    f"Disturbances.parameters[{name!r}] is {spread}; a number in [0, {MOST_SPREAD}) is needed"
                )

    def deviation(self, scene: Scene) -> np.ndarray:
        """(2 nv,) standard deviations of the start's components.

        Raises:
            ArgumentError: a name that the scene has not got.
        """
        out = np.repeat([self.position, self.velocity], scene.nv)
        for name, value in self.start.items():
            out[scene.state_index(name)] = value
        return out

    def any(self) -> bool:
        """Whether anything is disturbed."""
        given: list[Any] = [self.position, self.velocity, self.torque, *self.start.values()]
        return any(given) or any(self.parameters.values()) or bool(self.kick_times and self.kick)
