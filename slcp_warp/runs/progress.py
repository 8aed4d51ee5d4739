"""How far a job is: rate, time left, failures so far; a line in a terminal, or below a notebook's cell."""

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

EVERY = 0.2  # seconds between two lines


@dataclass(frozen=True)
class Standing:
    """How far a job is.

    Attributes:
        done, count: chunks finished, and all; count None where the job does not know.
        tally: counts of the finished ones (`Job.tally`): "rows", and "failures" where known.
        fresh: rows of the chunks that were computed now, not found.
        seconds: since the beginning of this run.
    """

    done: int
    count: int | None
    tally: dict[str, int] = field(default_factory=dict)
    fresh: int = 0
    seconds: float = 0.0

    @property
    def rate(self) -> float:
        """Rows a second, of this run; NaN before the first."""
        return self.fresh / self.seconds if self.fresh and self.seconds > 0.0 else math.nan

    @property
    def left(self) -> float:
        """Seconds that it takes from here if it goes on as now; NaN while nobody knows."""
        rows = self.tally.get("rows", 0)
        if self.count is None or not self.done or not rows:
            return math.nan
        return (self.count - self.done) * (rows / self.done) / self.rate

    def __str__(self) -> str:
        of = "" if self.count is None else f"/{self.count}"
        words = [f"{self.done:,}{of} chunks", f"{self.tally.get('rows', 0):,} rows"]
        if math.isfinite(self.rate):
            words.append(f"{self.rate:,.4g} a second")
        if math.isfinite(self.left):
            words.append(f"{duration(self.left)} left")
        words += [f"{n:,} {name}" for name, n in self.tally.items() if name != "rows"]
        return ", ".join(words)


Progress = Callable[[Standing], None]


def duration(seconds: float) -> str:
    """A time span as a person says it: "42 s", "3:05 min", "27:30:00 h"."""
    whole = max(0, round(seconds))
    minutes, rest = divmod(whole, 60)
    if whole < 60:
        return f"{whole} s"
    return f"{minutes}:{rest:02d} min" if minutes < 60 else f"{minutes // 60}:{minutes % 60:02d}:{rest:02d} h"


@contextmanager
def shown(what: str = "", stream: Any = None) -> Iterator[Progress]:
    """A `Progress` that keeps one line up to date: below the cell of a notebook, on a terminal in place; in a
    file it writes a line now and then.

    Args:
        what: a word before it.
        stream: where to, default stderr.
    """
    stream = sys.stderr if stream is None else stream
    cell = _notebook_cell()
    terminal = bool(getattr(stream, "isatty", lambda: False)())
    every = EVERY if cell is not None or terminal else 60.0
    last, width, latest = -math.inf, 0, ""

    def show(text: str) -> None:
        nonlocal width
        if cell is not None:
            cell.update({"text/plain": text}, raw=True)
        elif terminal:
            stream.write("\r" + text.ljust(width))
            width = len(text)
        else:
            stream.write(text + "\n")
        stream.flush()

    def update(standing: Standing) -> None:
        nonlocal last, latest
        latest = f"{what}: {standing}" if what else str(standing)
        if time.monotonic() - last >= every:
            last = time.monotonic()
            show(latest)
            latest = ""

    try:
        yield update
    finally:
        if latest:
            show(latest)
        if terminal and cell is None and width:
            stream.write("\n")
            stream.flush()


def _notebook_cell() -> Any:
    """A display below the present cell of a notebook; None elsewhere."""
    interactive = sys.modules.get("IPython")  # loaded in every notebook
    shell = None if interactive is None else interactive.get_ipython()
    if shell is None or type(shell).__name__ != "ZMQInteractiveShell":
        return None
    from IPython.display import display

    return display({"text/plain": ""}, raw=True, display_id=True)
