"""Which disturbance matters: shares of the variance of a measure that come from what is drawn."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...inputs.errors import ArgumentError
from ...storage.printed import WIDTH, Printed, Table
from ...storage.rows import save_rows
from .given_data import first_order
from .intervals import Interval
from .source import DRAWN, Key, Source

HEAD = ("measure", "policy", "worlds", "drawn", "first", "first_low", "first_high", "total", "total_low",
        "total_high")  # fmt: skip
NOTHING = (math.nan, math.nan, math.nan)
BEYOND = 1.25  # a share of the variance that no noise of many worlds makes of one that is 1 at most
NEIGHBOURS = 1e-3  # places, of all worlds, by which columns of one draw may sort one otherwise


@dataclass(repr=False)
class Sensitivity(Printed):
    """Shares of a measure's variance by what was drawn.

    Attributes:
        measure: "success" or a measure's name.
        policy: its name.
        names: of what is drawn.
        first: index of first order of each, (value, low, high): what goes when it is known.
        total: index of total order of each: what stays when all others are known; NaN where unknown.
        worlds: that were run.
        case: of the rows, where their report has several cases or step sizes: "hard, h = 0.02".
        finite: share of the samples that the indices are of: those with numbers alone. A measure that is
            infinite where something never happens says nothing of where it does not.
    """

    measure: str
    policy: str
    names: tuple[str, ...]
    first: list[Interval]
    total: list[Interval]
    worlds: int
    case: str = ""
    finite: float = 1.0

    @property
    def order(self) -> list[int]:
        """The places of the names, the most important first: by total order, else by first order."""
        values = [t[0] if math.isfinite(t[0]) else f[0] for f, t in zip(self.first, self.total)]
        return np.argsort([-math.inf if math.isnan(v) else v for v in values], kind="stable")[::-1].tolist()

    def save(self, path: str | Path) -> Path:
        """Write the indices as .csv, a row for each name; replaced only once complete."""
        rows = (
            (self.measure, self.policy, self.worlds, self.names[i], *self.first[i], *self.total[i])
            for i in self.order
        )
        return save_rows(path, HEAD, rows)

    def _line(self) -> str:
        case = f" ({self.case})" if self.case else ""
        counts = f"{len(self.names)} drawn numbers, {self.worlds:,} worlds"
        few = any(math.isfinite(v) and math.isnan(low) for v, low, _high in (*self.first, *self.total))
        what = "succeed, or fail," if self.measure == "success" else "differ"
        few_are = f"; too few worlds {what} for some of the intervals" if few else ""
        if self.finite < 1.0:
            few_are += f"; of the {100.0 * self.finite:.3g} % of samples where {self.measure} is finite"
        if not any(math.isfinite(v) for v, _low, _high in (*self.first, *self.total)):
            few_are += f"; no shares: {self.measure} is the same in all worlds, or there are too few of them"
        return f"of {self.measure} under {self.policy}{case}: {counts}{few_are}"

    def _remarks(self) -> list[str]:
        if not any(v > BEYOND for v, _low, _high in (*self.first, *self.total)):
            return []
        return [
            "shares beyond 1 are none: a few worlds make most of the variance, and these numbers tell little "
            "(more samples, or a measure without outliers, tell more)"
        ]

    def _tables(self) -> list[Table]:
        rows = [
            (_short(self.names[i]), *(_shown(each) for each in (self.first[i], self.total[i])))
            for i in self.order
        ]
        return [Table("shares of the variance", ("drawn", "alone", "with interactions"), rows)]


def _short(drawn: str) -> str:
    """The first of the names that share a draw, and how many these are, where a cell does not hold all."""
    names = drawn.split(", ")
    return drawn if len(drawn) <= WIDTH or len(names) < 2 else f"{names[0]} (of {len(names)})"


def _shown(interval: Interval) -> str:
    value, low, high = interval
    within = "" if math.isnan(low) else f" ({low:.3f} to {high:.3f})"
    return "" if math.isnan(value) else f"{value:.3f}{within}"


def sensitivity_of_rows(source: Source, key: Key, measure: str) -> Sensitivity:
    """Indices of first order from the rows of a part.

    Raises:
        ArgumentError: no column of what was drawn.
    """
    columns = drawn_columns(source, key)
    if not columns:
        raise ArgumentError(f"report has no columns {DRAWN}...; nothing was drawn, or it is not kept")
    first = [first_order(source, key, names[0], measure) for names in columns]
    labels = tuple(", ".join(name.removeprefix(DRAWN) for name in names) for names in columns)
    others = {each[1:3] for each in source.keys}
    case = f"{key[1]}, h = {key[2]:g}" if len(others) > 1 else ""
    worlds = source.worlds(key)
    finite = sum(int(np.isfinite(block[measure]).sum()) for block in source.blocks(key, [measure]))
    nothing = [NOTHING] * len(first)
    return Sensitivity(measure, key[0], labels, first, nothing, worlds, case, finite / max(worlds, 1))


def drawn_columns(source: Source, key: Key) -> list[list[str]]:
    """The drawn columns that vary, those together that sort the worlds of the first block alike but for
    neighbours, whose order may be one of rounding.
    """
    names = [name for name in source.names(key) if name.startswith(DRAWN)]
    block = next(source.blocks(key, names), {})
    groups: list[tuple[np.ndarray, list[str]]] = []
    for name in names:
        column = block.get(name, np.zeros(0))
        if len(column) and np.ptp(column) > 0.0:
            ranks = np.argsort(np.argsort(column, kind="stable"))
            for other, members in groups:
                if np.abs(other - ranks).max() <= NEIGHBOURS * len(ranks):
                    members.append(name)
                    break
            else:
                groups.append((ranks, [name]))
    return [members for _, members in groups]
