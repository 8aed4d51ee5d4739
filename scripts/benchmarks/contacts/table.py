"""Tables of `slcp bench contacts`, and of two of its files beside each other."""

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from ...support.tables import number, read_csv

Rows = list[dict[str, Any]]
KEY = ("scene", "motion", "program", "law", "model", "dtype")
NEEDED = (*KEY, "seconds", "ratio", "unsolved", "seen")


def print_rows(rows: Rows) -> None:
    """A line for every program of a scene: us a step, how many times MuJoCo's, worlds not solved."""
    title = f"{rows[0]['scene']}, {rows[0]['motion']}: CPU time of a step of a world, one thread"
    table = Table(title=title, title_justify="left")
    for heading in ("", "us", "p10 - p90", "MuJoCo / this", "p10 - p90", "unsolved", "moved, m"):
        table.add_column(heading, justify="left" if not heading else "right", no_wrap=True)
    for row in rows:
        name = f"{row['program']}, {row.get('law') or row['model']}, {row['dtype']}"
        us = (1e6 * row["seconds"], 1e6 * row["seconds_p10"], 1e6 * row["seconds_p90"])
        cells = [name, f"{us[0]:.3g}", f"{us[1]:.3g} - {us[2]:.3g}", "", "", "", f"{row['moved']:.1e}"]
        if "ratio" in row:
            cells[3:5] = [f"{row['ratio']:.2f}", f"{row['ratio_p10']:.2f} - {row['ratio_p90']:.2f}"]
        if row["unsolved"] != "":
            cells[5] = f"{row['unsolved']} of {row['seen']}"
        table.add_row(*cells)
    _console().print(table)


def _console() -> Console:
    console = Console()
    if not console.is_terminal:
        console.width = 120
    return console


def compared(old: Path, new: Path) -> Rows:
    """The cases that two files share: seconds of either, and the ratio in units of MuJoCo's time.

    Raises:
        FileError: no such results.
    """
    files = []
    for path in (old, new):
        rows = read_csv(path, "results of `slcp bench contacts`", NEEDED)
        by_size = (row for row in rows if row.get("knob", "size") == "size")  # of a study's rows
        files.append({tuple(row[name] for name in KEY): row for row in by_size})
    out: Rows = []
    for key in (key for key in files[0] if key in files[1] and files[0][key]["ratio"]):
        before, after = files[0][key], files[1][key]
        found = [(number(path, row, "seconds"), number(path, row, "ratio"))
                 for path, row in ((old, before), (new, after))]  # fmt: skip
        out.append(dict(zip(KEY, key)) | {
            "old": found[0][0], "new": found[1][0], "ratio_old": found[0][1], "ratio_new": found[1][1],
            "faster": found[1][1] / found[0][1],
            "unsolved_old": _unsolved(before),
            "unsolved_new": _unsolved(after),
        })  # fmt: skip
    return out


def _unsolved(row: dict[str, str]) -> str:
    return f"{row['unsolved']} of {row['seen']}"


def print_compared(rows: Rows) -> None:
    """The table of a comparison."""
    table = Table(
        title="two runs: us a step, MuJoCo's time over it, and by how much that grew", title_justify="left"
    )
    for heading in ("", "old", "new", "MuJoCo / old", "/ new", "faster", "unsolved", "new"):
        table.add_column(heading, justify="left" if not heading else "right", no_wrap=True)
    for row in rows:
        name = " ".join(str(row[key]) for key in ("scene", "motion", "law", "dtype"))
        name += "" if row["program"] == "slcp-warp" else f", {row['program']}"
        table.add_row(name, f"{1e6 * row['old']:.3g}", f"{1e6 * row['new']:.3g}", f"{row['ratio_old']:.2f}",
                      f"{row['ratio_new']:.2f}", f"{row['faster']:.2f}", row["unsolved_old"],
                      row["unsolved_new"])  # fmt: skip
    _console().print(table)
