"""What a task says of its sensors and of where its runs begin."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...description.names import index_of
from ...inputs.checks import instance, number, shown
from ...inputs.errors import ArgumentError, ArgumentTypeError
from .sensors import MOST


def sensors_of(task: Any, given: Any) -> Mapping[str, float]:
    """Standard deviations by state name: as given, or the task's noise of the states that are named.

    Raises:
        ArgumentError: a sensor without noise.
    """
    if isinstance(given, Mapping):
        return given
    if not isinstance(given, list | tuple) or not all(isinstance(name, str) for name in given):
        raise ArgumentTypeError(
            f"sensors is {shown(given)}; names of states, or a dict of numbers by name, are needed"
        )
    noise = task.disturbances.sensor
    found = {name: noise.get(name, 0.0) if isinstance(noise, Mapping) else noise for name in given}
    quiet = [name for name, sd in found.items() if sd == 0.0]
    if quiet:
        raise ArgumentError(
            f"sensors names {', '.join(quiet)}, on which Disturbances.sensor has no noise; give "
            "sensors as a dict of standard deviations (of what is rounded to r, r / sqrt(12))"
        )
    return found


def by_sensor(label: str, given: Any, names: Sequence[str]) -> np.ndarray:
    """(sensors,) numbers that are given by the names of sensors; of the others, and of None, 0.

    Raises:
        ArgumentError, ArgumentTypeError: no dict, a name of no sensor, what is no number.
    """
    out = np.zeros(len(names))
    for name in {} if given is None else instance(label, given, Mapping, "a dict of numbers by name"):
        place = index_of(f"a name of {label}", name, names)
        out[place] = number(f"{label}[{name!r}]", given[name], -MOST, MOST)
    return out


def first_state(task: Any) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (nx,) of where a task's runs begin, its starts taken as equally likely."""
    starts, scene = np.atleast_2d(task.start), task.scene
    mean, deviation = task.disturbances.first_states(scene, starts)
    return mean.mean(axis=0), np.sqrt(deviation**2 + mean.var(axis=0))
