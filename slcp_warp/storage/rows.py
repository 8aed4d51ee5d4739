"""Rows of numbers and names as a .csv file: written whole, read only if no row is cut off."""

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ..inputs import checks
from ..inputs.errors import ArgumentError
from .files import FileError, read_text, reading, replacing

MOST_TABLE = 64 * 2**20  # bytes of a table


def save_rows(path: str | Path, head: Iterable[str], rows: Iterable[Sequence[Any]]) -> Path:
    """Write a heading and rows as .csv; replaced only once complete.

    Raises:
        ArgumentError: a path with another ending.
    """
    path = checks.path("path", path)
    if path.suffix != ".csv":
        raise ArgumentError(f"path {path} ends in {path.suffix!r}; .csv is needed")
    with replacing(path) as part, open(part, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(head)
        writer.writerows(rows)
    return path


def read_csv(path: Path, what: str, needed: tuple[str, ...]) -> list[dict[str, str]]:
    """Rows as texts by column.

    Args:
        what: what it is read as, "results of `slcp bench charts`".
        needed: columns that must be there.

    Raises:
        FileError: no such table, or one that is cut off.
        FileNotFoundError: no such file.
    """
    with reading(path, what, FileError):
        text = read_text(path, MOST_TABLE)
        lines = list(csv.reader(io.StringIO(text, newline="")))
        header = [name.strip() for name in lines[0]] if lines else []
        missing = [name for name in needed if name not in header]
        if missing:
            raise FileError(f"it has no columns {', '.join(missing)}; it has {', '.join(header)!r:.200}")
        if len(set(header)) < len(header):
            raise FileError("two of its columns have the same name")
        if len(lines) < 2:
            raise FileError("it has no rows")
        for number, line in enumerate(lines, start=1):
            if len(line) != len(header) or (number == len(lines) and not text.endswith("\n")):
                raise FileError(f"it is cut off or damaged: line {number} is not whole")
        return [dict(zip(header, line)) for line in lines[1:]]
