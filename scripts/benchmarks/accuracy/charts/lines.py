"""Lines of work-precision charts: rows of one panel grouped into curves."""

from collections.abc import Iterable, Iterator
from typing import Any

from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from ....charts.style import BLACK, CASES, GREY

Rows = list[dict[str, Any]]
Points = list[tuple[float, float]]
COLOURS = (*CASES, BLACK, GREY)


def choose(rows: Rows, **wanted: Any) -> Rows:
    """The rows that have these values."""
    return [row for row in rows if all(str(row.get(k)) == str(v) for k, v in wanted.items())]


def different(rows: Rows, name: str) -> list[Any]:
    """The values of a column in the order they come."""
    return list(dict.fromkeys(row[name] for row in rows))


def points(rows: Rows, x: str, y: str) -> Points:
    """(x, y) of the rows that have both, positive, sorted by x."""
    both = [(row.get(x), row.get(y)) for row in rows]
    found = [(float(a), float(b)) for a, b in both if a not in (None, "") and b not in (None, "")]
    return sorted((a, b) for a, b in found if a > 0.0 and b > 0.0)


def curves(rows: Rows, by: str = "curve", of: Rows | None = None) -> Iterator[tuple[str, Rows, str]]:
    """(label, rows, colour) of every curve; colours are counted in the rows `of` a whole chart, if given."""
    for i, label in enumerate(different(rows if of is None else of, by)):
        part = choose(rows, **{by: label})
        if part:
            yield str(label), part, COLOURS[i % len(COLOURS)]


def plot(axes: Any, found: Points, style: str = "o-", /, **options: Any) -> None:
    """Points on logarithmic axes; nothing where there are none."""
    if found:
        axes.loglog(*zip(*found), style, **{"markersize": 4, **options})


def cost_ticks(ax: Any) -> None:
    """Plain numbers 1, 2, 5, 10, .. along a logarithmic x axis of less than two decades."""
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())


def need(rows: Rows, study: str) -> Rows:
    """The rows of a study.

    Raises:
        ValueError: there are none.
    """
    found = choose(rows, study=study)
    if not found:
        raise ValueError(f"there are no rows of study {study!r}; there are {different(rows, 'study')}")
    return found


def titles(axes: Iterable[Any], *texts: tuple[str, ...]) -> None:
    """(title, x label, y label) of each panel."""
    for ax, (title, x, y) in zip(axes, texts):
        ax.set(title=title, xlabel=x, ylabel=y)
