"""Drift in ten seconds and penetration against cost of piles that should rest, worst first."""

from pathlib import Path

from .lines import Rows
from .many_error import STILL, motions, panels

KINDS = {"error": "drift in 10 s [m]", "penetration": "deepest [m]"}


def draw(rows: Rows, out: Path) -> Path:
    """What should stay where it is."""
    rows = [row for row in motions(rows) if str(row["problem"]).endswith(STILL)]
    return panels(rows, KINDS, "piles at rest, where we lose most first: drift", out)
