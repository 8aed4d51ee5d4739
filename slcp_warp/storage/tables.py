"""Tables of TOML and JSON files: which keys they have and need, said where they stand."""

import difflib
from collections.abc import Collection
from typing import Any

MOST_ENTRIES = 4096  # of a list


def place(where: str, text: str) -> str:
    """A text with its place in a file."""
    return f"{where}: {text}" if where else text


def below(where: str, name: str) -> str:
    """The place of an entry."""
    return f"{where}, {name}" if where else name


def table(
    where: str,
    values: Any,
    known: Collection[str],
    needed: Collection[str] = (),
    error: type[Exception] = ValueError,
) -> dict[str, Any]:
    """A table of a file, whose keys are known, with those that are needed."""
    if not isinstance(values, dict):
        raise error(place(where, f"{values!r:.60}; a table of fields is needed"))
    for name in values:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            hint = f"; did you mean {near[0]!r}?" if near else f"; there are {', '.join(known)}"
            raise error(place(where, f"no field {name!r:.60}{hint}"))
    for name in needed:
        if name not in values:
            raise error(place(where, f"{name} is missing"))
    return values


def entries(where: str, values: Any, error: type[Exception] = ValueError) -> list[Any]:
    """A list of a file, of bounded length."""
    if not isinstance(values, list):
        raise error(f"{where}: {values!r:.60}; a list is needed")
    if len(values) > MOST_ENTRIES:
        raise error(f"{where}: {len(values)} entries; at most {MOST_ENTRIES} are read")
    return values
