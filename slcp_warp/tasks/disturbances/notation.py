"""Disturbances as the data of a file.

A distribution is {uniform = [low, high]}, {uniform_factor = [low, high]}, {normal = sd, mean = 0.0} or
{log_normal = sd, median = 1.0}, each with shared = true or "bodies" where it is; a number stands for a plain
one (`Disturbances`), of a push or a dropout for itself. A push is {body, start, duration, force = [x, y],
torque, at = [x, y]}, a dropout {start, duration}. What follows is {state = "parameter"} or {state =
{parameter = factor}}.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from ...inputs.errors import InputError
from ...storage.tables import below, entries, place, table
from ..notation import NotationError
from .distributions import BODIES, KINDS, Distribution, LogNormal, Normal, Uniform, UniformFactor
from .disturbances import Disturbances
from .events import Dropout, Push

FIELDS = tuple(each.name for each in dataclasses.fields(Disturbances))
DRAWN = {"start": Normal, "parameters": LogNormal, "kicks": Normal}  # by name, and what a number stands for
TIMING = ("delay", "hold")  # a number or a distribution
EVENTS = {"pushes": Push, "dropouts": Dropout}
MORE = {"log_normal": ("median", "shared"), "normal": ("mean", "shared"), "uniform": ("shared",)}
MORE["uniform_factor"] = MORE["uniform"]
EVEN = ("uniform", "uniform_factor")  # of two ends


def distribution_of(value: Any, where: str) -> Any:
    """A distribution from its table; anything else as it is."""
    if not isinstance(value, dict):
        return value
    kinds = [kind for kind in KINDS if kind in value]
    if len(kinds) != 1:
        table(where, value, (*KINDS, "mean", "median", "shared"), (), NotationError)
        raise NotationError(
            place(where, f"{' and '.join(kinds) or 'no distribution'}; one of {', '.join(KINDS)} is needed")
        )
    kind = kinds[0]
    given = dict(table(where, value, (kind, *MORE[kind]), (kind,), NotationError))
    numbers = given.pop(kind)
    if kind in EVEN and (not isinstance(numbers, list) or len(numbers) != 2):
        raise NotationError(f"{below(where, kind)}: {numbers!r:.60}; [low, high] is needed")
    arguments = numbers if kind in EVEN else [numbers]
    return _made(where, lambda: KINDS[kind](*arguments, **given))


def disturbances_of(value: Any, where: str) -> Disturbances:
    """Disturbances from their data."""
    given = dict(table(where, value, FIELDS, (), NotationError))
    for name in DRAWN:
        if isinstance(given.get(name), dict):
            at = below(where, name)
            given[name] = {key: distribution_of(each, f"{at}, {key}") for key, each in given[name].items()}
    for name in TIMING:
        if name in given:
            given[name] = distribution_of(given[name], below(where, name))
    for name, kind in EVENTS.items():
        if name in given:
            at = below(where, name)
            listed = enumerate(entries(at, given[name], NotationError))
            given[name] = tuple(_event(kind, each, f"{at}[{n}]") for n, each in listed)
    found: Disturbances = _made(where, lambda: Disturbances(**given))
    return found


def _event(kind: type, value: Any, where: str) -> Any:
    fields = dataclasses.fields(kind)
    needed = [each.name for each in fields if each.default is dataclasses.MISSING]
    given = dict(table(where, value, [each.name for each in fields], needed, NotationError))
    for name, each in given.items():
        at = below(where, name)
        drawn = [distribution_of(part, at) for part in each] if isinstance(each, list) else each
        given[name] = distribution_of(drawn, at)
    return _made(where, lambda: kind(**given))


def _made(where: str, make: Callable[[], Any]) -> Any:
    try:
        return make()
    except NotationError:
        raise
    except InputError as error:
        raise NotationError(place(where, str(error))) from error


def disturbances_content(disturbances: Disturbances) -> dict[str, Any]:
    """Disturbances as data: what differs from none."""
    out: dict[str, Any] = {}
    for each in dataclasses.fields(Disturbances):
        value = getattr(disturbances, each.name)
        if value == getattr(Disturbances(), each.name):
            continue
        if each.name in DRAWN:
            plain = DRAWN[each.name]
            value = {key: distribution_content(drawn, plain) for key, drawn in value.items()}
        elif each.name in EVENTS:
            value = [_event_content(event) for event in value]
        elif isinstance(value, Mapping | tuple):
            value = dict(value) if isinstance(value, Mapping) else list(value)
        out[each.name] = distribution_content(value)
    return out


def distribution_content(value: Any, plain: type | None = None) -> Any:
    """A number or a distribution as data; one of the plain kind as its standard deviation."""
    if not isinstance(value, Distribution):
        return value
    kind = next(name for name, each in KINDS.items() if isinstance(value, each))
    if isinstance(value, Uniform | UniformFactor):
        numbers: Any = [value.low, value.high]
    else:
        numbers = value.sd  # type: ignore[attr-defined]
    others = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)  # type: ignore
              if field.name in MORE[kind] and getattr(value, field.name) != field.default}  # fmt: skip
    return numbers if isinstance(value, plain or ()) and not others else {kind: numbers} | others


def _event_content(event: Any) -> dict[str, Any]:
    out = {}
    for field in dataclasses.fields(event):
        value = getattr(event, field.name)
        if value != field.default:
            pair = isinstance(value, tuple)
            out[field.name] = (
                [distribution_content(part) for part in value] if pair else distribution_content(value)
            )
    return out


def schemas() -> dict[str, Any]:
    """The JSON schemas of these data, by name."""
    number: dict[str, Any] = {"type": "number"}
    pair = {"type": "array", "items": number, "minItems": 2, "maxItems": 2}
    drawn = {"anyOf": [number, {"$ref": "#/$defs/Distribution"}]}
    others = {"shared": {"enum": [False, True, BODIES]}}
    kinds = [
        _table({kind: pair if kind in EVEN else number}
               | {name: others.get(name, number) for name in MORE[kind]}, (kind,))
        for kind in KINDS
    ]  # fmt: skip
    by_name = {"type": "object", "additionalProperties": drawn}
    properties: dict[str, Any] = dict.fromkeys(FIELDS, number)
    properties |= dict.fromkeys(TIMING, {"anyOf": [number, {"$ref": "#/$defs/Distribution"}]})
    properties |= dict.fromkeys(DRAWN, by_name)
    properties |= {name: {"type": "array", "items": {"$ref": f"#/$defs/{kind.__name__}"}}
                   for name, kind in EVENTS.items()}  # fmt: skip
    properties["before"] = {"anyOf": [number, {"type": "array", "items": number}]}
    factors = {"type": "object", "additionalProperties": number}
    properties["follow"] = {
        "type": "object",
        "additionalProperties": {"anyOf": [{"type": "string"}, factors]},
    }
    properties["kick_times"] = {"type": "array", "items": number}
    properties["sensor"] = {"anyOf": [number, {"type": "object", "additionalProperties": number}]}
    event = {"start": drawn, "duration": drawn}
    force = {"type": "array", "items": drawn, "minItems": 2, "maxItems": 2}
    push = {"body": {"type": "string"}, **event, "force": force, "torque": drawn, "at": pair}
    return {
        "Disturbances": _table(properties),
        "Distribution": {"anyOf": kinds},
        "Push": _table(push, ("body", "start", "duration")),
        "Dropout": _table(event, ("start", "duration")),
    }


def _table(properties: dict[str, Any], required: tuple[str, ...] = ()) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": list(required),
        "additionalProperties": False,
    }
