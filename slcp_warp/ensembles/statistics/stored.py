"""A sweep's rows in a store: read chunk by chunk, in memory that does not grow with the worlds."""

from collections.abc import Iterator, Sequence

from ...runs.store import Store
from ..chunks import KEYS, Chunks, Part
from .source import Columns, Key, chosen, in_blocks


class StoreSource:
    """The finished chunks of a sweep, as a `Source`.

    Attributes:
        store: where they are.
        chunks: which worlds are in which.
    """

    def __init__(self, store: Store, chunks: Chunks) -> None:
        self.store, self.chunks = store, chunks
        self._parts = {part.keys: part for part in chunks.parts}

    @property
    def keys(self) -> tuple[Key, ...]:
        """The parts that have finished chunks."""
        there = self.store.finished()
        found = dict.fromkeys(self.chunks[index].part.keys for index in there)
        return tuple(key for key in self._parts if key in found)

    def worlds(self, key: Key) -> int:
        """How many rows a part has."""
        return sum(self.chunks[index].worlds for index in self._finished(key))

    def names(self, key: Key) -> tuple[str, ...]:
        """The columns of a part."""
        first = self.store.names(self._finished(key)[0])
        return tuple(name for name in first if name not in KEYS)

    def blocks(self, key: Key, names: Sequence[str] | None = None) -> Iterator[Columns]:
        """The blocks of a part, as `Source.blocks`."""
        wanted = chosen(names, self.names(key))
        return in_blocks(self.store.table(index, wanted) for index in self._finished(key))

    def _finished(self, key: Key) -> list[int]:
        part: Part = self._parts[key]
        mine = self.chunks.of_part(part)
        return [index for index in self.store.finished() if index in mine]
