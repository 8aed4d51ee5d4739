"""What the rows of a sweep must be, wherever they come from: one check for files of every form."""

import math
from typing import Any

import numpy as np

from ...options import Status
from ...storage.files import FileError
from ..chunks import ARMS, KEYS
from .source import DRAWN, NOTED, OF_ROWS, RECORDED, Columns, Key, MemorySource

STATUSES = [int(each) for each in Status]


def checked_key(label: str, values: Any) -> Key:
    """Policy, case, step size and arm of a part.

    Raises:
        FileError: others than a part can have.
    """
    policy, case, step_size, arm = (values[name] for name in KEYS)
    for name, text in (("policy", policy), ("case", case)):
        if not isinstance(text, str) or not text:
            raise FileError(f"{label}: {name} is {text!r:.60}; a text is needed")
    if (
        not isinstance(step_size, int | float)
        or isinstance(step_size, bool)
        or not 0.0 < step_size < math.inf
    ):
        raise FileError(f"{label}: step_size is {step_size!r:.60}; a positive and finite number is needed")
    if arm not in ARMS:
        raise FileError(f"{label}: arm is {arm!r:.60}; {' or '.join(map(repr, ARMS))} is needed")
    return policy, case, float(step_size), arm


def check_rows(label: str, rows: Columns) -> None:
    """Raise FileError unless the rows of a part are such as a sweep gives."""
    world, success, status = (rows[name] for name in OF_ROWS)
    if world.dtype.kind not in "iu" or (len(world) and world[0] < 0) or (np.diff(world) <= 0).any():
        raise FileError(f"{label}: column 'world' holds no rising whole numbers of at least 0")
    if success.dtype.kind != "b":
        raise FileError(f"{label}: column 'success' is of type {success.dtype}; True or False is needed")
    unknown = np.setdiff1d(status, STATUSES)
    if status.dtype.kind not in "iu" or len(unknown):
        first = unknown[0] if len(unknown) else f"of type {status.dtype}"
        raise FileError(f"{label}: column 'status' holds {first}; one of {STATUSES} is needed")
    unsolved = status != Status.SOLVED
    if (success & unsolved).any():
        first = int(np.argmax(success & unsolved))
        raise FileError(
            f"{label}: world {world[first]} is a success, with status {status[first]}; only solved worlds are"
        )
    for name, column in rows.items():
        if name.startswith(DRAWN) and np.isnan(column).any():
            raise FileError(f"{label}: column {name!r} holds nan; what was drawn is a number")
        if name in NOTED and (column.dtype.kind != "f" or (column < 0.0).any()):
            raise FileError(f"{label}: column {name!r} holds less than 0, or no numbers")
        if name in OF_ROWS + NOTED or name.startswith((DRAWN, RECORDED)):
            continue
        if column.dtype.kind != "f" or not np.isnan(column[unsolved]).all():
            raise FileError(
                f"{label}: measure {name!r} has numbers of worlds that were not solved; NaN is needed"
            )


def all_there(source: MemorySource) -> str:
    """What shows that rows are missing, in words; empty where nothing does."""
    counts: dict[str, int] = {}
    for key in source.keys:
        (rows,) = source.pieces[key]
        missing = np.setdiff1d(np.arange(len(rows["world"])), rows["world"])
        if len(missing):
            return f"part {key} has no row of world {missing[0]}"
        if key[3] == ARMS[0] and counts.setdefault(ARMS[0], len(rows["world"])) != len(rows["world"]):
            return f"part {key} has {len(rows['world'])} worlds, the first of its arm {counts[ARMS[0]]}"
    return ""
