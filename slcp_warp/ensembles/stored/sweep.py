"""A sweep of a task that keeps its chunks on disk, goes on where it was, and may run in other processes."""

import os
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from ...inputs import checks
from ...inputs.errors import ArgumentError
from ...runs import manifest
from ...runs.job import rebuild
from ...runs.parts import arrow
from ...runs.progress import Progress, Standing
from ...runs.running import Outcome, run
from ...runs.stopping import Stop, on_signals
from ...runs.store import Store
from ...runs.worker import compute
from ...storage.files import FileError
from ..outcome import Report
from ..tasks import TaskSweep
from .cutting import measured
from .job import KIND, SweepJob
from .layout import chunks_of
from .source import StoreSource


class StoredSweep:
    """A sweep and its store.

    Attributes:
        job: what is run.
        store: where its chunks are.
    """

    def __init__(self, job: SweepJob, store: Store) -> None:
        self.job, self.store = job, store

    @classmethod
    def open(
        cls,
        folder: str | os.PathLike[str],
        work: TaskSweep,
        texts: Mapping[str, str] | None = None,
        chunk: int | None = None,
        threads: int | None = None,
    ) -> "StoredSweep":
        """The store of a sweep in a folder: a new one, or the one that is there.

        Args:
            texts: as of a `SweepJob`.
            chunk: worlds of a chunk; None: as many as run in about a second. A store that is there keeps its
                own.
            threads: that a chunk will run on; None: all.

        Raises:
            FileError: the folder holds another sweep (the message says what differs), or something else.
            ImportError: pyarrow is not installed; it names the extra.
        """
        arrow()  # before the kernels are compiled
        path = checks.path("out", folder)
        job = SweepJob(work, path, texts)
        if not _take_over(job, path):
            _check_order(job, path)
            if chunk is None:
                work.cut(measured(work, threads))
        try:
            store = Store.open(path, job)
        except FileError:
            if not _take_over(job, path):  # another process has begun it meanwhile, in other chunks
                raise
            store = Store.open(path, job)
        job.pack()
        return cls(job, store)

    @classmethod
    def resume(cls, folder: str | os.PathLike[str]) -> "StoredSweep":
        """The sweep of a store, with nothing else given.

        Raises:
            FileNotFoundError: there is none.
            FileError: it is no sweep, or its task or a policy could not be kept.
        """
        store = Store(checks.path("folder", folder))
        there = store.manifest
        if there.kind != KIND:
            raise FileError(f"{store.folder} holds a {there.kind}, not a {KIND}")
        if there.reference is None:
            raise FileError(f"{store.folder} goes on only by the call that began it: {there.bound}")
        there.check_program()
        arguments = there.reference["arguments"] | {"folder": str(store.folder)}  # it may have moved
        job = rebuild(there.reference | {"arguments": arguments})
        assert isinstance(job, SweepJob)
        return cls(job, Store.open(store.folder, job))

    def run(
        self, executor: Any = None, progress: Progress | None = None, stop: Stop | None = None
    ) -> Outcome:
        """Run the chunks that are missing, see `runs.running.run`."""
        if executor is not None:
            self.job.reference()  # refused before a world runs
        return run(self.job, self.store, executor, progress, stop)

    def run_some(self, indices: Iterable[int], progress: Progress | None = None) -> Outcome:
        """Run only some chunks in this process, those of them that are missing and that nobody else runs.

        Raises:
            ArgumentError: an index that is none.
        """
        wanted = list(indices)
        if bad := [index for index in wanted if not 0 <= index < self.job.count]:
            raise ArgumentError(f"chunk {bad[0]} is none; there are 0 to {self.job.count - 1}")
        stop, began, done = Stop(), time.monotonic(), []
        tally: Counter[str] = Counter()
        with on_signals(stop), suppress(KeyboardInterrupt):
            for index in wanted:
                if stop:
                    break
                found = compute(self.job, self.store, index)
                if found is None:
                    continue
                done.append(index)
                tally.update(found)
                if progress is not None:
                    seconds = time.monotonic() - began
                    progress(Standing(len(done), len(wanted), dict(tally), tally["rows"], seconds))
        complete = set(wanted) <= set(self.store.finished())
        return Outcome(complete, tuple(done), (), dict(tally), stop.signal, time.monotonic() - began)

    def report(self) -> Report:
        """Of the chunks that are finished."""
        source = StoreSource(self.store, self.job.work.chunks)
        return Report(self.job.work.task, source, complete=not self.store.missing())


def _check_order(job: SweepJob, folder: Path) -> None:
    """Raise FileError where the store in a folder has the same parts in another order."""
    if not (folder / manifest.NAME).exists() or (there := Store(folder).manifest).kind != KIND:
        return
    mine, parts = (
        [part.keys for part in chunks.parts] for chunks in (job.work.chunks, chunks_of(there.layout))
    )
    if mine != parts and sorted(mine) == sorted(parts):
        names = ("policies", "cases", "step sizes")
        order = (f"{name} {', '.join(map(str, dict.fromkeys(key[i] for key in parts)))}"
                 for i, name in enumerate(names))  # fmt: skip
        raise FileError(f"{folder} holds this sweep in another order; give its {'; '.join(order)} so")


def _take_over(job: SweepJob, folder: Path) -> bool:
    """Cut a sweep as the store in a folder is cut, if that is one of the same sweep; whether it is."""
    if not (folder / manifest.NAME).exists():
        return False
    there = Store(folder).manifest
    if there.kind != KIND:
        return False
    mine, parts = job.work.chunks.parts, chunks_of(there.layout).parts
    if [part._replace(at_once=0) for part in mine] != [part._replace(at_once=0) for part in parts]:
        return False
    job.work.cut([part.at_once for part in parts])
    return True
