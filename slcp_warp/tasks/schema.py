"""JSON schema of a task file, read off the classes that its tables describe."""

import json
from typing import Any

from slcp_warp.kernels.control.cost_terms import KINDS as TERMS
from slcp_warp.kernels.ensembles.measures import REDUCTIONS

from ..costs import Point, Term
from ..description.points import AXES
from ..description.scene import Scene
from ..description.scene_schema import NO_VALUE, object_schema, part_schemas
from ..measures.arithmetic import MOST_FACTORS
from ..options import CHOICES, Options
from ..scenes import NAMED as SCENES
from .disturbances.notation import schemas as disturbance_schemas
from .files import FIELDS_OF_FILE, FORMAT, NEEDED, SCENE_VERSION, VERSION
from .notation import BOUNDS, FLAGS, JOINS, KINDS, SHORT

NUMBER, TEXT, NAME = {"type": "number"}, {"type": "string"}, {"type": ["string", "integer"]}


def json_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of a task file."""
    limit = {"anyOf": [NUMBER, {"enum": [None, NO_VALUE]}]}
    limits = {"anyOf": [limit, {"type": "array", "items": limit}]}
    group = {"type": "array", "items": _to("Term")}
    properties: dict[str, Any] = {
        "$schema": TEXT,
        "format": {"const": FORMAT},
        "version": {"enum": list(SCENE_VERSION)},
        "name": TEXT,
        "scene": {
            "description": "a scene; a file beside this one; or one of " + ", ".join(SCENES),
            "anyOf": [TEXT, _to("Scene")],
        },
        "step_size": NUMBER,
        "sigma": NUMBER,
        "cost": _table({"running": group, "final": group}),
        "horizon": {"type": "integer", "minimum": 1},
        "duration": {"anyOf": [NUMBER, {"type": "null"}]},
        "options": _to("Options"),
        "control_limits": {"type": "array", "items": limits, "minItems": 2, "maxItems": 2},
        "state_limits": {
            "type": "object",
            "additionalProperties": {"type": "array", "items": limit, "minItems": 2, "maxItems": 2},
        },
        "start": {
            "anyOf": [
                {"type": "object", "additionalProperties": NUMBER},
                {"type": "array", "items": {"anyOf": [NUMBER, {"type": "array", "items": NUMBER}]}},
            ]
        },
        "disturbances": _to("Disturbances"),
        "measures": {"type": "object", "additionalProperties": _to("Measure")},
        "success": _to("Success"),
        "failure": _to("Condition"),
        "observation": {"type": "array", "items": TEXT, "minItems": 1},
        "periods": {"type": "object", "additionalProperties": {"anyOf": [NUMBER, {"const": "turn"}]}},
    }
    assert tuple(properties) == FIELDS_OF_FILE
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"{FORMAT} {VERSION}",
        **_table(properties, ("format", "version", *NEEDED)),
        "$defs": _parts(),
    }


def _parts() -> dict[str, Any]:
    measure = {
        "reduction": {"enum": [*REDUCTIONS, *SHORT]},
        "of": {"anyOf": [_to("Signal"), _to("Condition")]},
        "start": NUMBER,
        "end": NUMBER,
        "where": _to("Condition"),
    }
    named = {"anyOf": [NAME, _to("Point")]}
    signal: dict[str, Any] = {"kind": {"enum": list(KINDS)}, "which": named, "minus": named}
    signal |= {"axis": {"enum": list(AXES)}}
    signal |= dict.fromkeys(FLAGS, {"type": "boolean"})
    factors = {"type": "array", "items": _to("Signal"), "maxItems": MOST_FACTORS}
    signal["terms"] = {"type": "array", "items": _table({"weight": NUMBER, "of": factors}, ()), "minItems": 1}
    return {
        "Term": object_schema(Term, {"kind": TERMS, "axis": (*AXES, None)}),
        "Point": object_schema(Point),
        "Options": object_schema(Options, CHOICES),
        **disturbance_schemas(),
        "Signal": {"anyOf": [NAME, _table(signal, ("kind",))]},
        "Condition": _joined("Condition", {"of": _to("Signal")}),
        "Measure": _table(measure, ("reduction", "of")),
        "Success": _joined("Success", {"measure": TEXT, **measure}),
        "Scene": object_schema(Scene),
        **part_schemas(),
    }


def _joined(name: str, compared: dict[str, Any]) -> dict[str, Any]:
    """Comparisons: a bound on what is compared, or lists of them."""
    ends = {"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2}
    bounds = {bound: ends if bound == "between" else NUMBER for bound in BOUNDS}
    joins = {join: {"type": "array", "items": _to(name), "minItems": 1} for join in JOINS}
    return _table({**compared, **bounds, **joins})


def _table(properties: dict[str, Any], required: tuple[str, ...] = ()) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": list(required),
        "additionalProperties": False,
    }


def _to(name: str) -> dict[str, str]:
    return {"$ref": f"#/$defs/{name}"}


# python -m slcp_warp.tasks.schema > slcp_warp/tasks/task_schema.json
if __name__ == "__main__":
    print(json.dumps(json_schema(), indent=2))
