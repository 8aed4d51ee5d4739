"""Tables in CSV files: written whole, read within bounds and only if no row is cut off."""

import csv
import math
from pathlib import Path
from typing import Any

from slcp_warp.storage.files import FileError, opened, reading, replacing
from slcp_warp.storage.rows import MOST_TABLE, read_csv

__all__ = ["has_columns", "is_results", "number", "read_csv", "write_csv"]

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
