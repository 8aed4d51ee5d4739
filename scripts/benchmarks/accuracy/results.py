"""The studies' one file: a tidy CSV, a row per point, written whole and read with its numbers as numbers."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ...support.tables import read_csv

Rows = list[dict[str, Any]]
NEEDED = ("study", "problem", "program", "curve", "knob", "value")
TEXT = {"version", "cpu", "system", "python", "slcp-warp", "warp-lang", "numpy", "mujoco", "commit", "time"}
SAME = ("commit", "cpu", "cores", "slcp-warp", "warp-lang", "mujoco")  # of rows that may stand side by side


def read_results(path: Path) -> Rows:
    """Rows of a file, numbers as numbers; "" where a row has no value.

    Raises:
        FileError: the file is cut off, or not of `slcp bench charts`.
        FileNotFoundError: no such file.
    """
    rows = read_csv(path, "results of `slcp bench charts`", NEEDED)
    return [{name: _value(name, field) for name, field in row.items()} for row in rows]


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
