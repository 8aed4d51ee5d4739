"""Tables in CSV files: written whole, read within bounds and only if no row is cut off."""

import csv
import io
import math
from pathlib import Path
from typing import Any

from slcp_warp.storage.files import FileError, opened, read_text, reading, replacing

MOST_TABLE = 64 * 2**20  # bytes of a table
LONGEST_LINE = 2**16  # bytes
RESULTS = "results.csv"  # of `slcp bench charts`, in its folder


def write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    """Write rows; columns in order of first appearance, empty where a row has no value.

    An existing file is replaced only once the new one is complete.
    """
    columns = list(dict.fromkeys(key for row in rows for key in row))
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, restval="")
        writer.writeheader()
        writer.writerows(rows)


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
        header = lines[0] if lines else []
        missing = [name for name in needed if name not in header]
        if missing:
            raise FileError(f"it has no columns {', '.join(missing)}")
        if len(set(header)) < len(header):
            raise FileError("two of its columns have the same name")
        if len(lines) < 2:
            raise FileError("it has no rows")
        for number, line in enumerate(lines, start=1):
            if len(line) != len(header) or (number == len(lines) and not text.endswith("\n")):
                raise FileError(f"it is cut off or damaged: line {number} is not whole")
        return [dict(zip(header, line)) for line in lines[1:]]


def is_results(path: Path) -> bool:
    """Whether a CSV file has the columns of `slcp bench charts`, by its first line. Raises FileError."""
    return has_columns(path, {"study", "program"})


def has_columns(path: Path, names: set[str]) -> bool:
    """Whether a CSV file has these columns, by its first line. Raises FileError."""
    with reading(path, "a table", FileError), opened(path, MOST_TABLE) as file:
        line = file.readline(LONGEST_LINE).decode("utf-8", errors="replace")
        return names <= set(next(csv.reader([line]), []))


def number(path: Path, row: dict[str, str], name: str, finite: bool = True) -> float:
    """A row's number. Raises FileError."""
    try:
        value = float(row[name])
        if finite and not math.isfinite(value):
            raise ValueError
    except ValueError:
        raise FileError(f"{path}: {name} is {row[name]!r:.60}; a number is needed") from None
    return value
