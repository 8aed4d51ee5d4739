"""Where statistics take a sweep's rows from: fixed blocks of worlds, whatever chunks made the rows."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol

import numpy as np

BLOCK = 4096  # worlds of a block

Key = tuple[str, str, float, str]  # policy, case, step size, arm
Columns = dict[str, np.ndarray]
OF_ROWS = ("world", "success", "status")  # columns of every part, beside its measures and what was drawn
NOTED = ("start_overlap", "unsolved_time")  # the same, but tables of before may lack them
DRAWN, RECORDED = "drawn_", "recorded_"


class Source(Protocol):
    """The rows of a sweep, part by part.

    Block b of a part holds what is finished of its worlds b BLOCK to (b + 1) BLOCK - 1, in their order. What
    is reduced block after block is the same whatever chunks, executors and interruptions made the rows.
    """

    @property
    def keys(self) -> tuple[Key, ...]:
        """The parts, in the order of the sweep."""
        ...

    def worlds(self, key: Key) -> int:
        """How many rows a part has."""
        ...

    def names(self, key: Key) -> tuple[str, ...]:
        """The columns of a part, in their order; "world" is the first."""
        ...

    def blocks(self, key: Key, names: Sequence[str] | None = None) -> Iterator[Columns]:
        """The blocks of a part that have rows, in their order: its columns, or "world" and the named ones."""
        ...


def in_blocks(rows: Iterable[Columns]) -> Iterator[Columns]:
    """Rows of rising worlds, in pieces of any length, as blocks.

    Raises:
        ValueError: worlds that do not rise.
    """
    waiting: list[Columns] = []
    number, last = -1, -1
    for piece in rows:
        world = piece["world"]
        if not len(world):
            continue
        if world[0] <= last or (np.diff(world) <= 0).any():
            raise ValueError(f"world {last} and those after it do not rise")
        last = int(world[-1])
        cuts = np.arange(int(world[0]) // BLOCK + 1, last // BLOCK + 1) * BLOCK
        for begin, end in _spans(np.searchsorted(world, cuts), len(world)):
            here = int(world[begin]) // BLOCK
            if waiting and here != number:
                yield joined(waiting)
                waiting = []
            number = here
            waiting.append({name: column[begin:end] for name, column in piece.items()})
    if waiting:
        yield joined(waiting)


def _spans(cuts: np.ndarray, length: int) -> Iterator[tuple[int, int]]:
    """The parts of `length` rows between cuts, without empty ones."""
    edges = [0, *cuts.tolist(), length]
    return ((a, b) for a, b in zip(edges, edges[1:]) if a < b)


def joined(pieces: Sequence[Columns]) -> Columns:
    """Pieces with the same columns, one after the other."""
    if len(pieces) == 1:
        return dict(pieces[0])
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}


def chosen(names: Sequence[str] | None, there: Sequence[str]) -> list[str]:
    """The columns of a block: all, or "world" and the named ones."""
    return list(there) if names is None else list(dict.fromkeys(("world", *names)))


def measure_names(source: Source) -> tuple[str, ...]:
    """The columns that are measures, of all parts."""
    names = dict.fromkeys(name for key in source.keys for name in source.names(key))
    return tuple(
        name for name in names if name not in OF_ROWS + NOTED and not name.startswith((DRAWN, RECORDED))
    )


class MemorySource:
    """Rows in memory; chunks of a part may be added in any order.

    Attributes:
        pieces: chunks of each part.
    """

    def __init__(self) -> None:
        self.pieces: dict[Key, list[Columns]] = {}

    def add(self, key: Key, columns: Columns) -> None:
        """Add a chunk of a part, rows of rising worlds: world, what was drawn, measures, success, status."""
        policy, case, step_size, arm = key
        self.pieces.setdefault((policy, case, float(step_size), arm), []).append(columns)

    @property
    def keys(self) -> tuple[Key, ...]:
        """The parts, in the order in which they came."""
        return tuple(self.pieces)

    def worlds(self, key: Key) -> int:
        """How many rows a part has."""
        return sum(len(piece["world"]) for piece in self.pieces[key])

    def names(self, key: Key) -> tuple[str, ...]:
        """The columns of a part."""
        return tuple(self.pieces[key][0])

    def blocks(self, key: Key, names: Sequence[str] | None = None) -> Iterator[Columns]:
        """The blocks of a part, as `Source.blocks`."""
        wanted = chosen(names, self.names(key))
        pieces = [piece for piece in self.pieces[key] if len(piece["world"])]
        pieces.sort(key=lambda piece: int(piece["world"][0]))
        return in_blocks({name: piece[name] for name in wanted} for piece in pieces)
