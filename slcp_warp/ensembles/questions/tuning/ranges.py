"""Numbers that are looked for, each between two ends, as a search sees them: a cube of side 1."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ....inputs import checks
from ....inputs.checks import shown
from ....inputs.errors import ArgumentError
from ....tasks.task import Task
from ..axes import ITSELF, checked_axis, set_twice

NEAR = 0.01  # of a range: what lies this close to an end of it lies at the end


class Ranges:
    """The numbers that a policy is made from, and behind them those of a task.

    Attributes:
        names: of all of them; of the task's as a map calls them.
        own: how many are the policy's.
        low, high: (n,) ends.
        logarithmic: (n,) whether a number's logarithm is looked for.

    Raises:
        ArgumentError: no number at all, no range, or a name that nothing has.
    """

    def __init__(
        self, task: Task, numbers: Mapping[str, Any] | None, parameters: Mapping[str, Any] | None, log: Any
    ) -> None:
        own, design = _named("numbers", numbers), _named("parameters", parameters)
        if not own and not design:
            raise ArgumentError(
                "numbers and parameters are both empty; the ranges of some, {name: (low, high)}, are needed"
            )
        if both := sorted(own.keys() & design.keys()):
            raise ArgumentError(f"numbers and parameters both have {both[0]!r}; two names are needed")
        self.names, self.own = (*own, *design), len(own)
        ends = [_ends(f"numbers[{name!r}]", given) for name, given in own.items()]
        ends += [_of_task(task, name, given) for name, given in design.items()]
        _check_apart(task, tuple(design))
        self.low, self.high = np.array(ends).T
        chosen = () if log is None else checks.names("log", log, self.names)
        self.logarithmic = np.isin(self.names, chosen)
        if (self.low[self.logarithmic] <= 0.0).any():
            name = self.names[int(np.flatnonzero(self.logarithmic & (self.low <= 0.0))[0])]
            raise ArgumentError(
                f"log has {name!r}, whose range begins at or below 0; a positive one is needed"
            )

    def __len__(self) -> int:
        return len(self.names)

    def numbers(self, place: np.ndarray) -> np.ndarray:
        """Of a place in the cube, (n,)."""
        low, high = (self._scaled(end) for end in (self.low, self.high))
        found = low + np.clip(place, 0.0, 1.0) * (high - low)
        found[self.logarithmic] = np.exp(found[self.logarithmic])
        return np.clip(found, self.low, self.high)  # rounding leaves no range

    def start(self, given: Mapping[str, float] | None) -> np.ndarray:
        """The place (n,) of numbers by name; of those that are left out the middle of the range."""
        place = np.full(len(self), 0.5)
        if given is None:
            return place
        checks.instance("start", given, Mapping, "a dict of numbers by name")
        for name in checks.names("start", list(given), self.names) if given else ():
            i = self.names.index(name)
            value = checks.number(f"start[{name!r}]", given[name], self.low[i], self.high[i])
            low, high, at = (
                self._scaled(np.full(len(self), v))[i] for v in (self.low[i], self.high[i], value)
            )
            place[i] = (at - low) / (high - low)
        return place

    def ends(self, place: np.ndarray) -> tuple[str, ...]:
        """Names of the numbers of a place that lie at an end of their range."""
        there = (place <= NEAR) | (place >= 1.0 - NEAR)
        return tuple(name for name, at in zip(self.names, there) if at)

    def _scaled(self, values: np.ndarray) -> np.ndarray:
        out = np.array(values, float)
        out[self.logarithmic] = np.log(out[self.logarithmic])
        return out


def _named(label: str, given: Any) -> dict[str, Any]:
    if given is None:
        return {}
    if not isinstance(given, Mapping) or not all(isinstance(name, str) for name in given):
        raise ArgumentError(f"{label} is {shown(given)}; a dict of ranges (low, high) by name is needed")
    return dict(given)


def _ends(label: str, given: Any) -> np.ndarray:
    found = checks.array(label, given, (2,))
    with np.errstate(over="ignore"):
        if not 0.0 < found[1] - found[0] < np.inf:
            raise ArgumentError(
                f"{label} is {shown(given)}; (low, high), low < high, not without end, is needed"
            )
    return found


def _of_task(task: Task, name: str, given: Any) -> np.ndarray:
    label = f"parameters[{name!r}]"
    found = _ends(label, given)
    checked_axis(label, task, (name, found))
    return found


def _check_apart(task: Task, names: tuple[str, ...]) -> None:
    """Raise ArgumentError where two names stand for the same number."""
    for i, name in enumerate(names):
        for other in names[:i]:
            if name.rstrip(ITSELF) == other.rstrip(ITSELF) or set_twice(task, other, name):
                raise ArgumentError(f"parameters {other!r} and {name!r} are values of the same numbers")
