"""A task: a scene, what is good there, what is uncertain, and what a run of it is judged by."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from ..costs import NO_COST, Cost
from ..costs.terms import at_scene
from ..description.scene import Scene
from ..inputs.checks import array, instance, names, number, shown, whole
from ..inputs.errors import ArgumentError, ArgumentTypeError
from ..inputs.limits import limit_rows
from ..inputs.times import nearest_steps
from ..measures.recorded import checked_measures
from ..measures.reductions import Measure, Success, first_time
from ..measures.signals import Condition
from ..options import Options
from ..policies.observed import checked
from ..simulator import Simulator
from ..storage.printed import Printed, Table
from .disturbances import Disturbances
from .goal import goal

COLUMNS = (
    *("policy", "case", "step_size", "arm", "world", "failure_time"),
    *("start_overlap", "unsolved_time", "success", "status"),
)
SUMMED = ("worlds", "finite", "statuses", "overlapping")  # of every part, beside the means of measures
DRAWN = "drawn_"  # columns of what is drawn begin with it
RECORDED = "recorded_"  # and of what is recorded


class TaskError(ArgumentError):
    """A task that describes no problem; the message names the field, what came and what is needed."""


@dataclass(frozen=True, repr=False, eq=False)
class Task(Printed):
    """A problem to control, with its model and its judgement.

    Attributes:
        name: how it is called.
        scene: the mechanism; its step size and noise level are those of plans.
        cost: of a plan, see `slcp_warp.costs`; left out: the task is not planned, only judged.
        horizon: steps of a plan; None: the task is not planned.
        options: what a plan's steps solve; smoothed contact tells DDP what to touch. Cases of a sweep judge
            under others.
        duration: of a run [s], in as many steps as come nearest to it, at least one; None: as long as a plan,
            which then has to have a horizon.
        control_limits: (lower, upper), each a number or (nu,); None: none. They hold in plans and for
            what policies send in runs; noise of the disturbances comes on top.
        state_limits: by name of a state (lower, upper), infinite where there is none: plans keep them.
        start: states that runs start from: (nx,) or (M, nx), or a dict of numbers by state name on the
            scene's initial state; None: that.
        measures: what a run is looked at by, by name.
        disturbances: what is drawn for every world.
        success: comparisons of measures; None: every world that runs to its end is one.
        failure: comparisons of signals: a run ends with the step in which they become true, and is no
            success; its measures are of the steps up to that one. None: nothing ends a run.
        observation: what policies see of the state in runs: names of states, or a `policies.Observation`;
            None: all of it. Plans and libraries follow states, and see them all.
        periods: by name of an angle, after which turn it is the same again [rad], or "turn" for a whole one:
            policies take differences within half of it. They become those of `scene`.
    """

    name: str
    scene: Scene
    cost: Cost = NO_COST
    horizon: int | None = None
    options: Options = field(default_factory=Options)
    duration: float | None = None
    control_limits: Any = None
    state_limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    start: Any = None
    disturbances: Disturbances = field(default_factory=Disturbances)
    measures: Mapping[str, Measure] = field(default_factory=dict)
    success: Success | None = None
    failure: Condition | None = None
    observation: Any = None
    periods: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name and self.name.isprintable()):
            raise TaskError(f"Task.name is {shown(self.name)}; a text of printable characters is needed")
        for name, kind, need in (
            ("scene", Scene, "a slcp_warp.Scene"),
            ("cost", Cost, "one of slcp_warp.costs"),
            ("options", Options, "a slcp_warp.Options"),
            ("disturbances", Disturbances, "a slcp_warp.Disturbances"),
            ("success", Success | None, "comparisons of slcp_warp.measures, or None"),
            ("failure", Condition | None, "comparisons of signals of slcp_warp.measures, or None"),
        ):
            instance(f"Task.{name}", getattr(self, name), kind, need)
        put = object.__setattr__
        put(self, "_given", {each.name: getattr(self, each.name) for each in fields(self)})
        self._put_periods()
        if self.observation is not None:
            put(self, "observation", checked("Task.observation", self.observation))
        self._put_times()
        assert self.duration is not None
        for name, size in (("nx", 2 * self.scene.nv), ("nu", self.scene.nu)):
            need = getattr(self.cost, name)
            if need is not None and need != size:
                raise TaskError(f"Task.cost is for {name} = {need}, scene {self.scene.name!r} has {size}")
        try:
            put(self, "cost", at_scene(self.cost, self.scene))
            if self.cost.windows is not None:
                self.cost.windows.check(max(self.duration, (self.horizon or 0) * self.scene.step_size))
        except ArgumentError as error:
            raise TaskError(f"Task.cost: {error}") from None
        if self.control_limits is not None:
            lower, _ = limit_rows(self.control_limits, self.scene.nu)
            if len(lower) > 1:
                raise TaskError(
                    f"Task.control_limits are {len(lower)} rows; one number or ({self.scene.nu},) is needed"
                )
        self.state_limit_rows()
        put(self, "start", self._starts())
        put(self, "measures", checked_measures(self.measures))
        try:
            self.disturbances.check(self.scene, self.duration)
        except (ArgumentError, ArgumentTypeError) as error:
            raise TaskError(f"Task.disturbances: {error}") from None
        self._check_names()

    def __eq__(self, other: Any) -> bool:
        """Whether all fields are the same: costs by their functions and weights, starts and limits by their
        numbers.
        """
        if not isinstance(other, Task):
            return NotImplemented
        apart = ("cost", "start", "control_limits", "state_limits")
        plain = [each.name for each in fields(self) if each.name not in apart]
        return (
            all(getattr(self, name) == getattr(other, name) for name in plain)
            and np.array_equal(self.start, other.start)
            and np.array_equal(self._limits(), other._limits())
            and self.cost.same(other.cost)
        )

    def _limits(self) -> np.ndarray:
        """All limits of controls and states, (2, nu + nx)."""
        nx = 2 * self.scene.nv
        states = self.state_limit_rows() or (np.full(nx, -np.inf), np.full(nx, np.inf))
        controls = limit_rows(self.control_limits, self.scene.nu)
        return np.array([np.append(own[0], more) for own, more in zip(controls, states)])

    def __hash__(self) -> int:
        return hash((self.name, self.horizon, self.duration))

    def _put_times(self) -> None:
        """The horizon and the duration, checked; a run without one is as long as a plan."""
        span = self.duration
        if self.horizon is not None:
            object.__setattr__(self, "horizon", whole("Task.horizon", self.horizon, error=TaskError))
            span = self.horizon * self.scene.step_size if span is None else span
        if span is None:
            raise TaskError("Task.duration is None and Task.horizon, too; one of them is needed")
        found = number("Task.duration", span, 0.0, above=True, error=TaskError)
        object.__setattr__(self, "duration", found)
        nearest_steps("Task.duration", found, self.scene.step_size, error=TaskError)

    def state_limit_rows(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Limits of all states (nx,), infinite where there is none; None: of no state.

        Raises:
            TaskError: a state that the scene has not got, limits that are no pair of numbers or cross.
        """
        instance("Task.state_limits", self.state_limits, Mapping, "a dict of (lower, upper) by state name")
        if not self.state_limits:
            return None
        nx = 2 * self.scene.nv
        lower, upper = np.full(nx, -np.inf), np.full(nx, np.inf)
        for name, given in self.state_limits.items():
            where = f"Task.state_limits[{name!r}]"
            try:
                place = self.scene.state_index(name)
            except (ArgumentError, ArgumentTypeError) as error:
                raise TaskError(f"Task.state_limits: {error}") from None
            pair = array(where, given, (2,), finite=False, error=TaskError)
            if not pair[0] <= pair[1]:
                raise TaskError(
                    f"{where} is {shown(given)}; a lower limit and an upper one above it are needed"
                )
            lower[place], upper[place] = pair
        return lower, upper

    def _put_periods(self) -> None:
        """The periods into the scene."""
        given = instance("Task.periods", self.periods, Mapping, "a dict of numbers by state name")
        names, period = self.scene.state_names, list(self.scene.period or [None] * self.scene.nv)
        values = {}
        for name, value in given.items():
            try:
                place = self.scene.state_index(name)
            except (ArgumentError, ArgumentTypeError) as error:
                raise TaskError(f"Task.periods: {error}") from None
            if place >= self.scene.nv or self.scene.state_units[place] != "rad":
                angles = [each for each, unit in zip(names, self.scene.state_units) if unit == "rad"]
                raise TaskError(f"Task.periods names {shown(name)}; angles are {', '.join(angles) or 'none'}")
            whole_turn = 2.0 * math.pi if value == "turn" else value
            label = f"Task.periods[{name!r}]"
            values[name] = period[place] = number(label, whole_turn, 0.0, above=True, error=TaskError)
        object.__setattr__(self, "periods", values)
        if values:
            object.__setattr__(self, "scene", replace(self.scene, period=tuple(period)))

    def _starts(self) -> np.ndarray:
        """(M, nx) states."""
        if self.start is None:
            return self.scene.x0[None]
        if isinstance(self.start, Mapping):
            return self.scene.state(self.start)[None]
        starts = np.atleast_2d(array("Task.start", self.start, error=TaskError))
        if starts.ndim != 2 or starts.shape[1] != 2 * self.scene.nv or not len(starts):
            raise TaskError(f"Task.start has shape {starts.shape}; (M, {2 * self.scene.nv}) is needed")
        return starts

    @property
    def judged(self) -> list[tuple[str, Measure]]:
        """What a run is measured by: `measures`, what success and failure are of; with their places."""
        found = [(f"Task.measures[{name!r}]", measure) for name, measure in self.measures.items()]
        if self.success is not None:
            found += [(f"Task.success: {part.reduction}", part) for part in self.success.parts()]
        return found if self.failure is None else [*found, ("Task.failure", first_time(self.failure))]

    def _check_names(self) -> None:
        """Raise an error for a measure of what the scene has not got."""
        taken = [
            name for name in self.measures if name in COLUMNS + SUMMED or name.startswith((DRAWN, RECORDED))
        ]
        if taken:
            raise TaskError(
                f"Task.measures names {', '.join(map(repr, taken))}, which every report has; "
                f"other names than {', '.join(COLUMNS + SUMMED)}, {DRAWN}... and {RECORDED}... are needed"
            )
        if isinstance(self.observation, tuple):
            for name in self.observation:
                try:
                    self.scene.state_index(name)
                except (ArgumentError, ArgumentTypeError) as error:
                    raise TaskError(f"Task.observation: {error}") from None
        assert self.duration is not None
        for label, measure in self.judged:
            if measure.start >= self.duration:
                raise TaskError(
                    f"{label} counts from {measure.start} s on; a run ends after "
                    f"Task.duration = {self.duration:g} s"
                )
            for signal in measure.signals():
                if signal.kind == "cost" and self.cost is NO_COST:
                    raise TaskError(f"{label} is of the cost; the task has none")
                if signal.kind == "cost" and self.cost.nodes not in (None, self.steps + 1):
                    raise TaskError(
                        f"{label} is of a cost of {self.cost.nodes - 1} steps; a run has {self.steps}"
                    )
                try:
                    signal.place(self.scene), signal.less(self.scene)
                except (ArgumentError, ArgumentTypeError) as error:
                    raise TaskError(f"{label}: {error}") from None

    def _line(self) -> str:
        measures = ", ".join(self.measures) or "none"
        plans = "" if self.horizon is None else f"plans of {self.horizon} steps, "
        return (
            f"{self.name!r} with scene {self.scene.name!r}: {plans}runs of {self.duration:g} s; "
            f"measures: {measures}"
        )

    def _tables(self) -> list[Table]:
        rows = [("success", "every run to the end" if self.success is None else repr(self.success))]
        rows += [] if self.failure is None else [("failure", repr(self.failure))]
        rows += [(name, repr(measure)) for name, measure in self.measures.items()]
        judged = Table("", ("judged by", "expression"), rows, left=2, width=160)
        d, plain = self.disturbances, Disturbances()
        drawn: list[tuple[str, str]] = []
        for name in (each.name for each in fields(d)):
            own = getattr(d, name)
            if isinstance(own, Mapping):
                drawn += [(f"{name}: {key}", repr(law)) for key, law in own.items()]
            elif own != getattr(plain, name):
                drawn.append((name, repr(own)))
        return [judged, Table("", ("disturbed", "by"), drawn, left=2, width=160)] if drawn else [judged]

    @property
    def steps(self) -> int:
        """Steps of a run with the scene's step size."""
        assert self.duration is not None
        return nearest_steps("Task.duration", self.duration, self.scene.step_size, error=TaskError)

    def simulator(self, options: Options | None = None, **choices: Any) -> Simulator:
        """A simulator of its scene, with its options or others; `choices` as of `Simulator`."""
        return Simulator(self.scene, self.options if options is None else options, **choices)

    def goal(self) -> np.ndarray | None:
        """The first start with its positions at the targets of the cost's terms, (2 nv,); None: none."""
        return goal(self)

    def plot(self) -> Any:
        """A matplotlib figure: starts, and as green outlines the positions that the cost asks for.

        Raises:
            ImportError: matplotlib is missing.
        """
        from . import picture  # it loads matplotlib

        return picture.figure(self)

    def replace(self, **changes: Any) -> "Task":
        """The same task with other fields; what was left out of the others follows from these again, as the
        start from the scene and the duration from the horizon.

        Raises:
            TaskError: a field that a task has not got, or a value that it cannot have.
        """
        names("replace", tuple(changes), [each.name for each in fields(self)], error=TaskError)
        return replace(self, **(vars(self)["_given"] | changes))
