"""Measures: reductions of signals over the steps of a run, one number a world; comparisons make a success."""

import math
from dataclasses import dataclass
from typing import Any

from ..inputs.checks import number, shown
from ..inputs.errors import ArgumentTypeError
from .signals import (
    Compared,
    Condition,
    Joined,
    Signal,
    Within,
    contact,
    gap,
    normal_impulse,
    since_start,
    state,
)
from .signals import cost as step_cost

OF_CONDITIONS = ("share_of_time", "first_time", "settled", "count")
NOTHING = {  # what is of no step, where a condition chooses them; anything else is NaN
    **dict.fromkeys(("integral", "total", "accumulated", "count"), 0.0),
    **dict.fromkeys(("first_time", "settled"), math.inf),
}


@dataclass(frozen=True, repr=False)
class Measure(Compared):
    """One number a world.

    Attributes:
        reduction: one of `REDUCTIONS`.
        of: the signal, or the condition.
        start, end: the times between which it counts [s]; end None: to the last step.
        where: the condition under which steps count; None: all do. Where it never holds, sums (integral,
            total, count) are 0, times infinite and all others NaN.
    """

    reduction: str
    of: Signal | Condition
    start: float = 0.0
    end: float | None = None
    where: Condition | None = None

    def __post_init__(self) -> None:
        if self.where is not None and not isinstance(self.where, Condition):
            raise ArgumentTypeError(
                f"where is {shown(self.where)}; a comparison of a signal is needed, as contact() > 0.5"
            )
        object.__setattr__(self, "start", number("start", self.start, 0.0))
        if self.end is not None:
            object.__setattr__(self, "end", number("end", self.end, self.start, above=True))

    def signals(self) -> list[Signal]:
        """The signals that it looks at, and of sums what they are made from, before them."""
        of = self.of.parts() if isinstance(self.of, Condition) else [self.of]
        found = of if self.where is None else [*of, *self.where.parts()]
        return list(dict.fromkeys(part for signal in found for part in signal.parts()))

    def __repr__(self) -> str:
        """The expression that makes it, the names of `slcp_warp.measures` without the module."""
        name, of = self._short()
        given = [repr(of.which) if isinstance(of, Signal) and of.plain else repr(of)]
        given += [f"start={self.start:g}"] if self.start else []
        given += [] if self.end is None else [f"end={self.end:g}"]
        given += [] if self.where is None else [f"where={self.where!r}"]
        return f"{name}({', '.join(given)})"

    def _short(self) -> tuple[str, Signal | Condition]:
        """What makes it: a reduction and of what; `change` and `excursion` take what is since the start."""
        of = self.of
        if isinstance(of, Signal) and of.since_start:
            plain = of.at_start
            if (self.reduction, of.absolute) == ("largest", True):
                return "excursion", plain
            if (self.reduction, of.absolute, self.start) == ("final", False, 0.0):
                return "change", plain
        return self.reduction, of

    def _within(self, low: float, high: float) -> "Success":
        return Success(((Within(self, low, high),),))


class Success(Joined):
    """Comparisons of measures: whether a world succeeded."""

    def signals(self) -> list[Signal]:
        """The signals that its measures look at."""
        return list(dict.fromkeys(signal for part in self.parts() for signal in part.signals()))


def _of_signal(
    reduction: str, signal: Any, start: float, end: float | None, where: Condition | None
) -> Measure:
    if not isinstance(signal, Signal):
        if not isinstance(signal, str | int) or isinstance(signal, bool):
            raise ArgumentTypeError(
                f"{reduction} is of {shown(signal)}; a state by its name or its place, or a signal, is needed"
            )
        signal = state(signal)
    return Measure(reduction, signal, start, end, where)


def _of_condition(
    reduction: str, condition: Any, start: float, end: float | None, where: Condition | None
) -> Measure:
    if not isinstance(condition, Condition):
        raise ArgumentTypeError(
            f"{reduction} is of {shown(condition)}; a comparison of a signal is needed, as state('x') > 1.0"
        )
    return Measure(reduction, condition, start, end, where)


def initial(signal: Any, start: float = 0.0, where: Condition | None = None) -> Measure:
    """The first value at or after `start`."""
    return _of_signal("initial", signal, start, None, where)


def final(signal: Any, end: float | None = None, where: Condition | None = None) -> Measure:
    """The last value, of those before `end`."""
    return _of_signal("final", signal, 0.0, end, where)


def rate(
    signal: Any, start: float = 0.0, end: float | None = None, where: Condition | None = None
) -> Measure:
    """(last - first value) / time between them [per s]; 0 where there is one value only."""
    return _of_signal("rate", signal, start, end, where)


def mean(
    signal: Any, start: float = 0.0, end: float | None = None, where: Condition | None = None
) -> Measure:
    """Mean over the steps."""
    return _of_signal("mean", signal, start, end, where)


def rms(signal: Any, start: float = 0.0, end: float | None = None, where: Condition | None = None) -> Measure:
    """Root of the mean square over the steps: what a motor is heated by, of `tendon_force`."""
    return _of_signal("rms", signal, start, end, where)


def integral(
    signal: Any, start: float = 0.0, end: float | None = None, where: Condition | None = None
) -> Measure:
    """Sum over the steps of value times step size."""
    return _of_signal("integral", signal, start, end, where)


def total(
    signal: Any, start: float = 0.0, end: float | None = None, where: Condition | None = None
) -> Measure:
    """Sum over the steps."""
    return _of_signal("total", signal, start, end, where)


def largest(
    signal: Any, start: float = 0.0, end: float | None = None, where: Condition | None = None
) -> Measure:
    """The largest value, that after the last step included."""
    return _of_signal("largest", signal, start, end, where)


def smallest(
    signal: Any, start: float = 0.0, end: float | None = None, where: Condition | None = None
) -> Measure:
    """The smallest value, that after the last step included."""
    return _of_signal("smallest", signal, start, end, where)


def change(signal: Any, end: float | None = None, where: Condition | None = None) -> Measure:
    """The last value, of those before `end`, less that at the run's start."""
    return final(since_start(signal), end, where)


def excursion(
    signal: Any, start: float = 0.0, end: float | None = None, where: Condition | None = None
) -> Measure:
    """How far a signal gets from its value at the run's start: the largest absolute difference."""
    return largest(abs(since_start(signal)), start, end, where)


def share_of_time(
    condition: Any, start: float = 0.0, end: float | None = None, where: Condition | None = None
) -> Measure:
    """Share of the steps in which a condition holds."""
    return _of_condition("share_of_time", condition, start, end, where)


def first_time(
    condition: Any, start: float = 0.0, end: float | None = None, where: Condition | None = None
) -> Measure:
    """When a condition holds for the first time [s]; infinite: never."""
    return _of_condition("first_time", condition, start, end, where)


def settled(
    condition: Any, start: float = 0.0, end: float | None = None, where: Condition | None = None
) -> Measure:
    """From when on a condition holds to the end [s]; infinite: not at the end."""
    return _of_condition("settled", condition, start, end, where)


def count(
    condition: Any, start: float = 0.0, end: float | None = None, where: Condition | None = None
) -> Measure:
    """How often a condition becomes true, of a first step in which it holds once."""
    return _of_condition("count", condition, start, end, where)


def contact_share(
    pair: str | int | None = None,
    start: float = 0.0,
    end: float | None = None,
    where: Condition | None = None,
) -> Measure:
    """Share of the steps in which a pair, or any of several, pushes; named as of `contact`."""
    return mean(contact(pair), start, end, where)


def lowest_gap(
    pair: str | int | None = None,
    start: float = 0.0,
    end: float | None = None,
    where: Condition | None = None,
) -> Measure:
    """The lowest distance of a pair, or of several, before a step [m]; infinite without any."""
    return smallest(gap(pair), start, end, where)


def cost() -> Measure:
    """The task's cost of the run: running costs over its steps and the final cost, as a plan's."""
    return Measure("accumulated", step_cost())


def impulse(
    pair: str | int | None = None,
    start: float = 0.0,
    end: float | None = None,
    where: Condition | None = None,
) -> Measure:
    """All normal impulses of a pair, or of several pairs, together [N s]; named as of `contact`."""
    return total(normal_impulse(pair), start, end, where)
