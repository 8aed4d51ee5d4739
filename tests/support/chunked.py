"""A job of no kernels: numbers from their own indices, chunk by chunk, as slowly as one likes; and its run.

python tests/support/chunked.py FOLDER ROWS CHUNK SECONDS      runs it in this process
"""

import sys
import time

import numpy as np

from slcp_warp.runs.job import Job, makes_jobs, reference_to
from slcp_warp.runs.running import run
from slcp_warp.runs.store import Store


class Numbers(Job):
    """`rows` numbers that a seed and their index decide, in chunks of `chunk`; each takes `seconds`."""

    kind = "numbers"

    def __init__(self, rows: int = 100, chunk: int = 10, seed: int = 0, seconds: float = 0.0, **more) -> None:
        self.rows, self.chunk, self.seed, self.seconds, self.more = rows, chunk, seed, seconds, more
        self.count = -(-rows // chunk)
        self.ran: list[int] = []

    def specification(self):
        return {"rows": self.rows, "seed": self.seed, "more": self.more}

    def layout(self):
        return {"chunk": self.chunk}

    def reference(self):
        arguments = {"rows": self.rows, "chunk": self.chunk, "seed": self.seed, "seconds": self.seconds}
        return reference_to(numbers, **arguments, **self.more)

    def tally(self, columns):
        return {"rows": len(columns["row"]), "failures": int((~columns["good"]).sum())}

    def run(self, index):
        self.ran.append(index)
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


def finished(folder, job=None) -> Store:
    """The store of a job, once it has run to the end."""
    job = Numbers() if job is None else job
    store = Store.open(folder, job)
    assert run(job, store).complete
    return store


if __name__ == "__main__":
    folder, rows, chunk, seconds = sys.argv[1:]
    sys.modules["chunked"] = sys.modules["__main__"]  # as workers know it
    job = Numbers(int(rows), int(chunk), seconds=float(seconds))
    outcome = run(job, Store.open(folder, job))
    print(outcome.complete, outcome.signal, len(outcome.computed), len(outcome.again))
