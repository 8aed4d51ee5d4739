"""Chunks spread over workers: a few in flight for each, those of dead workers again."""

import time
from collections import Counter, deque
from typing import Any

from ..inputs.errors import ArgumentError
from .books import Books
from .executors import AHEAD, WorkerError, Workers
from .job import Job, Plain, plain, rebuild, sha256_of
from .stopping import GRACE, Stop
from .store import Store
from .worker import PAUSE, Done, Share, work

ATTEMPTS = 5  # times that a chunk's worker may end
POLL, SLOW = 0.005, 0.1  # seconds between looks at futures, and at those of a scheduler
LISTED = 1.0  # between looks at the parts of workers that report at their end


def travelling(job: Job, store: Store) -> Plain:
    """The reference of a job, once it is sure that it gives the same job.

    Raises:
        ArgumentError: it cannot travel, or what arrives is another one.
    """
    reference = job.reference()
    arrived = rebuild(reference)
    if sha256_of(plain(arrived.specification(), "specification")) != store.manifest.sha256:
        raise ArgumentError(f"workers would rebuild another {job.kind} than that of {store.folder}")
    return reference


class Spread:
    """The missing chunks of a store in the hands of workers."""

    def __init__(self, reference: Plain, store: Store, books: Books, workers: Workers, stop: Stop) -> None:
        self.reference, self.store, self.books = reference, store, books
        self.workers, self.stop = workers, stop
        self.folder = str(store.folder.resolve())
        self.todo = deque(store.missing())
        self.later: deque[int] = deque()  # in the hands of another process that shares the store
        self.flying: dict[Any, list[int]] = {}
        self.attempts: Counter[int] = Counter()
        self.room, self.looked, self.again = 0, -1e9, 0.0

    def run(self) -> None:
        """Until nothing is left, or it is stopped."""
        self.workers.begin(self.folder)
        try:
            while (self.todo or self.later or self.flying) and not self.stop:
                self._send()
                if not self._receive():
                    self.stop.wait(SLOW if self.workers.shares else POLL)
        finally:
            self._end()

    def _send(self) -> None:
        """As many chunks as workers may have in flight."""
        now = time.monotonic()
        if self.later and not self.todo and now >= self.again:
            self.todo, self.later = self.later, deque()
        if self.workers.shares:
            if self.todo and not self.flying:
                chunks, self.todo = list(self.todo), deque()
                shares = [chunks[k :: self.workers.count()] for k in range(self.workers.count())]
                self._submit(Share(), [share for share in shares if share])
            return
        if now - self.looked > 5.0:
            self.room, self.looked = AHEAD * max(1, self.workers.count()), now
        free = min(len(self.todo), self.room - len(self.flying))
        if free > 0:
            self._submit(work, [[self.todo.popleft()] for _ in range(free)])

    def _submit(self, function: Any, groups: list[list[int]]) -> None:
        futures = self.workers.submit(function, [(self.folder, self.reference, group) for group in groups])
        self.flying.update(zip(futures, groups))

    def _receive(self) -> bool:
        """Take what has come; whether anything has."""
        if self.workers.shares and time.monotonic() - self.looked > LISTED:
            self.looked = time.monotonic()
            self._count(index for index in self.store.finished() if index not in self.books.done)
        finished = [future for future in self.flying if future.done()]
        for future in finished:
            group = self.flying.pop(future)
            try:
                self._take(future.result())
            except self.workers.lost as error:
                self._lost(group, error)
            except Exception as error:
                told = self.workers.error(error)
                raise told from (None if told is error else error)
        return bool(finished)

    def _take(self, found: list[Done]) -> None:
        for index, _, tally in found:
            if tally is not None:
                self.books.add(index, tally)
            elif self.store.part(index).exists():
                self.books.add(index, self.store.tally(index), found=True)
            else:
                self.later.append(index)
                self.again = time.monotonic() + PAUSE
        self.books.tell()

    def _lost(self, group: list[int], error: BaseException) -> None:
        """A worker is gone: its chunks again; the first that is left, which it was at, some times."""
        told = self.workers.error(error)
        if isinstance(told, WorkerError) and not self.workers.shares:
            raise told from error
        left = [index for index in group if not self.store.part(index).exists()]
        self.todo.extend(left)
        for index in left[:1]:
            self.attempts[index] += 1
            if self.attempts[index] >= ATTEMPTS:
                raise WorkerError(
                    f"chunk {index} has lost its worker {ATTEMPTS} times ({type(error).__name__}: "
                    f"{error}); the finished parts are safe"
                ) from error
        self._count(index for index in group if self.store.part(index).exists())

    def _count(self, indices: Any) -> None:
        for index in indices:
            self.books.add(index, self.store.tally(index))
        self.books.tell()

    def _end(self) -> None:
        """Nothing new; what is in flight has a moment, and is given up then."""
        if not self.flying:
            return
        self.workers.cancel(self.flying)
        ends = time.monotonic() + GRACE
        while time.monotonic() < ends and not all(future.done() for future in self.flying):
            time.sleep(POLL)
        if not all(future.done() for future in self.flying):
            self.workers.abandon()
        self._count(i for group in self.flying.values() for i in group if self.store.part(i).exists())
        self.flying.clear()
