"""Measures, conditions and success as the data of a file.

A signal is a state's name, or a table {kind, which, minus, axis, since_start, absolute, terms} of the fields
of `slcp_warp.measures`, in which a point is a table {body, at}, and a centre of mass one with at = "centre of
mass" and names of bodies. The terms of a sum are {weight, of = [SIGNAL, SIGNAL]}, products of at most two. A
condition compares one: {of = SIGNAL, above = 1.0}, with above, below or between = [low, high]; lists of them
are joined by {all = [...]} and {any = [...]}. A measure is {reduction, of, start, end, where}, the last a
condition. A success compares measures in the same way: {measure = NAME, between = [0, 1]}, or {reduction =
"final", of = "block.x", between = [0, 1]}.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from slcp_warp.kernels.ensembles.measures import REDUCTIONS, SIGNALS

from ..description.points import Point
from ..inputs.checks import choice, number
from ..inputs.errors import ArgumentError, InputError
from ..measures.arithmetic import Term
from ..measures.reductions import OF_CONDITIONS, Measure, Success, change, excursion
from ..measures.signals import Condition, Joined, Signal, Within, state
from ..storage.tables import below, entries, place, table

KINDS = tuple(kind for kind in SIGNALS if kind != "function")  # a function is no data
FLAGS = ("since_start", "absolute")
SIGNAL_FIELDS = ("kind", "which", "minus", "axis", *FLAGS, "terms")
TERM_FIELDS = ("weight", "of")
POINT_FIELDS = ("body", "at")
SHORT: dict[str, Callable[..., Measure]] = {"change": change, "excursion": excursion}  # of such signals
MEASURE_FIELDS = ("reduction", "of", "start", "end", "where")
BOUNDS = ("above", "below", "between")
JOINS = ("all", "any")
MOST_CLAUSES = 256  # of a condition or a success, written as any of all


class NotationError(ArgumentError):
    """Data that say no measure, condition or success; the message names the place."""


def signal_of(value: Any, where: str) -> Signal:
    """A signal from its data."""
    try:
        if not isinstance(value, dict):
            return state(value)
        values = table(where, value, SIGNAL_FIELDS, ("kind",), NotationError)
        choice(below(where, "kind"), values["kind"], KINDS, error=NotationError)
        values = {name: _point(given, below(where, name)) for name, given in values.items()}
        if "terms" in values:
            values["terms"] = _terms(values["terms"], below(where, "terms"))
        for name in ("which", "minus"):
            if (
                name in values
                and not isinstance(values[name], Point)
                and (not isinstance(values[name], str | int) or isinstance(values[name], bool))
            ):
                raise NotationError(f"{below(where, name)}: {values[name]!r:.60}; a name is needed")
        return Signal(**values)
    except NotationError:
        raise
    except InputError as error:
        raise NotationError(place(where, str(error))) from error


def _terms(given: Any, where: str) -> tuple[Term, ...]:
    """What a sum adds up from, from its data."""
    found = []
    for i, term in enumerate(entries(where, given, NotationError)):
        at = f"{where}[{i}]"
        values = table(at, term, TERM_FIELDS, (), NotationError)
        factors = entries(below(at, "of"), values.get("of", []), NotationError)
        weight = number(below(at, "weight"), values.get("weight", 1.0), error=NotationError)
        if any(isinstance(each, dict) and "terms" in each for each in factors):
            raise NotationError(place(below(at, "of"), "a sum in a sum; its terms stand beside the others"))
        signals = [signal_of(each, f"{below(at, 'of')}[{j}]") for j, each in enumerate(factors)]
        found.append((weight, tuple(signals)))
    return tuple(found)


def signal_content(signal: Signal) -> Any:
    """A signal as data."""
    if signal.kind not in KINDS:
        raise NotationError("a measure of a function is no data; tasks with one are Python files")
    if signal.plain:
        return signal.which
    fields = {name: getattr(signal, name) for name in SIGNAL_FIELDS}
    fields["terms"] = [_term_content(*term) for term in signal.terms] or None
    return {
        name: _point_content(value) if isinstance(value, Point) else value
        for name, value in fields.items()
        if value is not None and value is not False
    }


def _term_content(weight: float, factors: tuple[Signal, ...]) -> dict[str, Any]:
    """A term of a sum as data."""
    values = {"weight": weight, "of": [signal_content(each) for each in factors]}
    return {name: value for name, value in values.items() if value != (1.0 if name == "weight" else [])}


def _point_content(point: Point) -> dict[str, Any]:
    """A point as data."""
    body = list(point.body) if isinstance(point.body, tuple) else point.body
    at = point.at if isinstance(point.at, str) else list(point.at)
    return {name: value for name, value in (("body", body), ("at", at)) if value is not None}


def _point(value: Any, where: str) -> Any:
    """A point from its table; what is no table as it is."""
    if not isinstance(value, dict):
        return value
    given = dict(table(where, value, POINT_FIELDS, (), NotationError))
    return Point(**given)


def condition_of(value: Any, where: str) -> Condition:
    """A condition from its data."""
    found: Condition = _joined(value, where, _condition, ("of",))
    return found


def _condition(values: dict[str, Any], where: str) -> Any:
    return signal_of(table(where, values, ("of",), ("of",), NotationError)["of"], below(where, "of"))


def measure_of(value: Any, where: str) -> Measure:
    """A measure from its data."""
    values = dict(table(where, value, MEASURE_FIELDS, ("reduction", "of"), NotationError))
    choice(below(where, "reduction"), values["reduction"], (*REDUCTIONS, *SHORT), error=NotationError)
    read = condition_of if values["reduction"] in OF_CONDITIONS else signal_of
    values["of"] = read(values["of"], below(where, "of"))
    if "where" in values:
        values["where"] = condition_of(values["where"], below(where, "where"))
    try:
        if values["reduction"] in SHORT:
            return _short(values, where)
        return Measure(**values)
    except InputError as error:
        raise NotationError(place(where, str(error))) from error


def _short(values: dict[str, Any], where: str) -> Measure:
    """A measure of what is taken since the run's start."""
    name = values.pop("reduction")
    if name == "change" and "start" in values:
        raise NotationError(f"{below(where, 'start')}: a change is since the run's start; leave it out")
    return SHORT[name](values.pop("of"), **values)


def measure_content(measure: Measure) -> dict[str, Any]:
    """A measure as data."""
    of = signal_content(measure.of) if isinstance(measure.of, Signal) else condition_content(measure.of)
    counts = None if measure.where is None else condition_content(measure.where)
    said = {"start": measure.start or None, "end": measure.end, "where": counts}
    content = {"reduction": measure.reduction, "of": of}
    return content | {name: value for name, value in said.items() if value is not None}


def success_of(value: Any, measures: Mapping[str, Measure], where: str) -> Success:
    """A success from its data; measures by the names that it may use."""

    def measure(values: dict[str, Any], at: str) -> Any:
        if "measure" not in values:
            return measure_of(values, at)
        name = table(at, values, ("measure",), (), NotationError)["measure"]
        if not isinstance(name, str) or name not in measures:
            there = ", ".join(measures) or "none"
            raise NotationError(place(at, f"no measure {name!r:.60}; there are {there}"))
        return measures[name]

    found: Success = _joined(value, where, measure, ("measure", *MEASURE_FIELDS))
    return found


def success_content(success: Success, measures: Mapping[str, Measure]) -> dict[str, Any]:
    """A success as data."""
    names = {measure: name for name, measure in measures.items()}

    def content(measure: Measure) -> dict[str, Any]:
        return {"measure": names[measure]} if measure in names else measure_content(measure)

    return _any_of_all(success, content)


def condition_content(condition: Condition) -> dict[str, Any]:
    """A condition as data."""
    return _any_of_all(condition, lambda signal: {"of": signal_content(signal)})


def _joined(value: Any, where: str, compared: Callable[..., Any], fields: tuple[str, ...]) -> Any:
    """Comparisons joined by all and any; `compared`: what is compared, from a table without its bounds."""
    values = table(where, value, (*fields, *BOUNDS, *JOINS), (), NotationError)
    joins = [name for name in JOINS if name in values]
    if not joins:
        rest = {name: each for name, each in values.items() if name not in BOUNDS}
        return _compare(compared(rest, where), values, where)
    if len(values) > 1:
        raise NotationError(place(where, f"{', '.join(values)} together; {joins[0]} stands alone"))
    name = joins[0]
    parts = entries(below(where, name), values[name], NotationError)
    if not parts:
        raise NotationError(f"{below(where, name)}: at least one comparison is needed")
    out = None
    for i, part in enumerate(parts):
        found = _joined(part, f"{below(where, name)}[{i}]", compared, fields)
        if out is not None:
            a, b = len(out.clauses), len(found.clauses)
            if (a * b if name == "all" else a + b) > MOST_CLAUSES:
                raise NotationError(place(where, f"more than {MOST_CLAUSES} clauses, as any of all"))
        out = found if out is None else (out & found if name == "all" else out | found)
    return out


def _compare(compared: Any, values: dict[str, Any], where: str) -> Any:
    given = [name for name in BOUNDS if name in values]
    if len(given) != 1:
        raise NotationError(
            place(where, f"{' and '.join(given) or 'no bound'}; one of {', '.join(BOUNDS)} is needed")
        )
    bound, at = values[given[0]], below(where, given[0])
    try:
        if given[0] == "between":
            if not isinstance(bound, list) or len(bound) != 2:
                raise NotationError(f"{at}: {bound!r:.60}; [low, high] is needed")
            return compared.between(*bound)
        return compared > bound if given[0] == "above" else compared < bound
    except NotationError:
        raise
    except InputError as error:
        raise NotationError(f"{at}: {error}") from error


def _any_of_all(joined: Joined, content: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
    def one(within: Within) -> dict[str, Any]:
        if np.isinf(within.high):
            return content(within.of) | {"above": within.low}
        if np.isinf(within.low):
            return content(within.of) | {"below": within.high}
        return content(within.of) | {"between": [within.low, within.high]}

    clauses = [[one(within) for within in clause] for clause in joined.clauses]
    parts = [clause[0] if len(clause) == 1 else {"all": clause} for clause in clauses]
    return parts[0] if len(parts) == 1 else {"any": parts}
