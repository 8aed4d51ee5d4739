"""What a search for numbers came to."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ....storage.printed import Printed, Table, cell, counted, percents
from ...statistics.intervals import Interval
from ...store import save_table
from ..axes import ITSELF


@dataclass(frozen=True, repr=False)
class Judged:
    """Numbers, and how worlds went with them that the search has not seen.

    Attributes:
        numbers: by name.
        success: (share, low, high) of the worlds, with a 95 % interval (M42).
        value: (mean, low, high) of what was to be small or large; NaN where success alone counted.
    """

    numbers: dict[str, float]
    success: Interval
    value: Interval


@dataclass(frozen=True, repr=False)
class Tuned(Printed):
    """Outcome of `tune`.

    Attributes:
        numbers: the best, by name.
        policy: that is made from them.
        best, first: the best and the numbers that the search began with, each judged in `test_worlds` worlds
            that the search has not seen. (In its own the best flatters: it was chosen by them.)
        better: (difference, low, high) of their shares of success, best less first, with a 95 % interval
            (M51).
        wanted: in words.
        value_name: of what was to be small or large; None: success alone counted.
        tried: a row a candidate, in order: its round (0: the first numbers), the numbers, and in the worlds
            of the search its share of success and mean value.
        worlds: of the search, the same for all candidates.
        test_worlds: in which the best and the first were judged.
        seed: of all that was drawn.
        ended: why: "resolution" (all candidates of a round were nearly alike), "rounds" or "interrupted".
        share: of success that was to be kept; None: none.
        at_end: names of the numbers that lie at an end of their range, or within a hundredth of it.
    """

    numbers: dict[str, float]
    policy: Any
    best: Judged
    first: Judged
    better: Interval
    wanted: str
    value_name: str | None
    tried: dict[str, np.ndarray]
    worlds: int
    test_worlds: int
    seed: int
    ended: str
    at_end: tuple[str, ...]
    share: float | None = None

    def save(self, path: str | Path) -> Path:
        """Write `tried` as .csv; replaced only once complete."""
        return save_table(path, self.tried)

    def _line(self) -> str:
        found = ", ".join(f"{name.rstrip(ITSELF)} = {value:.4g}" for name, value in self.numbers.items())
        return (
            f"{self.wanted}: {found}; {percents(self.best.success)} % of {self.test_worlds:,} other worlds "
            f"succeed, with the first numbers {percents(self.first.success)} %"
        )

    def _remarks(self) -> list[str]:
        out = [f"at the end of its range: {', '.join(self.at_end)}"] if self.at_end else []
        if self.value_name is None and not self.better[1] > 0.0:
            out.append(
                f"no better than the first, as far as these worlds tell: by {percents(self.better)} points"
            )
        most = float(np.max(self.tried["success_share"])) if self.share is not None else 0.0
        if self.share is not None and most < self.share:
            out.append(
                f"no candidate reached {100.0 * self.share:g} %; the best of them succeeded in "
                f"{100.0 * most:.3g} % of the search's own worlds"
            )
        elif self.share is not None and self.best.success[2] < self.share:
            out.append(
                f"{100.0 * self.share:g} % are not kept in worlds that the search has not seen: in more of "
                "its own (worlds=), or for a larger share, they are"
            )
        return out

    def _tables(self) -> list[Table]:
        both = self.first, self.best
        rows: list[tuple[Any, ...]] = [
            (name.rstrip(ITSELF), *(each.numbers[name] for each in both)) for name in self.numbers
        ]
        rows.append(("success [%]", *(percents(each.success) for each in both)))
        if self.value_name is not None and self.value_name not in self.numbers:
            means = ("{} ({} to {})".format(*map(cell, each.value)) for each in both)
            rows.append((f"mean of {self.value_name}", *means))
        tries = counted(len(self.tried["round"]), "candidate")
        title = f"{tries} in {self.worlds:,} worlds each, ended by {self.ended}"
        return [Table(title, ("", "first", "best"), rows, most=len(rows))]
