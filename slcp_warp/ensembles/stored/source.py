"""A sweep's rows in a store: read chunk by chunk, in memory that does not grow with the worlds."""

import functools
from collections.abc import Iterator, Sequence
from typing import Any

from ...runs.store import Store
from ..chunks import ARMS, KEYS, Chunks
from ..statistics.source import DRAWN, Columns, Key, chosen, in_blocks


class StoreSource:
    """The chunks of a sweep that are finished when this is made, as a `Source`.

    Attributes:
        store: where they are.
        chunks: which worlds are in which.
    """

    def __init__(self, store: Store, chunks: Chunks) -> None:
        self.store, self.chunks = store, chunks
        self._finished: dict[Key, list[int]] = {}
        for index in store.finished():
            self._finished.setdefault(chunks[index].part.keys, []).append(index)

    @property
    def keys(self) -> tuple[Key, ...]:
        """The parts that have finished chunks."""
        return tuple(self._finished)

    def worlds(self, key: Key) -> int:
        """How many rows a part has."""
        return sum(self.chunks[index].worlds for index in self._finished[key])

    @functools.cached_property
    def _names(self) -> tuple[str, ...]:
        first = next(iter(self._finished.values()))[0]
        return tuple(name for name in self.store.names(first) if name not in KEYS)

    def names(self, key: Key) -> tuple[str, ...]:
        """The columns of a part: the same for all, but that nothing is drawn of undisturbed worlds."""
        if key[3] == ARMS[0]:
            return self._names
        return tuple(name for name in self._names if not name.startswith(DRAWN))

    def blocks(self, key: Key, names: Sequence[str] | None = None) -> Iterator[Columns]:
        """The blocks of a part, as `Source.blocks`."""
        wanted = chosen(names, self.names(key))
        return in_blocks(self.store.table(index, wanted) for index in self._finished[key])

    def dataset(self) -> Any:
        """All finished chunks as a `pyarrow.dataset`."""
        return self.store.dataset()
