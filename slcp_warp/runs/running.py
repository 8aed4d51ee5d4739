"""A job's missing chunks, computed: in this process, or through an executor."""

from collections import deque
from dataclasses import dataclass, field
from typing import Any

from .books import Books
from .executors import workers_of
from .job import Job
from .progress import Progress
from .spreading import Spread, travelling
from .stopping import Stop, on_signals
from .store import Store
from .worker import PAUSE, compute


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
        executor: None: this process. Else `executors.processes`, `dask` or `slurm`, a Dask client, or
            anything with `submit(function, *arguments) -> future`. A chunk whose worker ends is computed
            again.
        progress: called with a `Standing` after every chunk.
        stop: ends it when called, from another thread, say.

    Raises:
        ArgumentError: the job cannot travel to other processes; nothing has been computed.
        FileError: disk full, folder read-only or gone, a worker of another version; finished parts are safe.
        WorkerError: a chunk ends its workers again and again.
    """
    stop = Stop() if stop is None else stop
    workers = None if executor is None else workers_of(executor)
    reference = {} if workers is None else travelling(job, store)
    books = Books(store, progress)
    with on_signals(stop):
        try:
            if workers is None:
                _here(job, store, books, stop)
            elif store.missing():
                job.prepare()
                Spread(reference, store, books, workers, stop).run()
        except KeyboardInterrupt:
            stop()
    return Outcome(
        len(books.done) == store.count, tuple(books.computed), tuple(books.again), dict(books.tally),
        stop.signal, books.seconds,
    )  # fmt: skip


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
