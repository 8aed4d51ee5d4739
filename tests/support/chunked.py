"""A job of no kernels: numbers from their own indices, chunk by chunk, as slowly as one likes; and its run.

python tests/support/chunked.py FOLDER ROWS CHUNK SECONDS      runs it in this process
"""

import os
import sys
import time
from pathlib import Path

import numpy as np

from slcp_warp.runs import origin
from slcp_warp.runs.executors import processes
from slcp_warp.runs.job import Job, makes_jobs, reference_to
from slcp_warp.runs.running import run
from slcp_warp.runs.store import Store


class Numbers(Job):
    """`rows` numbers that a seed and their index decide, in chunks of `chunk`; each takes `seconds`,
    and is noted in the file `log` when it begins."""

    kind = "numbers"

    def __init__(self, rows=100, chunk=10, seed=0, seconds=0.0, log=None, **more) -> None:
        self.rows, self.chunk, self.seed, self.seconds, self.more = rows, chunk, seed, seconds, more
        self.log = log
        self.count = -(-rows // chunk)
        self.ran: list[int] = []

    def specification(self):
        return {"rows": self.rows, "seed": self.seed, "more": self.more}

    def layout(self):
        return {"chunk": self.chunk}

    def reference(self):
        arguments = {"rows": self.rows, "chunk": self.chunk, "seed": self.seed, "seconds": self.seconds}
        return reference_to(
            numbers, **arguments, log=None if self.log is None else str(self.log), **self.more
        )

    def tally(self, columns):
        return {"rows": len(columns["row"]), "failures": int((~columns["good"]).sum())}

    def run(self, index):
        self.ran.append(index)
        if self.log is not None:
            with open(self.log, "a") as file:
                file.write(f"{index} {os.getpid()}\n")
        if self.more.get("fails") == index:
            raise ValueError(f"there is no number {index}")
        if self.more.get("dies") == index:
            os.kill(os.getpid(), 9)
        time.sleep(self.seconds)
        row = np.arange(index * self.chunk, min(self.rows, (index + 1) * self.chunk))
        draws = [np.random.default_rng((self.seed, i)).standard_normal(7) for i in row]
        drawn = np.array(draws).reshape(len(row), 7)
        return {
            "row": row,
            "name": np.array([("even", "ödd")[i % 2] for i in row.tolist()]),
            "single": drawn[:, 0].astype(np.float32),
            "double": drawn[:, 1],
            "gain": drawn[:, 1:].reshape(-1, 2, 3),
            "good": drawn[:, 2] > -1.0,
        }


@makes_jobs
def numbers(**arguments) -> Numbers:
    return Numbers(**arguments)


class Kept(Numbers):
    """Numbers of which a store's manifest says the seed."""

    def __init__(self, folder, seed) -> None:
        super().__init__(seed=seed)
        self.folder = folder

    def reference(self):
        return reference_to(kept, folder=str(self.folder))


@makes_jobs
def kept(folder) -> Kept:
    return Kept(folder, Store(folder).manifest.specification["seed"])


def finished(folder, job=None) -> Store:
    """The store of a job, once it has run to the end."""
    job = Numbers() if job is None else job
    store = Store.open(folder, job)
    assert run(job, store).complete
    return store


def of_another_version() -> None:
    """In a worker: it finds another version of the package."""
    origin.__version__ = "9.9"


def starts(log) -> list[tuple[int, int]]:
    """The chunks that were begun, and by which process, in order."""
    path = Path(log)
    return [tuple(map(int, line.split())) for line in path.read_text().splitlines()] if path.exists() else []


def main(folder: str, rows: str, chunk: str, seconds: str, log: str, count: str) -> None:
    job = Numbers(int(rows), int(chunk), seconds=float(seconds), log=log)
    executor = processes(int(count)) if int(count) else None
    outcome = run(job, Store.open(folder, job), executor)
    print(outcome.complete, outcome.signal, len(outcome.computed))


if __name__ == "__main__":
    import chunked  # as workers know it

    chunked.main(*sys.argv[1:])
