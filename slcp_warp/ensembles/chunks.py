"""The chunks of a sweep: which worlds of which part chunk i runs."""

import bisect
import itertools
from collections.abc import Sequence
from typing import NamedTuple

KEYS = ("policy", "case", "step_size", "arm")
ARMS = ("disturbed", "undisturbed")


class Part(NamedTuple):
    """The worlds of one policy, case, step size and arm.

    Attributes:
        policy, case: by name.
        step_size: [s].
        arm: one of `ARMS`.
        worlds: in all.
        at_once: worlds of a chunk, the last of a part may have fewer.
    """

    policy: str
    case: str
    step_size: float
    arm: str
    worlds: int
    at_once: int

    @property
    def keys(self) -> tuple[str, str, float, str]:
        """What the part is of, as `KEYS` name it."""
        return self[:4]


class Chunk(NamedTuple):
    """So many worlds of a part: world0, world0 + 1, ..."""

    part: Part
    world0: int
    worlds: int


class Chunks:
    """All chunks of a sweep, part after part and the worlds of a part in their order; none is stored.

    Attributes:
        parts: of the sweep.
        worlds: of all parts.
    """

    def __init__(self, parts: Sequence[Part]) -> None:
        self.parts = tuple(parts)
        self.worlds = sum(part.worlds for part in self.parts)
        self._ends = list(itertools.accumulate(-(-part.worlds // part.at_once) for part in self.parts))

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    def __getitem__(self, index: int) -> Chunk:
        if not 0 <= index < len(self):
            raise IndexError(f"chunk {index}; there are {len(self)}")
        at = bisect.bisect_right(self._ends, index)
        part = self.parts[at]
        world0 = (index - (self._ends[at - 1] if at else 0)) * part.at_once
        return Chunk(part, world0, min(part.at_once, part.worlds - world0))
