"""What a worker does, in whichever process: join a store, rebuild its job, compute chunks, write their parts.

Only JSON values travel to it, and only counts travel back.
"""

import functools
import json
import threading
import time
from dataclasses import asdict
from typing import NamedTuple

from ..storage.files import FileError
from .job import Job, Plain, rebuild
from .store import Store

PAUSE = 0.2  # seconds before asking again for chunks that others compute


class Done(NamedTuple):
    """A chunk that a worker had in its hands; `tally` is None where it is there already, or another's."""

    chunk: int
    seconds: float
    tally: dict[str, int] | None


def compute(job: Job, store: Store, index: int) -> dict[str, int] | None:
    """Compute a chunk and write its part, unless it is there or claimed; its tally if it was computed."""
    with store.claim(index) as mine:
        if not mine:
            return None
        columns = job.run(index)
        tally = {name: int(n) for name, n in job.tally(columns).items()}
        store.write(index, columns, tally)
        return tally


def _joined(folder: str, reference: Plain) -> tuple[Store, Job]:
    """Store and job of a reference, once it is sure that they belong together.

    A worker may live longer than a folder: another run of the same name is another job.
    """
    try:
        store = Store(folder)
    except FileNotFoundError as error:
        raise FileError(
            f"{folder}: a worker does not find it; a folder on a disk that all share is needed"
        ) from error
    manifest = json.dumps(asdict(store.manifest), sort_keys=True)
    return store, _own.rebuilt(folder, json.dumps(reference, sort_keys=True), manifest)


class _OfThisThread(threading.local):
    """What a thread rebuilt: a job keeps what its launches share, so that no two threads may have one."""

    def __init__(self) -> None:
        self.rebuilt = functools.lru_cache(maxsize=8)(_rebuild)


def _rebuild(folder: str, text: str, manifest: str) -> Job:
    """The job of a reference (its JSON) for a store with this manifest."""
    store, job = Store(folder), rebuild(json.loads(text))
    try:
        store.manifest.check(job)
    except FileError as error:
        raise FileError(f"{folder}: a worker is refused: {error}") from error
    return job


_own = _OfThisThread()


def work(folder: str, reference: Plain, indices: list[int]) -> list[Done]:
    """Compute some chunks of the job of a store.

    Raises:
        FileError: the store cannot be read or written here, or this process would compute something else:
            it has another version of the package, say.
    """
    store, job = _joined(folder, reference)
    found = []
    for index in indices:
        began = time.perf_counter()
        tally = compute(job, store, index)
        found.append(Done(index, time.perf_counter() - began, tally))
    return found


class Share:
    """`work` as a scheduler that ends jobs, and begins them again, takes it (submitit's checkpoint)."""

    def __call__(self, folder: str, reference: Plain, indices: list[int]) -> list[Done]:
        """`work`."""
        return work(folder, reference, indices)

    def checkpoint(self, folder: str, reference: Plain, indices: list[int]) -> object:
        """The same again, in a new job: what is finished is in the store."""
        from submitit.helpers import DelayedSubmission

        return DelayedSubmission(self, folder, reference, indices)
