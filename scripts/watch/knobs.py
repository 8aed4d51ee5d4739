"""What a watcher can turn while the mechanism moves: sliders over the scene's own numbers, and switches."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import slcp_warp as slcp


@dataclass(frozen=True)
class Knob:
    """A number that a slider sets.

    Attributes:
        name: of the knob, as it travels.
        label: what the page writes beside it, with its unit.
        low, high: its range.
        value: where it stands at first.
        logarithmic: whether the slider's way is the number's logarithm.
    """

    name: str
    label: str
    low: float
    high: float
    value: float
    logarithmic: bool = False

    def checked(self, value: Any) -> float:
        """A value within the range; ValueError for what is no number there."""
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not self.low <= value <= self.high
        ):
            raise ValueError(
                f"{self.name} is {value!r:.40}; a number in [{self.low:g}, {self.high:g}] is needed"
            )
        return float(value)


Change = Callable[[slcp.Parameters, float], Any]  # the parameter's values for a knob's value
CHANGES: dict[str, tuple[str, Change]] = {  # knob -> parameter, and what becomes of it
    "step_size": ("step_size", lambda _, value: value),
    "sigma": ("sigma", lambda own, value: value * np.asarray(own["sigma"])),
    "friction": ("friction", lambda own, value: value * np.asarray(own["friction"])),
    "gravity": ("gravity", lambda own, value: value * np.asarray(own["gravity"])),
    "damping": ("damping", lambda own, value: value * np.asarray(own["damping"])),
}
SPEED = Knob("speed", "speed", 0.05, 4.0, 1.0, True)


def knobs_of(scene: slcp.Scene, options: slcp.Options) -> tuple[Knob, ...]:
    """The knobs that a scene's numbers have; factors are of the scene's own values."""
    own, h = slcp.Parameters(scene), scene.step_size
    found = [SPEED, Knob("step_size", "time step [s]", h / 10.0, 2.0 * h, h, True)]
    if np.any(own["sigma"]) and options.noise == "row":
        found.append(Knob("sigma", "σ, factor", 0.01, 10.0, 1.0, True))
    for name, most in (("friction", 3.0), ("gravity", 2.0), ("damping", 5.0)):
        if np.any(own[name]):
            found.append(Knob(name, f"{name}, factor", 0.0, most, 1.0))
    return tuple(found)


def parameters(own: slcp.Parameters, values: dict[str, float]) -> slcp.Parameters:
    """A scene's parameters with what the knobs say."""
    chosen = {n: CHANGES[n] for n in values if n in CHANGES}
    return own.replace(**{name: change(own, values[n]) for n, (name, change) in chosen.items()})
