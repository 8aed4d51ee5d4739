"""What happens to a world while it runs: pushes on bodies, dropouts of the controls."""

from dataclasses import dataclass
from math import inf
from typing import Any

from ...inputs.checks import shown
from ...inputs.errors import ArgumentError
from .distributions import Distribution, Uniform, fixed_or_drawn

Drawn = float | Distribution


@dataclass(frozen=True)
class Push:
    """A force and a torque on a body for a while; of a step that it covers in part it has that share.

    Every number may be drawn: one of `LogNormal`, `Normal`, `Uniform` in its place.

    Attributes:
        body: its name.
        start: when it begins [s].
        duration: how long it lasts [s].
        force: (x, y) in the directions of the world [N].
        torque: [N m].
        at: (x, y) of the point of the body that is pushed, in the body's frame [m], as a shape's offset;
            None: its centre of mass.
    """

    body: str
    start: Drawn
    duration: Drawn
    force: tuple[Drawn, Drawn] = (0.0, 0.0)
    torque: Drawn = 0.0
    at: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        put = object.__setattr__
        if not isinstance(self.body, str):
            raise ArgumentError(f"Push.body is {shown(self.body)}; the name of a body is needed")
        put(self, "start", fixed_or_drawn("Push.start", self.start))
        put(self, "duration", fixed_or_drawn("Push.duration", self.duration, 0.0))
        put(self, "torque", fixed_or_drawn("Push.torque", self.torque))
        put(self, "force", _pair("Push.force", self.force))
        if self.at is not None:
            at = _pair("Push.at", self.at)
            if any(isinstance(each, Distribution) for each in at):
                raise ArgumentError(
                    f"Push.at is {shown(self.at)}; two numbers are needed, which are not drawn"
                )
            put(self, "at", at)

    def numbers(self) -> tuple[Drawn, ...]:
        """In the order of `PUSH_FIELDS`."""
        return self.start, self.duration, *self.force, self.torque


@dataclass(frozen=True)
class Dropout:
    """A while without controls: all of them are zero in the steps that begin in it.

    Attributes:
        start: when it begins [s], a number or how it is drawn.
        duration: how long it lasts [s], the same.
    """

    start: Drawn
    duration: Drawn

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "start", fixed_or_drawn("Dropout.start", self.start))
        put(self, "duration", fixed_or_drawn("Dropout.duration", self.duration, 0.0))

    def numbers(self) -> tuple[Drawn, ...]:
        """In the order of `DROPOUT_FIELDS`."""
        return self.start, self.duration


def latest_end(event: Push | Dropout) -> float:
    """When it ends at the latest [s]; infinite where nothing bounds that."""
    ends = (event.start, event.duration)
    return sum(
        each.high if isinstance(each, Uniform) else inf if isinstance(each, Distribution) else each
        for each in ends
    )


def _pair(label: str, value: Any) -> tuple[Drawn, Drawn]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise ArgumentError(f"{label} is {shown(value)}; two numbers (x, y) are needed")
    return fixed_or_drawn(label, value[0]), fixed_or_drawn(label, value[1])
