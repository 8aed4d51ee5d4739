"""Signals: what a measure looks at in every step, and conditions on them.

In step k, at time k h, a signal is a number of the state x_k, the control u_k and the contacts of the step;
after the last step it is one of x_N and the last step's control and contacts.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.ensembles.measures import NONE, SIGNALS

from ..description.points import AXES, Point, point_numbers
from ..description.scene import Scene
from ..inputs.checks import choice, flag, number, shown
from ..inputs.errors import ArgumentError, ArgumentTypeError
from .arithmetic import Arithmetic, Term, check_terms, in_words

FORCES = ("normal_force", "tangential_force")
RUBS = ("tangential_impulse", "tangential_force")
OF_CONTACTS = ("contact", "gap", "impulse", "slip", "tangential_impulse", *FORCES)
OF_TENDONS = "tendon_force"
TRAPEZOIDAL = (
    "the trapezoidal rule meets springs in a way of its own; forces of tendons are of Euler's steps and the "
    "leapfrog's"
)
WITH_MINUS = ("state", "point", "distance")  # signals that another one may be taken off
NO_VALUE = (
    "there is no value yet: join comparisons with & and |, not with and, or; between two bounds is "
    ".between(low, high)"
)
SINCE = (
    "state",
    "cosine",
    "control",
    "function",
    "point",
    "distance",
)  # signals that have a value at the start


class Compared:
    """What `<`, `>` and `.between` make a condition of."""

    def __lt__(self, bound: float) -> Any:
        return self._within(-np.inf, number("the bound of <", bound))

    def __gt__(self, bound: float) -> Any:
        return self._within(number("the bound of >", bound), np.inf)

    def between(self, low: float, high: float) -> Any:
        """Whether the value is above low and below high."""
        low, high = number("low", low), number("high", high)
        if low >= high:
            raise ArgumentError(f"between has low {low} and high {high}; low must be below high")
        return self._within(low, high)

    def _within(self, low: float, high: float) -> Any:
        raise NotImplementedError

    def __bool__(self) -> bool:
        raise ArgumentTypeError(NO_VALUE)


@dataclass(frozen=True, repr=False)
class Signal(Compared, Arithmetic):
    """A number in every step; `+`, `-` and `*` of signals and numbers are signals, too.

    Attributes:
        kind: one of `SIGNALS`.
        which: a state, a control or a tendon by its name or its place; contact pairs, as `Scene.pairs_of`
            names them, None: all; or a `costs.Point`.
        minus: a state that is taken off a state, or a point off a point.
        axis: "x" or "y" of a point.
        function: a user's Warp function (x, u, time) -> number, of a signal of kind "function".
        since_start: less its value at the run's start.
        absolute: its absolute value, of what is left then.
        terms: of a sum, (weight, (signal, ...)) of at most two signals each, none of them a sum.
    """

    kind: str
    which: str | int | Point | None = None
    minus: str | int | Point | None = None
    function: Callable[..., Any] | None = None
    since_start: bool = False
    absolute: bool = False
    axis: str | None = None
    terms: tuple[Term, ...] = ()

    def __post_init__(self) -> None:
        choice("Signal.kind", self.kind, SIGNALS)
        check_terms(self)
        for name in ("since_start", "absolute"):
            flag(f"Signal.{name}", getattr(self, name))
        if self.since_start and self.kind not in SINCE:
            raise ArgumentError(f"Signal.since_start is of a {self.kind}; of {', '.join(SINCE)} it is taken")
        of_points = {"point": ("which",), "distance": ("which", "minus")}.get(self.kind, ())
        if self.minus is not None and self.kind not in WITH_MINUS:
            raise ArgumentError(
                f"minus of a {self.kind} is {shown(self.minus)}; it is of {', '.join(WITH_MINUS)}"
            )
        for name in ("which", "minus"):
            given = getattr(self, name)
            needed = name in of_points or (given is not None and bool(of_points))
            if needed != isinstance(given, Point):
                need = "a costs.Point" if of_points else "a name or a whole number"
                raise ArgumentTypeError(f"{name} of a {self.kind} is {shown(given)}; {need} is needed")
        if (self.kind == "point") != (isinstance(self.axis, str) and self.axis in AXES):
            raise ArgumentError(f"axis of a {self.kind} is {shown(self.axis)}; 'x' or 'y' is of a point")

    def __lt__(self, bound: Any) -> Any:
        return self - bound < 0.0 if isinstance(bound, Signal) else super().__lt__(bound)

    def __gt__(self, bound: Any) -> Any:
        return self - bound > 0.0 if isinstance(bound, Signal) else super().__gt__(bound)

    def parts(self) -> "list[Signal]":
        """Itself, and before it the signals that it is made from."""
        return [*dict.fromkeys(each for _, factors in self.terms for each in factors), self]

    def __abs__(self) -> "Signal":
        """Its absolute value."""
        return replace(self, absolute=True)

    @property
    def at_start(self) -> "Signal":
        """What is taken off one `since_start`, in the first step."""
        return replace(self, since_start=False, absolute=False)

    @property
    def plain(self) -> bool:
        """Whether it is a component of the state and nothing more."""
        return self.kind == "state" and self == Signal("state", self.which)

    def place(self, scene: Scene) -> int:
        """Its component in a scene; 0 of points and contacts, which have tables of their own.

        Raises:
            ArgumentError: the scene has none of this name.
        """
        if isinstance(self.which, Point):
            point_numbers(scene, [each for each in (self.which, self.minus) if isinstance(each, Point)], 0)
            return 0
        if self.kind in ("state", "cosine"):
            return scene.state_index(self.which)  # type: ignore[arg-type]
        if self.kind == "control":
            return scene.control_index(self.which)  # type: ignore[arg-type]
        if self.kind == OF_TENDONS:
            return scene.tendon_index(self.which)  # type: ignore[arg-type]
        if self.kind in OF_CONTACTS:
            self.pairs(scene)
        return 0

    def pairs(self, scene: Scene) -> tuple[int, ...]:
        """The pairs that one of contacts is of."""
        if self.which is None:
            return tuple(range(len(scene.pair_names)))
        return scene.pairs_of(self.which)  # type: ignore[arg-type]

    def less(self, scene: Scene) -> int:
        """The place of the state that is taken off it, -1: none."""
        return NONE if self.minus is None or isinstance(self.minus, Point) else scene.state_index(self.minus)

    def _within(self, low: float, high: float) -> "Condition":
        return Condition(((Within(self, low, high),),))

    def __repr__(self) -> str:
        """The expression that makes it, the names of `slcp_warp.measures` without the module."""
        name = {"impulse": "normal_impulse"}.get(self.kind, self.kind)
        if self.terms:
            return f"abs({in_words(self.terms)})" if self.absolute else in_words(self.terms)
        given = [getattr(self.function, "__name__", shown(self.function))] if self.function else []
        given += [repr(which) for which in (self.which, self.axis, self.minus) if which is not None]
        told = f"{name}({', '.join(given)})"
        told = f"since_start({told})" if self.since_start else told
        return f"abs({told})" if self.absolute else told


@dataclass(frozen=True, repr=False)
class Within:
    """Whether low < `of` < high; `of` is a signal, or a measure."""

    of: Any
    low: float
    high: float

    def holds(self, value: Any) -> Any:
        """The comparison itself; no bound holds for infinite values, too, NaN for none."""
        above = value > self.low if self.low > -np.inf else value == value
        return above & (value < self.high if self.high < np.inf else value == value)

    def distances(self, value: Any) -> tuple[Any, Any]:
        """How far a value is above the lower bound and below the upper one; inf where there is none."""
        none = np.where(np.isnan(value), np.nan, np.inf)
        return (
            value - self.low if self.low > -np.inf else none,
            self.high - value if self.high < np.inf else none,
        )

    def __repr__(self) -> str:
        if self.low == -np.inf:
            return f"{self.of!r} < {self.high:.12g}"
        if self.high == np.inf:
            return f"{self.of!r} > {self.low:.12g}"
        of = f"({self.of!r})" if getattr(self.of, "terms", ()) else repr(self.of)
        return f"{of}.between({self.low:.12g}, {self.high:.12g})"


@dataclass(frozen=True, repr=False)
class Joined:
    """Comparisons joined by & and |: any of the clauses, all of a clause's comparisons."""

    clauses: tuple[tuple[Within, ...], ...]

    def __and__(self, other: Any) -> Any:
        self._same(other, "&")
        return type(self)(tuple(a + b for a in self.clauses for b in other.clauses))

    def __or__(self, other: Any) -> Any:
        self._same(other, "|")
        return type(self)(self.clauses + other.clauses)

    def __bool__(self) -> bool:
        raise ArgumentTypeError(NO_VALUE)

    def __repr__(self) -> str:
        """The expression that makes it."""
        clauses = [self._joined(clause) for clause in self.clauses]
        if len(clauses) == 1:
            return clauses[0]
        return " | ".join(f"({clause})" for clause in clauses)

    @staticmethod
    def _joined(clause: tuple[Within, ...]) -> str:
        if len(clause) == 1:
            return repr(clause[0])
        return " & ".join(f"({within!r})" for within in clause)

    def _same(self, other: Any, sign: str) -> None:
        if type(other) is not type(self):
            raise ArgumentTypeError(f"{sign} joins {type(self).__name__.lower()} and {shown(other)}; "
                                    "both must be comparisons of the same kind")  # fmt: skip

    def parts(self) -> list[Any]:
        """What is compared, each once, in order."""
        return list(dict.fromkeys(within.of for clause in self.clauses for within in clause))

    def holds(self, values: dict[Any, np.ndarray]) -> np.ndarray:
        """Where it is true, for an array of every part."""
        return np.any([np.all([w.holds(values[w.of]) for w in c], axis=0) for c in self.clauses], axis=0)


class Condition(Joined):
    """Comparisons of signals: true or false in every step."""


def state(which: str | int, minus: str | int | None = None) -> Signal:
    """A component of the state, by its name (`Scene.state_names`) or its place, less another one."""
    return Signal("state", _name("which", which), None if minus is None else _name("minus", minus))


def since_start(signal: "Signal | str | int") -> Signal:
    """A signal, or a state by its name or its place, less its value at the run's start.

    Raises:
        ArgumentError: of an absolute value, or of what need not have a value at the start.
    """
    found = signal if isinstance(signal, Signal) else state(signal)
    if found.absolute:
        raise ArgumentError(f"signal is {found!r}; abs(since_start(...)) is what can be taken")
    return replace(found, since_start=True)


def cosine(which: str | int) -> Signal:
    """The cosine of an angle, for angles that may end a turn away."""
    return Signal("cosine", _name("which", which))


def control(which: str | int) -> Signal:
    """A control, by its name (`Scene.control_names`) or its place, as it acts."""
    return Signal("control", _name("which", which))


def time() -> Signal:
    """The time k h [s]."""
    return Signal("time")


def point(of: Point, axis: str, minus: Point | None = None) -> Signal:
    """Coordinate "x" or "y" of a `costs.Point` in the world [m], less that of another one.

    Lengths and angles of the bodies are the scene's own, whatever a world's parameters are.
    """
    return Signal("point", of, minus, axis=axis)


def distance(of: Point, to: Point) -> Signal:
    """Distance of two points [m]; lengths as of `point`."""
    return Signal("distance", of, to)


def contact(pair: str | int | None = None) -> Signal:
    """1 where a pair pushes with more than 1e-6 N s, else 0: one by its name (`Scene.pair_names`) or place,
    or any of those of two shapes, "left/box", of two bodies or of one, "box", or any at all.
    """
    return Signal("contact", None if pair is None else _name("pair", pair))


def gap(pair: str | int | None = None) -> Signal:
    """Distance of a pair before the step [m], or the lowest of several, named as of `contact`; infinite
    without any.
    """
    return Signal("gap", None if pair is None else _name("pair", pair))


def normal_impulse(pair: str | int | None = None) -> Signal:
    """Normal impulse of a pair in the step [N s], or of several together, named as of `contact`."""
    return Signal("impulse", None if pair is None else _name("pair", pair))


def normal_force(pair: str | int | None = None) -> Signal:
    """Normal impulse of a step over the step size [N], of a pair or of several together, named as of
    `contact`. Of what presses it is the force; of an impact it grows as steps get smaller.
    """
    return Signal("normal_force", None if pair is None else _name("pair", pair))


def tangential_impulse(pair: str | int | None = None) -> Signal:
    """Impulse of friction in the step [N s], on shape_b along the normal from shape_a to it turned by 90
    degrees counter-clockwise, of a pair or of several together, named as of `contact`.
    """
    return Signal("tangential_impulse", None if pair is None else _name("pair", pair))


def tangential_force(pair: str | int | None = None) -> Signal:
    """`tangential_impulse` over the step size [N]."""
    return Signal("tangential_force", None if pair is None else _name("pair", pair))


def slip(pair: str | int | None = None) -> Signal:
    """How fast a pair slides while it pushes [m/s]: the velocity of shape_b past shape_a where they touch,
    after the step, along the normal from a to b turned by 90 degrees counter-clockwise (J_t v' of (M6)); 0
    where it does not push (`contact`). Of several pairs, named as of `contact`, that of the fastest.
    """
    return Signal("slip", None if pair is None else _name("pair", pair))


def tendon_force(which: str | int) -> Signal:
    """How hard a tendon pulls in the step [N, N m], by its name or its place in the scene: spring, damper and
    actuators together, as the step meets them (M57), within its limit (M64), (M65); positive towards a
    greater length. That of a servo is what its motor gives. Not of the trapezoidal rule.
    """
    return Signal("tendon_force", _name("which", which))


def function(f: Callable[..., Any]) -> Signal:
    """A user's number: f(x, u, time), a Warp function of vectors x (nx,), u (nu,) and the time [s].

    Its arguments x and u are of `typing.Any`, or vectors of the sweep's precision; the time is a wp.float64.
    """
    if not isinstance(f, wp.Function):
        raise ArgumentTypeError(f"f is {shown(f)}; a Warp function f(x, u, time) is needed: @wp.func")
    return Signal("function", function=f)


def cost() -> Signal:
    """The task's running cost of a step; after the last step its final cost."""
    return Signal("cost")


def _name(label: str, which: Any) -> str | int:
    if isinstance(which, str) or (isinstance(which, int | np.integer) and not isinstance(which, bool)):
        return which if isinstance(which, str) else int(which)
    raise ArgumentTypeError(f"{label} is {shown(which)}; a name or a whole number is needed")
