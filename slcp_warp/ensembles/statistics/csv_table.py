"""The table of a sweep as .csv: its rows again, without the task, which such a file does not hold."""

from pathlib import Path

import numpy as np

from ...storage.files import FileError
from ...storage.rows import read_csv
from ..chunks import KEYS
from .row_checks import all_there, check_rows, checked_key
from .source import DRAWN, OF_ROWS, Columns, MemorySource

WHAT = "a report of a sweep"
TEXTS = ("policy", "case", "arm")
WHOLE = 2**53  # whole numbers that a table's texts say exactly


def read_table(path: Path) -> tuple[MemorySource, bool]:
    """The rows of a .csv file, and whether none is missing.

    Raises:
        FileNotFoundError: not there.
        FileError: no such table, or one that no sweep gives.
    """
    rows = read_csv(path, WHAT, (*KEYS, *OF_ROWS))
    try:
        columns = {name: _column(name, [row[name] for row in rows]) for name in rows[0]}
        keys = list(zip(*(columns.pop(key).tolist() for key in KEYS)))
        source = MemorySource()
        for key in dict.fromkeys(keys):
            named = checked_key(f"part {key}", dict(zip(KEYS, key)))
            part = _of_part(columns, np.array([other == key for other in keys]))
            check_rows(f"part {key}", part)
            source.add(named, part)
    except FileError as error:
        raise FileError(f"{path} cannot be read as {WHAT}: {error}") from None
    return source, not all_there(source)


def _of_part(columns: Columns, mine: np.ndarray) -> Columns:
    """The rows of a part by rising worlds; what was not drawn for it is empty in the table."""
    part = {name: column[mine] for name, column in columns.items()}
    order = np.argsort(part["world"], kind="stable")
    none = [name for name in part if name.startswith(DRAWN) and np.isnan(part[name]).all()]
    kept = {name: column[order] for name, column in part.items() if name not in none}
    return {"world": kept.pop("world"), **kept}


def _column(name: str, texts: list[str]) -> np.ndarray:
    if name in TEXTS:
        return np.array(texts)
    if name == "success":
        if wrong := set(texts) - {"True", "False"}:
            raise FileError(f"column 'success' holds {wrong.pop()!r:.60}; True or False is needed")
        return np.array([text == "True" for text in texts])
    try:
        column = np.array(texts, float)
    except ValueError as error:
        raise FileError(f"column {name!r}: {error}; numbers are needed") from None
    if name not in ("world", "status"):
        return column
    wrong = ~((column >= 0) & (column <= WHOLE) & (column == np.floor(column)))
    if wrong.any():
        raise FileError(f"column {name!r} holds {column[wrong][0]}; whole numbers of at least 0 are needed")
    return column.astype(np.int64)
