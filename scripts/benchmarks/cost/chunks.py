"""`slcp bench chunks`: what a chunk of a run costs beside its rows, in this process and in workers."""

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from slcp_warp.runs import Job, Store, makes_jobs, processes, reference_to, run

from ..shared.machine import machine

COLUMNS = 12  # in single precision, beside a text and a number of the world
Rows = list[dict[str, Any]]


class Numbers(Job):
    """Random columns; `seconds` is what they take by themselves."""

    kind = "numbers"

    def __init__(self, rows: int, count: int) -> None:
        self.rows, self.count = rows, count
        self.wall = self.cpu = 0.0

    def specification(self) -> dict[str, Any]:
        """So many rows in so many chunks."""
        return {"rows": self.rows, "chunks": self.count}

    def reference(self) -> dict[str, Any]:
        """Of `numbers`."""
        return reference_to(numbers, rows=self.rows, count=self.count)

    def run(self, index: int) -> dict[str, np.ndarray]:
        """A chunk's columns."""
        wall, cpu = time.perf_counter(), time.process_time()
        drawn = np.random.default_rng(index).standard_normal((COLUMNS, self.rows)).astype(np.float32)
        columns = {f"measure{i}": column for i, column in enumerate(drawn)}
        columns |= {"policy": np.full(self.rows, "library"), "world": np.arange(self.rows)}
        self.wall += time.perf_counter() - wall
        self.cpu += time.process_time() - cpu
        return columns


@makes_jobs
def numbers(rows: int, count: int) -> Numbers:
    """The job in a worker."""
    return Numbers(rows, count)


def bench_chunks(sizes: tuple[int, ...] = (1024, 8192, 65536), count: int = 50, workers: int = 2) -> Rows:
    """Milliseconds a chunk, less those of its columns: processor and wall time here, wall time of workers.

    Args:
        sizes: rows of a chunk.
        count: chunks.
        workers: processes.
    """
    facts = machine()
    out: Rows = []
    with processes(workers) as executor:
        for rows in (sizes[0], *sizes):  # the first warms up, and starts the workers
            with _store(rows, count) as (job, store):
                wall, cpu = time.perf_counter(), time.process_time()
                run(job, store)
                wall, cpu = time.perf_counter() - wall - job.wall, time.process_time() - cpu - job.cpu
                begin = time.perf_counter()
                store.set_damaged_aside()
                check = time.perf_counter() - begin
                size = store.part(0).stat().st_size
                own = job.wall / count
            with _store(rows, count) as (job, store):
                begin = time.perf_counter()
                run(job, store, executor)
                spread = (time.perf_counter() - begin) / count * workers - own
            row = {"rows": rows, "kB": size / 1e3, "CPU [ms]": cpu / count * 1e3}
            row |= {"wall [ms]": wall / count * 1e3, "check [ms]": check / count * 1e3}
            out.append(row | {f"a worker of {workers} [ms]": spread * 1e3})
    return [facts | each for each in out[1:]]


@contextmanager
def _store(rows: int, count: int) -> Iterator[tuple[Numbers, Store]]:
    """A job in a folder of its own; the module's name is one that workers can import."""
    with tempfile.TemporaryDirectory(prefix="chunks-") as folder:
        job = Numbers(rows, count)
        yield job, Store.open(folder, job)
