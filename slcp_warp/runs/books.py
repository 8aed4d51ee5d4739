"""What is done and what is left of a job while it runs."""

import time
from collections import Counter
from contextlib import suppress

from .progress import Progress, Standing
from .store import Store


class Books:
    """What is done and what is left, and who is told."""

    def __init__(self, store: Store, progress: Progress | None) -> None:
        self.store, self.progress = store, progress
        self.again = store.set_damaged_aside()
        store.clear()
        self.tally: Counter[str] = Counter()
        self.done: set[int] = set()
        self.computed: list[int] = []
        self.fresh, self.began = 0, time.monotonic()
        for index in store.finished():
            with suppress(FileNotFoundError):  # set aside by another process, meanwhile
                self.add(index, store.tally(index), found=True)
        self.tell()

    def add(self, index: int, tally: dict[str, int], found: bool = False) -> None:
        """Count a finished chunk; `found`: it was there, or another process computed it."""
        if index in self.done:
            return
        self.done.add(index)
        self.tally.update(tally)
        if not found:
            self.computed.append(index)
            self.fresh += tally.get("rows", 0)

    def tell(self) -> None:
        """Say how far it is."""
        if self.progress is not None:
            self.progress(
                Standing(len(self.done), self.store.count, dict(self.tally), self.fresh, self.seconds)
            )

    @property
    def seconds(self) -> float:
        """Since the beginning."""
        return time.monotonic() - self.began
