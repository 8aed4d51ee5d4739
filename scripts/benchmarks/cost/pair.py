"""`slcp bench pair`: this version against another one, case by case in turn, with intervals of the ratios."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from ..shared.machine import machine
from .pair_cases import cases

CASES = Path(__file__).with_name("pair_cases.py")
RESAMPLES = 2000


class PairError(RuntimeError):
    """An interpreter that cannot run the cases."""


class Runner:
    """A script in a process of another interpreter, which answers every line with one of JSON."""

    def __init__(self, python: str, script: Path = CASES) -> None:
        try:
            self.process = subprocess.Popen(
                [python, str(script)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                env=os.environ | {"PYTHONSAFEPATH": "1", "SLCP_WARP_THREADS": "1"},
            )
        except OSError as error:
            raise PairError(f"cannot start {python!r}: {error}") from None
        self.python = python

    def seconds(self, case: str) -> float | str:
        """CPU seconds per item of one call of a case, or what went wrong."""
        answer = self.ask(case)
        return answer["seconds"] if "seconds" in answer else str(answer["error"])

    def ask(self, line: str) -> dict[str, Any]:
        """The answer to a line.

        Raises:
            PairError: the process ended.
        """
        assert self.process.stdin is not None and self.process.stdout is not None
        try:
            self.process.stdin.write(line + "\n")
            self.process.stdin.flush()
            said = self.process.stdout.readline()
        except BrokenPipeError:
            said = ""
        if not said:
            raise PairError(f"{self.python!r} ended in case {line!r}; does it have slcp-warp?")
        answer: dict[str, Any] = json.loads(said)
        return answer


def median_interval(ratios: np.ndarray) -> tuple[float, float, float]:
    """Median of (R,) ratios and its 95 % bootstrap interval."""
    rng = np.random.default_rng(0)
    medians = np.median(rng.choice(ratios, (RESAMPLES, len(ratios))), axis=1)
    low, high = np.percentile(medians, [2.5, 97.5])
    return float(np.median(ratios)), float(low), float(high)


def bench_pair(other: str, repeats: int, chosen: str | None = None) -> list[dict[str, Any]]:
    """Time every case whose name contains `chosen` in both interpreters, in turn, `repeats` times.

    A ratio is this version's CPU time over the other's in one round; above 1 this version is slower.

    Raises:
        PairError: an interpreter does not start or dies.
    """
    names = [name for name in cases() if chosen is None or chosen in name]
    here, there = Runner(sys.executable), Runner(other)
    rows: list[dict[str, Any]] = []
    for name in names:
        spent = np.zeros((repeats, 2))
        problem = ""
        for i in range(repeats):
            order = (0, 1) if i % 2 == 0 else (1, 0)
            for side in order:
                value = (here, there)[side].seconds(name)
                if isinstance(value, str):
                    problem = f"{('this', 'other')[side]} version: {value}"
                    break
                spent[i, side] = value
            if problem:
                break
        row: dict[str, Any] = {"benchmark": "pair", "case": name, "repeats": repeats, "problem": problem}
        if not problem:
            ratio, low, high = median_interval(spent[:, 0] / spent[:, 1])
            mine, theirs = np.median(spent, axis=0)
            row |= {"seconds": mine, "seconds_other": theirs, "ratio": ratio, "low": low, "high": high}
        rows.append(row | machine())
        said = problem or "{ratio:.3f} ({low:.3f} to {high:.3f})".format(**row)
        typer.echo(f"{name}: {said}")
    return rows


def print_pairs(rows: list[dict[str, Any]]) -> None:
    """The table of a comparison."""
    table = Table(title="this version against the other, CPU time of one thread", title_justify="left")
    for heading in ("case", "us an item", "other", "ratio", "95 % interval"):
        table.add_column(heading, justify="left" if heading == "case" else "right", no_wrap=True)
    for r in rows:
        if r["problem"]:
            table.add_row(r["case"], "", "", "", r["problem"][:60])
            continue
        times = (f"{r['seconds'] * 1e6:.3g}", f"{r['seconds_other'] * 1e6:.3g}")
        table.add_row(r["case"], *times, f"{r['ratio']:.3f}", f"{r['low']:.3f} - {r['high']:.3f}")
    console = Console()
    if not console.is_terminal:
        console.width = 120
    console.print(table)
