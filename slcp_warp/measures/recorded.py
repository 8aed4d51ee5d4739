"""Measures of recorded trajectories, in NumPy: for states that are there already."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slcp_warp.kernels.ensembles.contacts import TOUCH
from slcp_warp.kernels.ensembles.disturbances import ROUNDING, SINGLE
from slcp_warp.kernels.ensembles.measures import NONE

from ..description.points import AXES, Point, position
from ..description.scene import Scene
from ..inputs.checks import array, shown
from ..inputs.errors import ArgumentError, ArgumentTypeError
from .arithmetic import SUM
from .reductions import NOTHING, OF_CONDITIONS, Measure, Success
from .signals import FORCES, OF_TENDONS, Condition, Signal


def _fastest(slip: np.ndarray) -> np.ndarray:
    """That of the largest magnitude of several; 0 of none."""
    of = np.abs(slip).argmax(axis=2) if slip.shape[2] else None
    return np.zeros(slip.shape[:2]) if of is None else np.take_along_axis(slip, of[..., None], 2)[..., 0]


REDUCED: dict[str, Callable[[np.ndarray], np.ndarray]] = {  # of pairs (B, N, pairs) to one number
    "gap": lambda gap: gap.min(axis=2, initial=np.inf),
    "contact": lambda impulse: impulse.max(axis=2, initial=0.0),
    "impulse": lambda impulse: impulse.sum(axis=2),
    "slip": _fastest,
    "tangential": lambda impulse: impulse.sum(axis=2),
}
SOURCES = {  # which array a signal is of
    "control": "controls", "contact": "impulse", "normal_force": "impulse", "tangential_force": "tangential",
    "tangential_impulse": "tangential", "tendon_force": "pull",
}  # fmt: skip


@dataclass(frozen=True)
class Recorded:
    """What was recorded of B worlds over N steps.

    Attributes:
        scene: whose names the measures use.
        step_size: (B,) [s].
        states: (B, N+1, nx).
        controls: (B, N, nu) as they acted, or None.
        impulse: (B, N, pairs) normal impulses [N s], or None.
        gap: (B, N, pairs) distances before every step [m], or None.
        slip: (B, N, pairs) how fast the pairs slide that push, else 0 [m/s], or None.
        tangential: (B, N, pairs) tangential impulses [N s], or None.
        pull: (B, N, tendons) forces of tendons [N, N m], or None.
        numbers: parameters by name, (B, 1, ...) where worlds have their own, by which points are where they
            are; None: the scene's.
    """

    scene: Scene
    step_size: Any
    states: Any
    controls: Any = None
    impulse: Any = None
    gap: Any = None
    slip: Any = None
    tangential: Any = None
    pull: Any = None
    numbers: Any = None
    _found: dict[Point, np.ndarray] = field(default_factory=dict, init=False)  # where points are

    def __post_init__(self) -> None:
        states = array("states", self.states, ("B", "N+1", 2 * self.scene.nv))
        (B, N), pairs = (states.shape[0], states.shape[1] - 1), len(self.scene.structure.pairs)
        if N < 1:
            raise ArgumentError(f"states has shape {states.shape}; at least one step is needed")
        put = object.__setattr__
        put(self, "states", states)
        put(self, "step_size", np.broadcast_to(array("step_size", self.step_size), (B,)))
        of_pairs = dict.fromkeys(("impulse", "gap", "slip", "tangential"), pairs)
        sizes = {"controls": self.scene.nu, "pull": len(self.scene.tendons), **of_pairs}
        for name, size in sizes.items():
            if getattr(self, name) is not None:
                put(self, name, array(name, getattr(self, name), (B, N, size), finite=name != "gap"))

    @property
    def times(self) -> np.ndarray:
        """(B, N+1) [s]."""
        return self.step_size[:, None] * np.arange(self.states.shape[1])

    def series(self, signal: Signal) -> np.ndarray:
        """(B, N+1) values of a signal; the last is of the last state, with the last step's contacts."""
        values = self._plain(signal)
        values = values - values[:, :1] if signal.since_start else values
        return np.abs(values) if signal.absolute else values

    def _plain(self, signal: Signal) -> np.ndarray:
        """The same as it is, neither since the start nor absolute."""
        if signal.kind == "time":
            return self.times
        if signal.kind == SUM:
            products = [w * math.prod(map(self.series, factors), start=1.0) for w, factors in signal.terms]
            return np.zeros(self.states.shape[:2]) + sum(products)
        if signal.kind == "function":
            raise ArgumentTypeError("a Warp function is evaluated in a sweep only, not on recorded states")
        if signal.kind == "cost":
            raise ArgumentTypeError("the cost is a task's: it is evaluated in a sweep only")
        if isinstance(signal.which, Point):
            return self._of_points(signal)
        place = signal.place(self.scene)
        if signal.kind == "cosine":
            return np.cos(self.states[:, :, place])
        if signal.kind == "state":
            less = signal.less(self.scene)
            return self.states[:, :, place] - (0.0 if less == NONE else self.states[:, :, less])
        source = SOURCES.get(signal.kind, signal.kind)
        found = getattr(self, source)
        if found is None:
            source = {"slip": "impulse", "tangential": "impulse", "pull": "controls"}.get(source, source)
            raise ArgumentError(
                f"a measure of {signal.kind} needs {source}, which was not recorded; roll out with "
                f"record={source!r}"
            )
        if signal.kind in ("control", OF_TENDONS):
            values = found[:, :, place]
        else:
            reduced = REDUCED["contact" if signal.kind == "contact" else source]
            values = reduced(found[:, :, list(signal.pairs(self.scene))])
        values = values / self.step_size[:, None] if signal.kind in FORCES else values
        values = (values > TOUCH).astype(float) if signal.kind == "contact" else values
        return np.concatenate([values, values[:, -1:]], axis=1)

    def _of_points(self, signal: Signal) -> np.ndarray:
        places = [self._position(each) for each in (signal.which, signal.minus) if isinstance(each, Point)]
        apart = places[0] if len(places) == 1 else places[0] - places[1]
        return (
            np.hypot(*np.moveaxis(apart, -1, 0))
            if signal.axis is None
            else apart[..., AXES.index(signal.axis)]
        )

    def _position(self, point: Point) -> np.ndarray:
        """(B, N+1, 2) of a point, computed once."""
        if point not in self._found:
            self._found[point] = position(self.scene, point, self.states, self.numbers)
        return self._found[point]

    def value(self, measure: Measure) -> np.ndarray:
        """(B,) values of a measure."""
        where = None
        if measure.where is not None:
            where = measure.where.holds({part: self.series(part) for part in measure.where.parts()})
        if measure.reduction in OF_CONDITIONS:
            assert isinstance(measure.of, Condition)
            series = measure.of.holds({part: self.series(part) for part in measure.of.parts()})
        else:
            assert isinstance(measure.of, Signal)
            series = self.series(measure.of)
        of = [None] * len(series) if where is None else where
        return np.array([self._reduce(measure, b, series[b], of[b]) for b in range(len(series))])

    def success(self, success: Success) -> np.ndarray:
        """(B,) whether worlds succeeded."""
        return success.holds({part: self.value(part) for part in success.parts()})

    def _reduce(self, measure: Measure, b: int, series: np.ndarray, where: np.ndarray | None) -> float:
        """A measure of one world, from its signal in every step (N+1,), and where steps count."""
        t, h = self.times[b], self.step_size[b]
        counts = counted_steps(measure, t, h) & (True if where is None else where)
        steps = counts.copy()
        steps[-1] = False
        none = np.nan if where is None else NOTHING.get(measure.reduction, np.nan)
        if not counts.any():
            return none
        inside, when = series[counts], t[counts]
        if measure.reduction == "rate":
            return (inside[-1] - inside[0]) / (when[-1] - when[0]) if len(inside) > 1 else 0.0
        if measure.reduction == "first_time":
            return when[np.argmax(inside)] if inside.any() else np.inf
        if measure.reduction == "settled":
            wrong = np.flatnonzero(~inside)
            after = 0 if not wrong.size else wrong[-1] + 1
            return when[after] if after < len(when) else np.inf
        if measure.reduction == "count":
            return float((inside & ~np.append(False, inside[:-1])).sum())
        ends = {"initial": inside[0], "final": inside[-1], "largest": inside.max(), "smallest": inside.min()}
        if measure.reduction in ends:
            return ends[measure.reduction]
        if measure.reduction == "accumulated":
            return inside.sum()
        if not steps.any():
            return none
        if measure.reduction == "rms":
            return np.sqrt((series[steps] ** 2).mean())
        summed = series[steps].sum()
        if measure.reduction in ("mean", "share_of_time"):
            return summed / steps.sum()
        return summed * (h if measure.reduction == "integral" else 1.0)


def of_worlds(what: Measure | Success, made: Any, worlds: Recorded) -> np.ndarray:
    """(B,) values of a measure, or successes, of worlds that made so many steps (B,), each of those alone;
    `made` None: all.
    """
    if made is None:
        return worlds.value(what) if isinstance(what, Measure) else worlds.success(what)
    out = np.full(len(made), np.nan if isinstance(what, Measure) else False)
    arrays = ("controls", "impulse", "gap", "slip", "tangential", "pull")
    for count in np.unique(made):
        rows = made == count
        steps = {name: getattr(worlds, name) for name in arrays}
        own = {name: None if each is None else each[rows, :count] for name, each in steps.items()}
        states = worlds.states[rows, : count + 1]
        out[rows] = of_worlds(what, None, Recorded(worlds.scene, worlds.step_size[rows], states, **own))
    return out


def counted_steps(measure: Measure, times: np.ndarray, step_size: float) -> np.ndarray:
    """Which of the states at `times` (N+1,) a measure counts."""
    end = np.inf if measure.end is None else measure.end
    about = times + ROUNDING * step_size + SINGLE * times
    return np.asarray((about >= measure.start) & (about < end))


def checked_measures(measures: Any) -> dict[str, Measure]:
    """Measures by name.

    Raises:
        ArgumentTypeError: no dict of measures.
    """
    if not isinstance(measures, Mapping):
        raise ArgumentTypeError(f"measures is {shown(measures)}; a dict of measures by name is needed")
    for name, measure in measures.items():
        if not (isinstance(name, str) and name and name.isprintable()):
            raise ArgumentTypeError(
                f"measures has the name {shown(name)}; a text of printable characters is needed"
            )
        if not isinstance(measure, Measure):
            raise ArgumentTypeError(
                f"measures[{name!r}] is {shown(measure)}; one of slcp_warp.measures is needed"
            )
    return dict(measures)
