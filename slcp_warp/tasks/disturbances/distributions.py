"""Distributions of single numbers: around the number that there is, a factor on it, or in place of it."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from slcp_warp.kernels.ensembles.draws import LAWS

from ...inputs.checks import number, shown
from ...inputs.errors import ArgumentError, ArgumentTypeError

BODIES = "bodies"  # who share a draw: what is of one body, or between the same two
Row = tuple[int, Any, float, float]
MOST_SPREAD = 2.0  # of a logarithm: a factor of 50 at two standard deviations


class Distribution:
    """How a number is drawn for every world, from the seed and the world's number."""

    law: ClassVar[str] = LAWS[0]
    shared: bool | str

    def row(self, base: Any) -> Row:
        """Law, number that it is drawn around, the law's two numbers; base None: there is no number yet."""
        raise NotImplementedError

    def __post_init__(self) -> None:
        given: Any = self.shared
        if isinstance(given, np.bool_):
            given = bool(given)
        if not isinstance(given, bool | str) or given not in (True, False, BODIES):
            label = f"{type(self).__name__}.shared"
            raise ArgumentTypeError(f"{label} is {shown(given)}; True, False or {BODIES!r} is needed")
        object.__setattr__(self, "shared", given)


def _number(of: Distribution, name: str, low: float = -float("inf"), high: float = float("inf")) -> None:
    label = f"{type(of).__name__}.{name}"
    object.__setattr__(of, name, number(label, getattr(of, name), low, high))


@dataclass(frozen=True)
class LogNormal(Distribution):
    """The number that there is times median * exp(sd z), z standard normal; of an event: that factor alone.

    Attributes:
        sd: standard deviation of the logarithm, below 2.
        median: of the factor, above 0.
        shared: True: all components of a parameter take the same draw; "bodies": those of one body do, and of
            pairs of shapes those between the same two bodies (the corners of a box on the ground).
    """

    law: ClassVar[str] = "log-normal"
    sd: float
    median: float = 1.0
    shared: bool | str = False

    def __post_init__(self) -> None:
        super().__post_init__()
        _number(self, "sd", 0.0)
        object.__setattr__(self, "median", number("LogNormal.median", self.median, 0.0, above=True))
        if self.sd >= MOST_SPREAD:
            raise ArgumentError(f"LogNormal.sd is {self.sd}; a number in [0, {MOST_SPREAD}) is needed")

    def row(self, base: Any) -> Row:
        """See `Distribution`."""
        return LAWS.index(self.law), (1.0 if base is None else base) * self.median, self.sd, 0.0


@dataclass(frozen=True)
class Normal(Distribution):
    """The number that there is plus mean + sd z, z standard normal; of an event: that alone.

    Attributes:
        sd: standard deviation [unit of the number].
        mean: what is added beside it.
        shared: True: all components of a parameter take the same draw; "bodies": those of one body do, and of
            pairs of shapes those between the same two bodies (the corners of a box on the ground).
    """

    law: ClassVar[str] = "normal"
    sd: float
    mean: float = 0.0
    shared: bool | str = False

    def __post_init__(self) -> None:
        super().__post_init__()
        _number(self, "sd", 0.0)
        _number(self, "mean")

    def row(self, base: Any) -> Row:
        """See `Distribution`."""
        return LAWS.index(self.law), (0.0 if base is None else base) + self.mean, self.sd, 0.0


@dataclass(frozen=True)
class Uniform(Distribution):
    """A number evenly from [low, high], in place of the one that there is.

    Attributes:
        low, high: ends [unit of the number].
        shared: True: all components of a parameter take the same draw; "bodies": those of one body do, and of
            pairs of shapes those between the same two bodies (the corners of a box on the ground).
    """

    law: ClassVar[str] = "uniform"
    low: float
    high: float
    shared: bool | str = False

    def __post_init__(self) -> None:
        super().__post_init__()
        _number(self, "low")
        _number(self, "high", self.low)

    def row(self, base: Any) -> Row:
        """See `Distribution`."""
        return _evenly(0.0 if base is None else base, self.low, self.high)


@dataclass(frozen=True)
class UniformFactor(Distribution):
    """The number of a parameter times a factor evenly from [low, high]; of an event that factor alone.

    Attributes:
        low, high: of the factor, above 0.
        shared: True: all components of a parameter take the same draw; "bodies": those of one body do, and of
            pairs of shapes those between the same two bodies (the corners of a box on the ground).
    """

    law: ClassVar[str] = "uniform"
    low: float
    high: float
    shared: bool | str = False

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "low", number("UniformFactor.low", self.low, 0.0, above=True))
        _number(self, "high", self.low)

    def row(self, base: Any) -> Row:
        """See `Distribution`; of one that is negative the lower end is the upper one."""
        around = 1.0 if base is None else float(base)
        return _evenly(around, self.low * around, self.high * around)


def _evenly(base: Any, low: float, high: float) -> Row:
    """A row of numbers between two ends, whichever is above; one number alone is none that is drawn."""
    if low == high:
        return LAWS.index(Normal.law), low, 0.0, 0.0
    return LAWS.index(Uniform.law), base, low, high


KINDS = {"log_normal": LogNormal, "normal": Normal, "uniform": Uniform, "uniform_factor": UniformFactor}


def of(label: str, value: Any, plain: type[LogNormal] | type[Normal]) -> Distribution:
    """A distribution, or a number that is the standard deviation of a plain one."""
    if isinstance(value, Distribution):
        return value
    given = number(label, value, 0.0)
    if plain is LogNormal and given >= MOST_SPREAD:
        raise ArgumentError(f"{label} is {given}; a number in [0, {MOST_SPREAD}) is needed")
    return plain(given)


def fixed_or_drawn(label: str, value: Any, low: float = -float("inf")) -> "float | Distribution":
    """A number of at least `low`, or how it is drawn, never below that."""
    if not isinstance(value, Distribution):
        return number(label, value, low)
    if isinstance(value, Normal) and low > -float("inf"):
        raise ArgumentTypeError(
            f"{label} is {shown(value)}, which may fall below {low:g}; use LogNormal or Uniform"
        )
    if isinstance(value, Uniform) and value.low < low:
        raise ArgumentError(f"{label} is {shown(value)}; numbers of at least {low:g} are needed")
    return value


def row_of(value: "float | Distribution", base: Any = None) -> Row:
    """As `Distribution.row`, for a number that is not drawn as well."""
    return value.row(base) if isinstance(value, Distribution) else (0, value, 0.0, 0.0)
