"""The studies' one file: a tidy CSV, a row per point, written whole and read with its numbers as numbers."""

import csv
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..bench_timing import write_csv

Rows = list[dict[str, Any]]
NEEDED = ("study", "problem", "program", "curve", "knob", "value")
TEXT = {"version", "cpu", "system", "python", "slcp-warp", "warp-lang", "numpy", "mujoco", "commit", "time"}
SAME = ("commit", "cpu", "cores", "slcp-warp", "warp-lang", "mujoco")  # of rows that may stand side by side


class ResultsError(ValueError):
    """A file that is no whole file of results."""


def is_results(path: Path) -> bool:
    """Whether a CSV file has the studies' columns, by its first line."""
    with open(path, newline="", encoding="utf-8", errors="replace") as file:
        header = next(csv.reader(file), [])
    return {"study", "program"} <= set(header)


def write_results(path: Path, rows: Rows) -> None:
    """Write the file; an existing one is replaced only once the new one is complete."""
    part = path.with_name(path.name + ".part")
    write_csv(part, rows)
    part.replace(path)


def read_results(path: Path) -> Rows:
    """Rows of a file, numbers as numbers; "" where a row has no value.

    Raises:
        ResultsError: the file is cut off, or not of `slcp bench charts`. FileNotFoundError: no such file.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise ResultsError(f"{path} is no text file; results of `slcp bench charts` are needed") from None
    lines = list(csv.reader(io.StringIO(text)))
    header = lines[0] if lines else []
    missing = [name for name in NEEDED if name not in header]
    if missing:
        raise ResultsError(
            f"{path} has no columns {', '.join(missing)}; results of `slcp bench charts` are needed"
        )
    if len(lines) < 2:
        raise ResultsError(f"{path} has no rows")
    for number, line in enumerate(lines, start=1):
        if len(line) != len(header) or (number == len(lines) and not text.endswith("\n")):
            raise ResultsError(f"{path} is cut off or damaged: line {number} is not whole")
    return [{name: _value(name, field) for name, field in zip(header, line)} for line in lines[1:]]


def _value(name: str, text: str) -> Any:
    """A number where the text is one and the column may hold one."""
    if name in TEXT or not text:
        return text
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def same_run(row: dict[str, Any], facts: dict[str, Any]) -> bool:
    """Whether a row was measured by this commit with these versions on this machine."""
    return all(str(row.get(name, "")) == str(facts.get(name, "")) for name in SAME)


def studies_in(rows: Iterable[dict[str, Any]]) -> list[str]:
    """Names of the studies that have rows, in their order."""
    return list(dict.fromkeys(str(row["study"]) for row in rows))
