"""Measures as the kernels take them, and their values from what the kernels keep."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.ensembles import measures as kernels
from slcp_warp.kernels.ensembles.contacts import FAR
from slcp_warp.kernels.ensembles.users import check_user

from ..description.points import AXES, Point, point_numbers
from ..description.scene import Scene
from ..inputs.errors import ArgumentError
from ..inputs.user_code import Known, check_indices, of_user
from .arithmetic import SUM
from .reductions import NOTHING, Measure
from .signals import FORCES, OF_CONTACTS, OF_TENDONS, RUBS, TRAPEZOIDAL, Condition, Signal

INFINITE = 1e-50 * FAR  # what a mean or an integral of one FAR is above, whatever the steps


def priced(measures: Sequence[Measure]) -> bool:
    """Whether any of them is of the cost."""
    return any(signal.kind == "cost" for measure in measures for signal in measure.signals())


def _ranges(pairs: Sequence[int]) -> list[tuple[int, int]]:
    """Pairs as the first of those that follow each other, and one after the last."""
    breaks = [0, *(i for i in range(1, len(pairs)) if pairs[i] != pairs[i - 1] + 1), len(pairs)]
    return [(pairs[a], pairs[b - 1] + 1) for a, b in pairwise(breaks) if a < b] or [(0, 0)]


class MeasureTable:
    """The measures of a run, looked up in a scene.

    Attributes:
        measures: in the order of their values, then of what is felt.
        looks_inside: whether one of them is of contacts or tendons.
    """

    def __init__(
        self,
        measures: Sequence[Measure],
        scene: Scene,
        ends: Measure | None = None,
        cost: Any = None,
        felt: Sequence[Signal] = (),
    ) -> None:
        """Args:
        ends: one of the measures, a first time: a world ends with the step in which it comes.
        cost: a `costs.Cost`, for measures of it.
        felt: signals whose value in the last step is kept, too.
        """
        self._valued, self._scene = len(measures), scene
        self.measures = (*measures, *(Measure("final", signal) for signal in felt))
        self._ends = kernels.NONE if ends is None else self.measures.index(ends)
        asked = dict.fromkeys(signal for measure in self.measures for signal in measure.signals())
        since = {signal: Measure("initial", signal.at_start) for signal in asked if signal.since_start}
        starts = list(dict.fromkeys(since.values()))
        self._all = self.measures + tuple(starts)
        signals = list(dict.fromkeys(signal for measure in self._all for signal in measure.signals()))
        functions = dict.fromkeys(signal.function for signal in signals)
        self._functions: tuple[Any, ...] = tuple(each for each in functions if each is not None)
        self._cost = cost if any(signal.kind == "cost" for signal in signals) else None
        self._points: list[Point] = []
        place = {signal: i for i, signal in enumerate(signals)}
        self._relative = any(signal.since_start or signal.absolute for signal in signals)
        first = len(self.measures)
        rows = [first + starts.index(since[each]) if each in since else kernels.NONE for each in signals]
        pairs = {signal: _ranges(signal.pairs(scene)) for signal in signals if signal.kind in OF_CONTACTS}
        self._scattered = any(len(each) != 1 for each in pairs.values())
        self._ranges = [(0, 0)]
        self._bounds: list[tuple[float, float]] = []
        self._signals = [
            self._sum(signal, place)
            if signal.terms
            else (*self._signal(signal, scene, pairs.get(signal, [])), row)
            for signal, row in zip(signals, rows)
        ]
        self._sums = bool(self._bounds)
        kinds = {signal.kind for signal in signals}
        self._gaps, self._slips = "gap" in kinds, "slip" in kinds
        self._forces, self._rubs = (not kinds.isdisjoint(each) for each in (FORCES, RUBS))
        self._pulls = OF_TENDONS in kinds
        self.looks_inside = self._pulls or not kinds.isdisjoint(OF_CONTACTS)
        self._compared = [0] * len(self._bounds)
        self._clauses: list[tuple[int, int]] = []
        self._rows = [self._row(measure, place) for measure in self._all]

    def _signal(
        self, signal: Signal, scene: Scene, pairs: list[tuple[int, int]]
    ) -> tuple[int, int, int, int]:
        kind = kernels.SIGNALS.index(signal.kind)
        which = self._functions.index(signal.function) if signal.function is not None else signal.place(scene)
        how = kernels.ABSOLUTE * signal.absolute + kernels.SINCE * signal.since_start
        if signal.kind in OF_CONTACTS:
            if not self._scattered:
                return kind, *pairs[0], how
            self._ranges += pairs
            return kind, len(self._ranges) - len(pairs), len(self._ranges), how
        if isinstance(signal.which, Point):
            axis = 0 if signal.axis is None else AXES.index(signal.axis)
            which, less = (self._listed(each, axis) for each in (signal.which, signal.minus))
            return kind, which, less, how
        return kind, which, signal.less(scene), how

    def _sum(self, signal: Signal, place: dict[Signal, int]) -> tuple[int, int, int, int, int]:
        """The row of a sum, whose terms are listed."""
        first, shift = len(self._ranges), len(self._bounds) - len(self._ranges)
        for weight, factors in signal.terms:
            self._bounds.append((weight, 0.0))
            one, two = (*(place[each] for each in factors), kernels.NONE, kernels.NONE)[:2]
            self._ranges.append((one, two))
        how = kernels.ABSOLUTE * signal.absolute
        return kernels.SIGNALS.index(SUM), first, len(self._ranges), how, shift

    def _listed(self, point: Any, axis: int) -> int:
        """The number of a point's coordinate; NONE: no point."""
        if point is None:
            return kernels.NONE
        if point not in self._points:
            self._points.append(point)
        return 2 * self._points.index(point) + axis

    def _row(self, measure: Measure, place: dict[Signal, int]) -> tuple[int, ...]:
        """Reduction, signal, clauses of a condition from and to, whether it counts at all times, clauses of
        where it does from and to.
        """
        what = kernels.REDUCTIONS.index(measure.reduction)
        always = int(measure.start == 0.0 and measure.end is None)
        of, counts = self._listed_clauses(measure.of, place), self._listed_clauses(measure.where, place)
        signal = kernels.NONE if isinstance(measure.of, Condition) else place[measure.of]
        return what, signal, *of, always, *counts

    def _listed_clauses(self, of: Any, place: dict[Signal, int]) -> tuple[int, int]:
        """The first clause of a condition and one after the last; none of anything else."""
        first = len(self._clauses)
        for clause in of.clauses if isinstance(of, Condition) else ():
            start = len(self._bounds)
            self._bounds += [(within.low, within.high) for within in clause]
            self._compared += [place[within.of] for within in clause]
            self._clauses.append((start, len(self._bounds)))
        return first, len(self._clauses)

    def users(self, sim: Any) -> kernels.Users:
        """Code of users that a simulator's kernels call for them."""
        for function in self._functions:
            name = function.key.rpartition(".")[2]
            with of_user(
                f"measures.function: {name!r} is no f(x, u, time) of {sim.nx} states and {sim.nu} controls"
            ):
                check_user(function, sim.nx, sim.nu, sim.dtype)
            check_indices("measures.function", function, Known(sim.nx), Known(max(sim.nu, 1)))
        if self._pulls and sim.options.method.trapezoidal:
            raise ArgumentError(f"a measure of {OF_TENDONS}: {TRAPEZOIDAL}")
        cost = self._cost and self._cost.functions(sim.dtype, sim.nx, sim.nu)
        some = any(measure.where is not None for measure in self.measures)
        looks = self._slips, self._forces, self._rubs
        own = self._scattered, self._pulls, some, self._sums
        parts = self._relative, self._gaps, bool(self._points), *looks, *own
        return kernels.Users(self._functions, cost, *parts)

    def struct(self, sim: Any) -> Any:
        """The tables on a simulator's device."""
        out, device = kernels.make_tables(sim.dtype)(), sim.device
        if self._cost is not None:
            out.weights = wp.array(self._cost.rows(1), dtype=sim.dtype, device=device)
        if self._points:
            points = [0.0, *point_numbers(self._scene, self._points, 1), 0.0]
            out.points = wp.array(np.array([points]), dtype=sim.dtype, device=device)
        window = [(each.start, FAR if each.end is None else each.end) for each in self._all]
        for name, values, width, kind in (
            ("signal", self._signals, 5, np.int32),
            ("ranges", self._ranges, 2, np.int32),
            ("bounds", self._bounds, 2, np.float64),
            ("clause", self._clauses, 2, np.int32),
            ("measure", self._rows, 7, np.int32),
            ("window", window, 2, np.float64),
        ):
            setattr(out, name, wp.array(np.array(values, kind).reshape(-1, width), device=device))
        out.ends, out.since = self._ends, len(self._all) - len(self.measures)
        out.compared = wp.array(np.array(self._compared, np.int32), device=device)
        return out

    def kept(self, worlds: int, device: Any) -> wp.array:
        """What kernels keep of the measures, before the first step."""
        shape = (worlds, len(self._all), kernels.WIDTH)
        return wp.zeros(shape, dtype=wp.float64, device=device)

    def values(self, kept: np.ndarray) -> np.ndarray:
        """(B, M) values of the measures from what was kept of them; NaN where no step counted, but for
        `NOTHING`, of steps in which a condition holds.
        """
        return self._values(kept)[:, : self._valued]

    def felt(self, kept: np.ndarray) -> np.ndarray:
        """(B, F) of what is felt in the step that was made last; NaN before the first."""
        return self._values(kept)[:, self._valued :]

    def _values(self, kept: np.ndarray) -> np.ndarray:
        out = np.empty((len(kept), len(self.measures)))
        for j, measure in enumerate(self.measures):
            value, count, second, begin, end = kept[:, j].T
            with np.errstate(invalid="ignore", divide="ignore"):
                if measure.reduction in ("mean", "share_of_time"):
                    value = value / count
                elif measure.reduction == "rms":
                    value = np.sqrt(value / count)
                elif measure.reduction == "rate":
                    value = np.where(count > 1, (value - second) / (end - begin), 0.0)
                elif measure.reduction in ("first_time", "settled"):
                    value = np.where(second > 0.0, value, np.inf)
            value = np.where(np.abs(value) >= INFINITE, np.copysign(np.inf, value), value)
            none = np.nan if measure.where is None else NOTHING.get(measure.reduction, np.nan)
            out[:, j] = np.where(count > 0, value, none)
        return out
