"""What the page may ask: each message checked before the engine sees it."""

import json
import sys
from typing import Any

MOST_BYTES = 4096
POINT = 1e6  # m: no cursor is further away
LARGEST = sys.float_info.max
FIELDS: dict[str, dict[str, type]] = {  # what is to be done -> what belongs to it
    "grab": {"at": list, "world": int},
    "drag": {"at": list},
    "release": {},
    "set": {"name": str, "value": float},
    "variant": {"name": str},
    "policy": {"name": str},
    "pause": {"value": bool},
    "step": {},
    "reset": {},
    "record": {"value": bool},
    "push": {"name": str},
    "seek": {"value": float},
    "got": {"value": int},
}


def parsed(text: str | bytes) -> dict[str, Any]:
    """A message.

    Raises:
        ValueError: not of the page's.
    """
    if isinstance(text, bytes) or len(text) > MOST_BYTES:
        raise ValueError(f"a text of at most {MOST_BYTES} bytes is needed")
    try:
        message = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"no JSON: {error}") from None
    do = message.get("do") if isinstance(message, dict) else None
    if not isinstance(do, str) or do not in FIELDS:
        raise ValueError(f"{text[:80]!r} asks for nothing that there is")
    fields = FIELDS[do]
    if set(message) != {"do", *fields}:
        raise ValueError(f"{do} has {sorted(message)}; {sorted({'do', *fields})} are needed")
    for name, kind in fields.items():
        message[name] = _value(f"{do}.{name}", message[name], kind)
    return message


def _value(label: str, value: Any, kind: type) -> Any:
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        if abs(value) <= LARGEST:
            return float(value)
    elif kind is list:
        if isinstance(value, list) and len(value) == 2:
            return [_value(label, each, float) for each in value if _within(label, each)]
    elif isinstance(value, kind) and not (kind is int and isinstance(value, bool)):
        return value
    raise ValueError(f"{label} is {value!r:.40}; a {kind.__name__} is needed")


def _within(label: str, value: Any) -> bool:
    if isinstance(value, int | float) and abs(value) <= POINT:
        return True
    raise ValueError(f"{label} is {value!r:.40}; a point within {POINT:g} m is needed")
