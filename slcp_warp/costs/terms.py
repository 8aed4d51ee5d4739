"""Costs as sums of terms, each of one state, one control or a point of a body by its name."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slcp_warp.kernels.control.cost_points import make_point_terms, make_timed_point_terms
from slcp_warp.kernels.control.cost_terms import FIELDS, KINDS, TIMED, make_terms, make_timed_terms

from ..description.names import index_of
from ..description.points import AXES, Point, check_axis, point_numbers
from ..description.scene import Scene
from ..inputs.checks import array, choice, instance, number, shown
from ..inputs.errors import ArgumentError
from .cost import Cost
from .windows import Windows

EVERY = "all"
WIDTH = 0.1
SUMS = make_terms, make_timed_terms, make_point_terms, make_timed_point_terms
ALWAYS = (0.0, None)
NAMING = [0, 1, 5]  # of a term's fields: its kind, its component, the state that is taken off it


@dataclass(frozen=True)
class Term:
    """One term of a cost, of one component s; with e = s - target it is `weight` times

    e ("linear"), e^2 ("square"), 1 - cos e ("cosine"), sqrt(e^2 + width^2) - width ("absolute"), max(e, 0)^2
    ("above") or min(e, 0)^2 ("below").

    Attributes:
        kind: one of the above.
        weight: per step, or of the final state.
        state: a component of the state, by its name (`Scene.state_names`) or its place.
        control: a control, by its name or its place, or "all".
        target: [unit of the component]; of both coordinates of a point two numbers, or one for both.
        minus: what is taken off, so that the term is of a difference: of a state another, by its name or its
            place, of a control a state (of a servo's set-point the place: what its spring pulls, over its
            stiffness), and of a point another `Point`.
        width: > 0, where "absolute" turns from a parabola into a line [unit of the component].
        point: a `Point` of a body: the component is its coordinate in the world [m]. Lengths and angles of
            the bodies are the scene's own, whatever `Parameters` say. One of state, control and point.
        axis: which coordinate, "x" or "y"; None: both, as a term each.
        start, end: of a running term, the times of the plan (in MPC of the run) between which it counts, at
            steps k with start <= k h < end [s]; end None: to the last step.
    """

    kind: str
    weight: float
    state: str | int | None = None
    control: str | int | None = None
    target: float | tuple[float, float] = 0.0
    width: float = WIDTH
    minus: str | int | Point | None = None
    point: Point | None = None
    axis: str | None = None
    start: float = 0.0
    end: float | None = None

    def __post_init__(self) -> None:
        choice("Term.kind", self.kind, KINDS)
        put = functools.partial(object.__setattr__, self)
        put("weight", number("Term.weight", self.weight))
        put("width", number("Term.width", self.width, 0.0, above=True))
        put("start", number("Term.start", self.start, 0.0))
        if self.end is not None:
            put("end", number("Term.end", self.end, self.start, above=True))
        instance("Term.point", self.point, Point | None, "a costs.Point")
        of = {"state": self.state, "control": self.control, "point": self.point}
        if sum(value is not None for value in of.values()) != 1:
            given = ", ".join(f"Term.{name} {shown(value)}" for name, value in of.items())
            raise ArgumentError(f"{given}; one of them is needed")
        if self.point is None:
            if self.axis is not None:
                raise ArgumentError(f"Term.axis is {shown(self.axis)} without a point that it is of")
            if isinstance(self.minus, Point):
                raise ArgumentError(f"Term.minus is {shown(self.minus)} without a point that it is taken off")
            if self.minus is not None and isinstance(self.control, str) and self.control == EVERY:
                raise ArgumentError(f"Term.minus is {shown(self.minus)} of all controls; it is of one")
        else:
            check_axis("Term.axis", self.axis)
            instance("Term.minus", self.minus, Point | None, "a costs.Point, as Term.point,")
        if self.point is not None and self.axis is None and isinstance(self.target, list | tuple):
            x, y = array("Term.target", self.target, (2,)).tolist()
            put("target", (x, y))
        else:
            put("target", number("Term.target", self.target))

    @property
    def timed(self) -> bool:
        """Whether it counts for a time only."""
        return self.start > 0.0 or self.end is not None

    @property
    def places(self) -> list[tuple[int, float]]:
        """Coordinates of its point and the target of each."""
        axes = [0, 1] if self.axis is None else [AXES.index(self.axis)]
        target = self.target if isinstance(self.target, tuple) else (self.target, self.target)
        return [(axis, target[axis]) for axis in axes]


# of a task that is not planned: the sum of no terms
NO_COST = Cost(make_terms, [0.0], fixed=[1.0], steady=True)


def effort(weight: float) -> Term:
    """weight |u|^2."""
    return Term("square", weight, control=EVERY)


def terms(scene: Scene, running: Sequence[Term] = (), final: Sequence[Term] = ()) -> Cost:
    """The sum of the running terms over all steps and of the final terms at the last state.

    Args:
        scene: whose states, controls and bodies the terms name.
        running: of x_k and u_k, k = 0 .. N - 1.
        final: of x_N, of states and points only; at least one term of either is needed.

    Raises:
        ArgumentError: a name that the scene has not got, a final term of a control or for a time, or a time
            without a step.
    """
    instance("scene", scene, Scene, "a slcp_warp.Scene")
    rows, counts, points, spans = _rows(scene.state_names, scene.control_names, running, final)
    windows = None
    if any(span != ALWAYS for span in spans):
        windows = Windows(tuple(spans), scene.step_size)
        rows = np.concatenate([rows, np.zeros((len(rows), TIMED - FIELDS))], axis=1)
    return _cost(rows, counts, (2 * scene.nv, scene.nu), scene, tuple(points), windows)


def at_scene(cost: Cost, scene: Scene) -> Cost:
    """A cost of points with the lengths and chains of another scene's bodies, and one of times with its
    steps; any other cost as it is.

    Raises:
        ArgumentError: a body that the scene has not got, or a time without a step.
    """
    return with_points_of(cost.in_steps_of(scene.step_size), scene)


def with_points_of(cost: Cost, scene: Scene) -> Cost:
    """A cost of points with the lengths and chains of another scene's bodies; any other cost as it is.

    Raises:
        ArgumentError: a body that the scene has not got.
    """
    if not cost.points:
        return cost
    count = int(np.atleast_2d(cost.weights)[0, -1])
    start = 1 + numbers_of_term(cost) * count
    more = np.array([*point_numbers(scene, cost.points, start), count])
    own = cost.weights[..., :start]
    weights = np.concatenate([own, np.broadcast_to(more, (*own.shape[:-1], len(more)))], axis=-1)
    if np.array_equal(weights, cost.weights):
        return cost
    fixed = np.concatenate([cost.fixed[:start], np.ones(len(more))])
    found = Cost(cost.make, weights, nx=2 * scene.nv, nu=scene.nu, fixed=fixed, steady=cost.steady)
    found.points, found.windows = cost.points, cost.windows
    return found


def numbers_of_term(cost: Cost) -> int:
    """How many weights a term of a sum has."""
    return FIELDS if cost.windows is None else TIMED


def sum_of(
    states: Sequence[str], controls: Sequence[str], running: Sequence[Term], final: Sequence[Term] = ()
) -> Cost:
    """`terms`, without points, for states and controls of these names."""
    rows, counts, points, spans = _rows(states, controls, running, final)
    for what, there in (("of a point", points), ("for a time", [each for each in spans if each != ALWAYS])):
        if there:
            raise ArgumentError(f"running and final hold a term {what}, which only a scene's cost has")
    return _cost(rows, counts, (len(states), len(controls)))


def _cost(
    rows: np.ndarray, counts: list[int], sizes: tuple[int, int], scene: Scene | None = None,
    points: tuple[Point, ...] = (), windows: Windows | None = None,
) -> Cost:  # fmt: skip
    """The sum of rows of numbers of terms, of which some may be of points of a scene, or for a time."""
    naming = np.zeros(rows.shape)
    naming[:, [*NAMING, *range(FIELDS, rows.shape[1])]] = 1.0
    weights = np.concatenate([[counts[0]], rows.reshape(-1)])
    fixed = np.concatenate([[1.0], naming.reshape(-1)])
    if windows is not None:
        weights = windows.into(weights)
    if points:
        assert scene is not None
        more = [*point_numbers(scene, points, len(weights)), len(rows)]
        weights, fixed = np.concatenate([weights, more]), np.concatenate([fixed, np.ones(len(more))])
    make = SUMS[2 * bool(points) + (windows is not None)]
    cost = Cost(make, weights, *sizes, fixed=fixed, steady=windows is None)
    cost.points, cost.windows = points, windows
    return cost


def _rows(
    states: Sequence[str], controls: Sequence[str], running: Sequence[Term], final: Sequence[Term]
) -> tuple[np.ndarray, list[int], list[Point], list[tuple[float, float | None]]]:
    """(terms, FIELDS) numbers, how many are running and final ones, the points that they are of, and when
    each running one counts.
    """
    rows: list[tuple[float, ...]] = []
    counts: list[int] = []
    points: list[Point] = []
    spans: list[tuple[float, float | None]] = []
    for name, group in (("running", running), ("final", final)):
        if not isinstance(group, list | tuple) or not all(isinstance(each, Term) for each in group):
            raise ArgumentError(f"{name} is {shown(group)}; a list of costs.Term is needed")
        before = len(rows)
        for i, each in enumerate(group):
            label = f"{name}[{i}]"
            if name == "final" and each.control is not None:
                raise ArgumentError(
                    f"{label}.control is {shown(each.control)}; no control follows the last state"
                )
            if name == "final" and each.timed:
                raise ArgumentError(
                    f"{label} has start {each.start:g} s and end {shown(each.end)}; of the last state alone "
                    "neither is needed"
                )
            for place, target, less in _places(label, each, states, controls, points):
                rows.append((KINDS.index(each.kind), place, each.weight, target, each.width, less))
                spans += [(each.start, each.end)] if name == "running" else []
        counts.append(len(rows) - before)
    if not rows:
        every = "" if controls or not (running or final) else " but of controls, of which there are none"
        raise ArgumentError(f"running and final hold no term{every}; at least one is needed")
    return np.array(rows, float), counts, points, spans


def _places(
    label: str, term: Term, states: Sequence[str], controls: Sequence[str], points: list[Point]
) -> list[tuple[int, float, int]]:
    """A term's components among states, then controls, then coordinates of points; the target of each, and
    what is taken off.
    """
    nx = len(states)
    if term.point is not None:
        begin = nx + max(len(controls), 1)
        point, less = (
            -1 if each is None else begin + 2 * _listed(points, each) for each in (term.point, term.minus)
        )
        return [(point + axis, target, less + axis if less >= 0 else -1) for axis, target in term.places]
    assert isinstance(term.target, float)
    minus = term.minus
    less = -1 if minus is None else index_of(f"{label}.minus", minus, states)  # type: ignore[arg-type]
    if term.state is not None:
        return [(index_of(f"{label}.state", term.state, states), term.target, less)]
    every = range(len(controls))
    if term.control != EVERY:
        every = range((i := index_of(f"{label}.control", term.control, controls)), i + 1)  # type: ignore[arg-type]
    return [(nx + i, term.target, less) for i in every]


def _listed(points: list[Point], point: object) -> int:
    """The place of a point, which is put behind the others if it is a new one."""
    assert isinstance(point, Point)
    if point not in points:
        points.append(point)
    return points.index(point)
