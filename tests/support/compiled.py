"""`pytest --compiled FILE`: a row for every kernel that a test compiles, to see where the suite's time goes.

Start with an empty cache (`WARP_CACHE_PATH=$(mktemp -d)`). A kernel counts for the first test that needs it;
of several workers each writes a file of its own.
"""

import csv
import os
from collections import defaultdict
from pathlib import Path

import pytest

from slcp_warp.kernels.device.progress import recorded


class Compiled:
    """A plugin of pytest that lists (test, kernel, seconds)."""

    def __init__(self, path: str) -> None:
        worker = os.environ.get("PYTEST_XDIST_WORKER")
        self.path = Path(path if worker is None else f"{path}.{worker}")
        self.rows: list[tuple[str, str, float]] = []

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        with recorded() as kernels:
            done = yield
        self.rows += [(item.nodeid, k.kernel, round(k.seconds, 2)) for k in kernels if k.compiled]
        return done

    def pytest_sessionfinish(self) -> None:
        with self.path.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([("test", "kernel", "seconds"), *self.rows])

    def by_file(self) -> list[tuple[str, int, float]]:
        """(test file, kernels, seconds), the longest first."""
        times: dict[str, list[float]] = defaultdict(list)
        for test, _, seconds in self.rows:
            times[test.partition("::")[0]].append(seconds)
        return sorted(((name, len(t), sum(t)) for name, t in times.items()), key=lambda row: -row[2])

    def pytest_terminal_summary(self, terminalreporter) -> None:
        files = self.by_file()
        total = sum(seconds for *_, seconds in files)
        terminalreporter.write_line(f"{len(self.rows)} kernels compiled, {total:.0f} s: {self.path}")
        for name, kernels, seconds in files[:10]:
            terminalreporter.write_line(f"{seconds:7.1f} s {kernels:4d}  {name}")
