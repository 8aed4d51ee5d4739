"""How things print for people: one line, a text with tables, and HTML where a notebook shows it.

A class that is `Printed` says in `_line` what it is and in `_tables` what is in it. Lengths are bounded
whatever is in it; no notebook is needed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

ROWS, COLUMNS, WIDTH, LINE = 24, 10, 32, 240  # at most: of a table, characters of a cell, of a line


def cell(value: Any, most: int = WIDTH) -> str:
    """A value in few characters; None: nothing."""
    if value is None:
        return ""
    if isinstance(value, float | np.floating):
        return f"{value:.4g}"
    if isinstance(value, tuple | list):
        return cut(f"({', '.join(cell(each) for each in value[:COLUMNS])})", most)
    return cut(str(value), most)


def cut(text: str, most: int) -> str:
    """A text on one line, of at most so many characters."""
    text = " ".join(text.split())
    return text if len(text) <= most else text[: most - 3] + "..."


def counted(number: int, one: str, several: str = "") -> str:
    """A number and what it counts: "1 body", "2 bodies"."""
    return f"{number:,} {one if number == 1 else several or one + 's'}"


def percent(share: float) -> str:
    """A share in percent, with as many digits as tell it from none and from all: "94.8", "99.9955"."""
    value, digits = 100.0 * share, 1
    while digits < 8 and 0.0 < value < 100.0 and round(value, digits) in (0.0, 100.0):
        digits += 1
    return f"{value:.{digits}f}"


def percents(interval: Sequence[float]) -> str:
    """(share, low, high) in percent: "94.8 (93.3 to 96.0)"."""
    share, low, high = map(percent, interval)
    return f"{share} ({low} to {high})"


@dataclass(frozen=True)
class Table:
    """A table, of bounded size.

    Attributes:
        title: above it; may be empty.
        head: a heading for every column.
        rows: of values.
        left: how many columns, from the left, are of names.
        width: characters of a cell, at most.
        most: rows that are shown, at most.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[Any]]
    left: int = 1
    width: int = WIDTH
    most: int = ROWS

    def cells(self) -> list[list[str]]:
        """The heading and the rows, bounded; what is left out is counted in the last row and column."""
        count = min(len(self.head), COLUMNS)
        beyond = len(self.head) - count
        rows = (self.head, *self.rows[: self.most])
        lines = [[cell(value, self.width) for value in row[:count]] for row in rows]
        if len(self.rows) > self.most:
            lines.append([f"... {len(self.rows) - self.most:,} more", *[""] * (count - 1)])
        if beyond:
            lines = [[*line, "" if i else f"... {beyond:,} more"] for i, line in enumerate(lines)]
        return lines

    def text(self) -> str:
        """The table in plain text."""
        lines = self.cells()
        widths = [max(len(line[j]) for line in lines) for j in range(len(lines[0]))]
        out = [self.title] if self.title else []
        for line in lines:
            shown = [
                c.ljust(w) if j < self.left else c.rjust(w) for j, (c, w) in enumerate(zip(line, widths))
            ]
            out.append(("  " + "  ".join(shown)).rstrip())
        return "\n".join(out)

    def html(self) -> str:
        """The table as HTML."""
        head, *rows = self.cells()
        out = [f"<caption>{escape(cut(self.title, LINE))}</caption>" if self.title else ""]
        for tag, line in (("th", head), *(("td", row) for row in rows)):
            sides = ["left" if j < self.left else "right" for j in range(len(line))]
            cells = (f'<{tag} style="text-align:{s}">{escape(c)}</{tag}>' for s, c in zip(sides, line))
            out.append(f"<tr>{''.join(cells)}</tr>")
        return f"<table>{''.join(out)}</table>"


class Printed:
    """Prints as one line; `str` and a notebook show its remarks and tables, too."""

    def _line(self) -> str:
        """What it is, in a line."""
        raise NotImplementedError

    def _remarks(self) -> list[str]:
        """What has to be known of it, in whole sentences without a stop."""
        return []

    def _tables(self) -> list[Table]:
        """What is in it."""
        return []

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {cut(self._line(), LINE)}>"

    def __str__(self) -> str:
        remarks = (f"  ! {remark}" for remark in self._remarks())
        tables = (table.text() for table in self._tables() if table.rows)
        return "\n".join([repr(self)[1:-1], *remarks, *tables])

    def _repr_html_(self) -> str:
        tables = (table.html() for table in self._tables() if table.rows)
        remarks = (f"<p><b>{escape(remark)}</b></p>" for remark in self._remarks())
        return f"<div><p>{escape(repr(self)[1:-1])}</p>{''.join(remarks)}{''.join(tables)}</div>"


class Arrays(Printed):
    """A dataclass of arrays, which prints their shapes."""

    def _line(self) -> str:
        return ", ".join(
            f"{name} {_shape(value)}"
            for name, value in vars(self).items()
            if value is not None and not name.startswith("_")
        )


def _shape(value: Any) -> str:
    if isinstance(value, dict):
        return f"of {', '.join(map(str, value)) or 'nothing'}"
    shape = getattr(value, "shape", None)
    if shape is None:
        return cell(value)
    return cell(float(value)) if len(shape) == 0 else str(tuple(shape))
