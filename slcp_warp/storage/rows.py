"""Rows of numbers and names as a .csv file."""

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ..inputs import checks
from ..inputs.errors import ArgumentError
from .files import replacing


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
