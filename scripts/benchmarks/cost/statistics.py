"""What the statistics of a sweep cost: seconds and memory against the number of worlds."""

import resource
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from slcp_warp.ensembles.outcome import Report
from slcp_warp.ensembles.statistics.source import BLOCK, Columns, Key

from ...support.screen import show_rows

NAMES = ("world", "drawn_mass_0", "rate", "time", "success", "status")
KEYS: tuple[Key, ...] = tuple((policy, "hard", 0.05, "disturbed") for policy in ("a", "b"))


class Made:
    """Two parts of so many worlds, whose blocks are made when they are asked for.

    Attributes:
        keys: the parts.
    """

    keys: tuple[Key, ...] = KEYS

    def __init__(self, worlds: int) -> None:
        self._worlds = worlds
        rng = np.random.default_rng(0)
        self._one = [_block(rng) for _ in KEYS]

    def worlds(self, key: Key) -> int:
        """How many rows a part has."""
        return self._worlds

    def names(self, key: Key) -> tuple[str, ...]:
        """The columns of a part."""
        return NAMES

    def blocks(self, key: Key, names: Sequence[str] | None = None) -> Iterator[Columns]:
        """The blocks of a part."""
        one, wanted = self._one[KEYS.index(key)], NAMES if names is None else ("world", *names)
        for world0 in range(0, self._worlds, BLOCK):
            count = min(BLOCK, self._worlds - world0)
            own = one | {"world": np.arange(world0, world0 + BLOCK)}
            yield {name: own[name][:count] for name in wanted}


def _block(rng: np.random.Generator) -> Columns:
    mass = rng.lognormal(sigma=0.1, size=BLOCK).astype(np.float32)
    rate = rng.standard_normal(BLOCK) + mass
    return {"drawn_mass_0": mass, "rate": rate, "time": rng.exponential(size=BLOCK), "success": rate > 0.5,
            "status": np.zeros(BLOCK, np.int32)}  # fmt: skip


def bench_statistics(sizes: Sequence[int]) -> list[dict[str, Any]]:
    """Seconds of every statistic, and how much the peak memory of the process has grown by then."""
    asked: dict[str, Callable[[Report], Any]] = {
        "summary": lambda report: report.summary,
        "quantiles": lambda report: report.quantiles(),
        "compare": lambda report: report.compare("a", "b"),
        "sensitivity": lambda report: report.sensitivity("rate"),
    }
    rows = []
    for worlds in sizes:
        report = Report(None, Made(worlds))
        row: dict[str, Any] = {"worlds": worlds}
        before = _peak()
        for name, ask in asked.items():
            began = time.process_time()
            ask(report)
            row[f"{name} s"] = time.process_time() - began
        rows.append(row | {"grown MB": _peak() - before, "peak MB": _peak()})
    show_rows("statistics of two parts of two measures", rows)
    return rows


def _peak() -> float:
    """Peak resident memory of the process [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
