"""The stability battery's rows as a table on the screen, as Markdown, and as one picture."""

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from slcp_warp.options import CHOICES
from slcp_warp.storage.files import FileError

from ...support.tables import number, read_csv
from .run import DEGRADES, FAMILY, PASS, SILENT, STATUS, UNCHECKED, VERDICTS, Row

DEFAULTS = {name: CHOICES[name][0] for name in FAMILY[1:]}
SHADES = {PASS: "#009E73", DEGRADES: "#F0E442", STATUS: "#56B4E9", SILENT: "#D55E00", UNCHECKED: "#BBBBBB"}
STYLES = {PASS: "green", DEGRADES: "yellow", STATUS: "cyan", SILENT: "bold red", UNCHECKED: "dim"}
KEYS = ("case", "scene", *FAMILY, "dtype", "h", "sigma", "variant")
NUMBERS = ("h", "variant", "value", "limit", "error")
ORDER = (UNCHECKED, PASS, DEGRADES, STATUS, SILENT)  # the worst last


def read_rows(paths: list[Path]) -> list[Row]:
    """The battery's rows from its CSV files; a cell that comes again replaces what was there."""
    cells: dict[tuple[Any, ...], Row] = {}
    for path in paths:
        for row in read_csv(path, "a table of `slcp bench stability`", (*KEYS, *NUMBERS, "verdict")):
            cell: Row = dict(row)
            for name in NUMBERS:
                cell[name] = number(path, row, name, finite=False)
            cell["sigma"] = number(path, row, "sigma") if row["sigma"] else ""
            if row["verdict"] not in VERDICTS:
                raise FileError(f"{path}: verdict is {row['verdict']!r:.60}; choose one of {VERDICTS}")
            cells[tuple(cell[k] for k in KEYS)] = cell
    return list(cells.values())


def method_name(row: Row) -> str:
    """A method in a few letters: "hard", "rem-logistic/none/trapezoidal"; defaults are left out."""
    parts = [row["residual"]]
    parts += [row[k] for k, value in DEFAULTS.items() if row[k] != value]
    return "/".join(parts)


def tally(rows: list[Row]) -> dict[tuple[str, str], dict[str, int]]:
    """(case, method and precision) -> how many cells have which verdict."""
    out: dict[tuple[str, str], dict[str, int]] = {}
    for row in rows:
        counts = out.setdefault((row["case"], f"{method_name(row)} {row['dtype'][5:]}"), {})
        counts[row["verdict"]] = counts.get(row["verdict"], 0) + 1
    return out


def _cell(counts: dict[str, int] | None, styled: bool) -> str:
    if counts is None:
        return ""
    letters = {PASS: "", DEGRADES: "d", STATUS: "s", SILENT: "SILENT", UNCHECKED: "?"}
    parts = [(v, f"{counts[v]}{letters[v]}") for v in VERDICTS if counts.get(v)]
    return " ".join(f"[{STYLES[v]}]{t}[/]" if styled else t for v, t in parts)


def axes(rows: list[Row]) -> tuple[list[str], list[str]]:
    """Cases and methods with their precision, in the order in which they came."""
    cases = list(dict.fromkeys(row["case"] for row in rows))
    columns = sorted(
        {f"{method_name(r)} {r['dtype'][5:]}" for r in rows}, key=lambda c: (len(c.split("/")), c)
    )
    return cases, columns


def print_table(rows: list[Row]) -> None:
    """Counts per case and method: plain passes, d degrades, s fails with a status, ? unchecked."""
    table = Table(title="stability: cells that pass, d degrade, s fail with a status", title_justify="left")
    counts, (cases, columns) = tally(rows), axes(rows)
    table.add_column("case", no_wrap=True)
    for column in columns:
        table.add_column(column.replace("/", "/\n"), justify="right")
    for case in cases:
        table.add_row(case, *(_cell(counts.get((case, c)), True) for c in columns))
    console = Console()
    if not console.is_terminal:
        console.width = 40 + 14 * len(columns)
    console.print(table)
    total = {v: sum(row["verdict"] == v for row in rows) for v in VERDICTS}
    console.print("  " + ", ".join(f"{n} {v}" for v, n in total.items()) + f" of {len(rows)} cells")


def markdown(rows: list[Row]) -> str:
    """The same table for docs/understand/stability.md."""
    counts, (cases, columns) = tally(rows), axes(rows)
    lines = ["| case | " + " | ".join(columns) + " |", "|---|" + "---|" * len(columns)]
    for case in cases:
        lines.append(f"| {case} | " + " | ".join(_cell(counts.get((case, c)), False) for c in columns) + " |")
    return "\n".join(lines) + "\n"


def lines(rows: list[Row]) -> str:
    """Any rows as Markdown, numbers to two digits."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    text = ["| " + " | ".join(columns) + " |", "|---|" + "---|" * (len(columns) - 1)]
    for row in rows:
        cells = [row.get(c, "") for c in columns]
        text.append("| " + " | ".join(c if isinstance(c, str) else f"{c:.2g}" for c in cells) + " |")
    return "\n".join(text) + "\n"


def draw(rows: list[Row], path: Path) -> Path:
    """One block per case and method: noise levels down, step sizes across, coloured by the worst verdict."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    from ...charts.style import plt, save

    cases, columns = axes(rows)
    hs = sorted({row["h"] for row in rows})
    sigmas = sorted({row["sigma"] for row in rows if row["sigma"] != ""}, reverse=True) or [""]
    wide, tall = len(hs) + 1, len(sigmas) + 1
    image = np.full((len(cases) * tall - 1, len(columns) * wide - 1), np.nan)
    for row in rows:
        x = columns.index(f"{method_name(row)} {row['dtype'][5:]}") * wide + hs.index(row["h"])
        y = cases.index(row["case"]) * tall
        span = slice(y, y + len(sigmas)) if row["sigma"] == "" else y + sigmas.index(row["sigma"])
        image[span, x] = np.fmax(image[span, x], ORDER.index(row["verdict"]))
    figure, ax = plt.subplots(figsize=(3.0 + 0.55 * len(columns), 2.2 + 0.42 * len(cases)))
    colours: Any = ListedColormap([SHADES[v] for v in ORDER])
    ax.imshow(image, cmap=colours, vmin=-0.5, vmax=len(ORDER) - 0.5, aspect="auto", interpolation="nearest")
    ax.set_xticks([i * wide + (wide - 2) / 2 for i in range(len(columns))], columns, rotation=60, ha="right")
    ax.set_yticks([i * tall + (tall - 2) / 2 for i in range(len(cases))], cases)
    ax.tick_params(length=0)
    ax.grid(False)
    for side in ax.spines.values():
        side.set_visible(False)
    down = ", ".join(f"{s:g}" for s in sigmas if s != "")
    ax.set_title(
        f"each block: sigma {down} downwards, h {', '.join(f'{h:g}' for h in hs)} to the right", loc="left"
    )
    names = {PASS: "passes", DEGRADES: "degrades", STATUS: "fails with a status", SILENT: "fails silently",
             UNCHECKED: "unchecked"}  # fmt: skip
    seen = [v for v in VERDICTS if any(row["verdict"] == v for row in rows)]
    seen += [SILENT] if SILENT not in seen else []
    figure.legend(
        [Patch(color=SHADES[v]) for v in seen], [names[v] for v in seen], loc="upper right", ncols=5
    )
    figure.tight_layout(rect=(0, 0, 1, 0.97))
    return save(figure, path)
