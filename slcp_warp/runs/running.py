"""A job's missing chunks, computed: in this process, or through an executor."""

import time
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Any

from .job import Columns, Job
from .progress import Progress, Standing
from .stopping import Stop, on_signals
from .store import Store

PAUSE = 0.2  # seconds before asking again for chunks that others compute


@dataclass(frozen=True)
class Outcome:
    """What a run did.

    Attributes:
        complete: every chunk is there.
        computed: chunks of this run.
        again: chunks that were there and damaged.
        tally: counts of all finished chunks.
        signal: number of the signal that ended it, 0 for none.
        seconds: it took.
    """

    complete: bool
    computed: tuple[int, ...]
    again: tuple[int, ...] = ()
    tally: dict[str, int] = field(default_factory=dict)
    signal: int = 0
    seconds: float = 0.0


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
            seconds = time.monotonic() - self.began
            standing = Standing(len(self.done), self.store.count, dict(self.tally), self.fresh, seconds)
            self.progress(standing)

    def outcome(self, stop: Stop) -> Outcome:
        """What there is at the end."""
        return Outcome(
            len(self.done) == self.store.count, tuple(self.computed), tuple(self.again), dict(self.tally),
            stop.signal, time.monotonic() - self.began,
        )  # fmt: skip


def run(
    job: Job,
    store: Store,
    executor: Any = None,
    progress: Progress | None = None,
    stop: Stop | None = None,
) -> Outcome:
    """Compute the missing chunks of a job, each into its part of the store.

    Ctrl-C and SIGTERM end it early: a chunk in flight is finished, or given up after two seconds; what is
    finished stays, and the same call goes on from there.

    Args:
        job: what is computed.
        store: `Store.open(folder, job)`.
        executor: None: this process. Else anything with `submit(function, *arguments) -> future`.
        progress: called with a `Standing` after every chunk.
        stop: ends it when called, from another thread, say.

    Raises:
        FileError: disk full, folder read-only or gone; finished parts are safe.
    """
    stop = Stop() if stop is None else stop
    books = Books(store, progress)
    with on_signals(stop):
        try:
            _here(job, store, books, stop)
        except KeyboardInterrupt:
            stop()
    return books.outcome(stop)


def _here(job: Job, store: Store, books: Books, stop: Stop) -> None:
    """Chunk after chunk in this process; those that another process has claimed come last."""
    todo = deque(store.missing())
    passed = 0  # claimed by others, one after the other
    while todo and not stop:
        if passed >= len(todo):
            stop.wait(PAUSE)
            passed = 0
            continue
        index = todo.popleft()
        tally = compute(job, store, index)
        if tally is not None or store.part(index).exists():
            books.add(index, store.tally(index) if tally is None else tally, found=tally is None)
            books.tell()
            passed = 0
        else:
            todo.append(index)
            passed += 1


def compute(job: Job, store: Store, index: int) -> dict[str, int] | None:
    """Compute a chunk and write its part, unless it is there or claimed; its tally if it was computed."""
    with store.claim(index) as mine:
        if not mine:
            return None
        columns: Columns = job.run(index)
        tally = {name: int(n) for name, n in job.tally(columns).items()}
        store.write(index, columns, tally)
        return tally
