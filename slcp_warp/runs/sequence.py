"""Jobs whose chunks follow from each other: one after the other, each found in the store or computed."""

import os
import time
from collections.abc import Callable

from .job import Columns, Job, Plain
from .store import Store
from .worker import PAUSE


class Sequence(Job):
    """A job that the caller computes step by step with `step_of`."""

    count = None

    def __init__(self, kind: str, specification: Plain, device: str = "cpu") -> None:
        self.kind, self.device, self._specification = kind, device, specification

    def specification(self) -> Plain:
        """What was given."""
        return self._specification

    def layout(self) -> Plain:
        """A step is a chunk."""
        return {}

    def run(self, index: int) -> Columns:
        """Not by itself: `step_of`."""
        raise NotImplementedError(f"step {index} of a {self.kind} follows from those before it")


def opened(folder: str | os.PathLike[str], job: Sequence) -> Store:
    """The store of a sequence, without its damaged parts."""
    store = Store.open(folder, job)
    store.set_damaged_aside()
    store.clear()
    return store


def step_of(store: Store, index: int, compute: Callable[[], Columns]) -> tuple[Columns, bool]:
    """A step's columns, and whether they were found: finished before, or by another process meanwhile."""
    while True:
        if store.part(index).exists():
            return store.table(index), True
        with store.claim(index) as mine:
            if mine:
                columns = compute()
                store.write(index, columns)
                return columns, False
        time.sleep(PAUSE)
