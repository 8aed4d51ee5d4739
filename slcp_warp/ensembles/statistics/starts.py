"""Worlds that begin in overlap, which their first steps throw out: how many, how deep, and a warning."""

import warnings

import numpy as np

from ...results.overlaps import OVERLAP
from ..chunks import ARMS
from .source import NOTED, Source


class Starts:
    """Of the worlds that were run.

    Attributes:
        worlds: so many of them.
        overlapping: those that begin in overlap.
        deepest: by how much at most [m, rad]; and `speed`, of that over its step size [m/s, rad/s].
    """

    def __init__(self) -> None:
        self.worlds, self.overlapping, self.deepest, self.speed = 0, 0, 0.0, 0.0

    @classmethod
    def of(cls, source: Source) -> "Starts":
        """Of the first block of disturbed worlds; all policies and cases meet the same."""
        out, start = cls(), NOTED[0]
        key = next((key for key in source.keys if key[3] == ARMS[0]), None)
        block = None if key is None else next(source.blocks(key, (start,)), None)
        if key is not None and block is not None:
            out.add(block[start], key[2])
        return out

    def add(self, depth: np.ndarray, step_size: float) -> None:
        """More worlds (B,); NaN: not known."""
        self.worlds += len(depth)
        self.overlapping += int(np.count_nonzero(depth > OVERLAP))
        deepest = float(np.fmax.reduce(depth, initial=0.0))
        self.deepest, self.speed = max(self.deepest, deepest), max(self.speed, deepest / step_size)

    def tell(self, stacklevel: int) -> None:
        """A RuntimeWarning where some do; `stacklevel` as of `warnings.warn` called in place of this."""
        if self.overlapping:
            begin = f"{self.overlapping:,} of {self.worlds:,} worlds begin in overlap"
            warnings.warn(
                f"{begin}, of {self.deepest:.2g} at most, which their first steps open at once, with speeds "
                f"to {self.speed:.2g} a second (m, of joints rad), unless Options.depenetration_speed is "
                "less: starts that fit what is drawn are needed (Disturbances.follow moves them with it, "
                "Worlds.x0 gives them; a sweep's column start_overlap says which worlds)",
                RuntimeWarning,
                stacklevel=stacklevel + 1,
            )
