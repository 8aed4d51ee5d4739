"""One side of `slcp bench contacts`, in a process of its own: run by any interpreter that has slcp-warp.

Only the public interface is used, so that an older version runs the same file. The parent writes a job a
line, this process answers with the CPU seconds of a step of a world in one call, what else it found, or
with what went wrong. The first call of a job compiles its kernels and is not timed. Launches use one thread.
"""

import json
import sys
import time
from collections import Counter
from typing import Any

import numpy as np
import warp as wp

import slcp_warp as slcp

PROBE = 0.3  # CPU seconds that are spent on finding out how long a step takes
SETTLING = 20.0  # CPU seconds after which a scene that settles is taken as it is,
PIECE = 25  # looked at after so many steps


class Job:
    """A rollout to be timed.

    Given as: scene (a file), starts (a file of (B, nx)), worlds (that are timed, of these), steps, settle
    (steps made before, from the first start alone; they may be dearer than those at rest, and do not count),
    most (CPU seconds of a call, beyond which there are fewer worlds, then steps), options, dtype, strategy.
    All starts are run once to see which are solved, as far as ten times `most` reach.
    """

    def __init__(self, given: dict[str, Any]) -> None:
        sim = slcp.Simulator(slcp.load_scene(given["scene"]), slcp.Options(**given["options"]), device="cpu",
                             dtype=given["dtype"], strategy=given["strategy"])  # fmt: skip
        x = np.load(given["starts"]).astype(given["dtype"])
        self.sim, self.us = sim, np.zeros((1, given["steps"], sim.nu), x.dtype)
        if given["settle"]:
            x = np.tile(self.settled(x[:1], given["settle"]), (len(x), 1))
        most = round(given["most"] / self.step_seconds(x[:1]))
        steps = max(1, min(given["steps"], most))
        seen = np.ascontiguousarray(x[: max(1, 10 * most // steps)])
        done = sim.rollout(seen, np.zeros((len(seen), steps, sim.nu), x.dtype))
        worlds = max(1, min(given["worlds"], most // steps))
        self.x, self.us = seen[:worlds].copy(), np.zeros((worlds, steps, sim.nu), x.dtype)
        self.made = outcome(done.states[:worlds], done.status[:worlds])["made"]
        self.facts = {"strategy": sim.strategy, "rows": sim.nr, "batch": worlds, "steps": steps}
        self.facts |= {"seen": len(seen), **outcome(done.states, done.status)}

    def settled(self, x: np.ndarray, steps: int) -> np.ndarray:
        """The state after so many steps of a world (1, nx), or after those that there was time for."""
        made, spent = 0, 0.0
        self.sim.rollout(x, self.us[:, :1])
        while made < steps and spent < SETTLING:
            count = min(PIECE, steps - made)
            begin = time.process_time()
            x = self.sim.rollout(x, np.zeros((1, count, self.sim.nu), x.dtype)).states[:, -1]
            spent += time.process_time() - begin
            made += count
        return x

    def seconds(self) -> float:
        """CPU seconds of a step of a world."""
        begin = time.process_time()
        self.sim.rollout(self.x, self.us)
        return (time.process_time() - begin) / self.made

    def step_seconds(self, x: np.ndarray) -> float:
        """CPU seconds of one of the first steps of a world (1, nx), more and more of them made."""
        count, spent = 1, 0.0
        self.sim.rollout(x, self.us[:, :1])
        while spent < PROBE and count <= self.us.shape[1]:
            begin = time.process_time()
            done = self.sim.rollout(x, self.us[:, :count])
            spent = (time.process_time() - begin) / outcome(done.states, done.status)["made"]
            count, spent = 4 * count, spent * count
        return max(4.0 * spent / count, 1e-7)


def outcome(states: np.ndarray, status: np.ndarray) -> dict[str, Any]:
    """Steps that were made, worlds that were not solved, and how far any of them moved, of a rollout.

    A world stands still from the step on that was not solved; that step counts as made.
    """
    failed = status != slcp.Status.SOLVED
    count = states.shape[1] - 1
    moving = (np.diff(states[failed], axis=1) != 0.0).any(axis=2)
    made = (~failed).sum() * count + np.minimum(moving.sum(axis=1) + 1, count).sum()
    nv = states.shape[2] // 2
    moved = np.abs(states[:, -1, :nv] - states[:, 0, :nv]).max()
    kinds = Counter(slcp.Status(code).name for code in status[failed].tolist())
    text = ", ".join(f"{kinds[name]} {name}" for name in sorted(kinds))
    return {"made": int(made), "unsolved": int(failed.sum()), "moved": float(moved), "statuses": text}


def main() -> None:
    """Answer the parent's lines until there are no more."""
    jobs: dict[str, Job] = {}
    answers = sys.stdout
    sys.stdout = sys.stderr
    wp.config.log_level = wp.LOG_ERROR
    for line in sys.stdin:
        try:
            if line not in jobs:
                jobs[line] = Job(json.loads(line))
                answer: dict[str, Any] = jobs[line].facts
            else:
                answer = {"seconds": jobs[line].seconds()}
        except Exception as error:  # an older version may lack what a job needs: say so, go on
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
