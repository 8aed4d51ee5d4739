"""What a run found, as tidy rows, on the screen and as Markdown: a row per method, precision and class."""

from collections import Counter
from typing import Any

from rich.console import Console
from rich.table import Table

from slcp_warp.options import Status

from .tasks import FIELDS, Tally
from .verdicts import AMBIGUOUS, REASONS, SILENT, UNPROVEN, WRONG

Row = dict[str, Any]
DEFAULTS = {"scaling": "inertia", "friction": "anitescu", "integrator": "euler", "noise": "row",
            "deviation": "scale", "gap": "start", "depenetration_speed": "None"}  # fmt: skip
UNSOLVED = tuple(f"unsolved {reason}" for reason in REASONS)
COMPARED = tuple(
    f"compared {what}" for what in ("single", "threads", "derivatives", "curvatures", "gradients", "sweep")
)


def rows_of(tally: Tally) -> list[Row]:
    """A row per kernels, method, precision and class of state."""
    grouped: dict[tuple[str, ...], Counter[str]] = {}
    for name, count in tally.counts.items():
        grouped.setdefault(name[:-1], Counter())[name[-1]] += count
    out = []
    for key, counts in sorted(grouped.items()):
        row: Row = dict(zip(("kernels", *FIELDS, "dtype", "class"), key))
        row["worlds"] = counts["worlds"]
        for status in Status:
            row[status.name] = counts[status.name]
        for verdict in (SILENT, WRONG, UNPROVEN, AMBIGUOUS):
            row[verdict] = counts[f"verdict {verdict}"]
        row["worst"] = tally.worst.get(key, 0.0)
        for what in (*COMPARED, *UNSOLVED):
            row[what] = counts[what]
        out.append(row)
    return out


def merged(rows: list[Row], *names: str) -> list[Row]:
    """Rows with the same values of `names` as one."""
    out: dict[tuple[Any, ...], Row] = {}
    for row in rows:
        key = tuple(row[name] for name in names)
        here = out.setdefault(key, dict(zip(names, key)))
        for name, value in row.items():
            if name == "worst":
                here[name] = max(here.get(name, 0.0), value)
            elif isinstance(value, int):
                here[name] = here.get(name, 0) + value
    return list(out.values())


def method_of(row: Row) -> str:
    """A method in a few letters: what differs from the default."""
    parts = [str(row["residual"])]
    parts += [str(row[name]) for name, value in DEFAULTS.items() if row[name] != value]
    return "/".join(parts)


def lines_of(rows: list[Row]) -> list[list[str]]:
    """Header and a line per kernels, method and precision: solved shares of the worlds that have a solution
    by class of state [%], statuses, what is wrong, and the worst error that holds over what is allowed.
    """
    rows = [row | {"method": method_of(row)} for row in rows if row["worlds"]]
    classes = list(dict.fromkeys(row["class"] for row in rows))
    counts = ("NOT_CONVERGED", "INFEASIBLE", "JAMMED", SILENT, WRONG, UNPROVEN, AMBIGUOUS)
    out = [["kernels", "method", "dtype", "worlds", *classes, *counts, "worst"]]
    names = ("kernels", "method", "dtype")
    shares = {tuple(r[n] for n in (*names, "class")): solved(r) for r in merged(rows, *names, "class")}
    for line in merged(rows, *names):
        key = tuple(line[name] for name in names)
        cells = [f"{shares[(*key, c)]:.2f}" if (*key, c) in shares else "" for c in classes]
        out.append(
            [*key, str(line["worlds"]), *cells, *(str(line[c]) for c in counts), f"{line['worst']:.1g}"]
        )
    return out


def law_of(row: Row) -> str:
    """The contact law of a row: what a step solves, whatever its scaling and integrator."""
    law = {"hard": row["friction"], "erm": "erm"}.get(row["residual"].partition("-")[0], "smoothed")
    return law + ("/end" if row["gap"] == "end" else "")


def unsolved_lines(rows: list[Row]) -> list[list[str]]:
    """Header and a line per kernels, law and precision with worlds that are NOT_CONVERGED: the solved share
    of all and of the class with the least [%], how many worlds were looked into, and what there was.
    """
    rows = [row | {"law": law_of(row)} for row in rows if row["worlds"]]
    names = ("kernels", "law", "dtype")
    out = [[*names, "worlds", "solved", "least", "NOT_CONVERGED", "looked into", *REASONS]]
    least: dict[tuple[Any, ...], list[float]] = {}
    for row in merged(rows, *names, "class"):
        least.setdefault(tuple(row[name] for name in names), []).append(solved(row))
    for row in merged(rows, *names):
        counts, key = [row[name] for name in UNSOLVED], tuple(row[name] for name in names)
        if sum(counts):
            shares = [f"{solved(row):.2f}", f"{min(least[key]):.2f}"]
            cells = [*key, row["worlds"], *shares, row["NOT_CONVERGED"], sum(counts), *counts]
            out.append([str(cell) for cell in cells])
    return out


def solved(row: Row) -> float:
    """Share of the worlds that have a solution that are solved [%]."""
    able = row["worlds"] - row["INFEASIBLE"] - row["JAMMED"] + row[WRONG]
    return 100.0 * row["SOLVED"] / max(1, able)


def show(rows: list[Row], console: Console) -> None:
    """Print the table and the sums, wide."""
    head, *lines = lines_of(rows)
    screen = Table(*head, title="random scenes", title_justify="left", box=None, padding=(0, 1))
    silent = head.index(SILENT)
    for line in lines:
        screen.add_row(*line, style="red" if line[silent] != "0" or line[silent + 1] != "0" else "")
    Console(width=max(console.width, 200)).print(screen, soft_wrap=True)
    console.print(summary(rows))


def summary(rows: list[Row]) -> str:
    """The sums in one line."""
    total = {n: sum(row[n] for row in rows) for n in ("worlds", "SOLVED", SILENT, WRONG, UNPROVEN, AMBIGUOUS)}
    compared = ", ".join(f"{sum(row[n] for row in rows)} {n}" for n in COMPARED)
    return ", ".join(f"{v} {k}" for k, v in total.items()) + f"; {compared}"


def markdown(lines_of_table: list[list[str]]) -> str:
    """A table for docs/understand/stability.md: `lines_of`, `unsolved_lines`."""
    head, *lines = lines_of_table
    out = [head, ["---"] * len(head), *lines]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in out) + "\n"
