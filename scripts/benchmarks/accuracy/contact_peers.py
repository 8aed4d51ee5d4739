"""Contact study of the peers: error against cost on the problems of the work-precision diagrams."""

import time
from collections.abc import Iterable
from typing import Any

import numpy as np

from ..exact.problems import STEP_SIZES, Problem, problems
from ..peers.drake import Drake
from ..peers.mjx import MJX
from ..peers.mujoco import MuJoCo
from ..peers.mujoco_warp import MuJoCoWarp
from ..peers.peer import Peer, Run, configurations, installed
from ..shared.overlap import overlap
from ..shared.rows import ONE_THREAD, Rows, Say
from ..shared.timing import Case, Result, time_interleaved

REPEATS = 3
SHARE = (  # of the peers that take long: they run these problems with these step sizes
    ("finger impact", "sliding stop", "pendulum chain"),
    (0.05, 0.02, 0.01, 0.005),
)


def everyone(say: Say) -> list[Peer]:
    """The peers that are installed."""
    return installed((MuJoCo, MuJoCoWarp, MJX, Drake), say)


def rows(
    say: Say,
    peers: Iterable[Peer] | None = None,
    chosen: Iterable[Problem] | None = None,
    step_sizes: Iterable[float] | None = None,
) -> Rows:
    """A row for every peer, problem, set of options and step size; by default all that fit in minutes."""
    out: Rows = []
    for peer in everyone(say) if peers is None else peers:
        start, whole = time.perf_counter(), isinstance(peer, MuJoCo)
        todo = tuple(chosen or (p for p in problems() if whole or p.name in SHARE[0]))
        sizes = tuple(step_sizes or (STEP_SIZES if whole else SHARE[1]))
        for problem in todo:
            out += problem_rows(peer, problem, sizes)
        say(f"{peer.name} {peer.version}: {len(todo)} problems in {time.perf_counter() - start:.0f} s")
    return out


def problem_rows(peer: Peer, problem: Problem, step_sizes: tuple[float, ...], study: str = "contact") -> Rows:
    """A peer on a problem: its errors, overlaps and times, with its model's deviation as a note."""
    runs = [
        (setting, h, peer.prepare(problem.scene, problem.starts, problem.duration, h, setting))
        for setting in peer.settings(problem.contacts)
        for h in step_sizes
    ]
    deviation = peer.deviation(problem.scene, configurations(problem.scene, problem.starts))
    compiling: dict[str, float] = {}
    for setting, _, run in runs:
        compiling[setting] = compiling.get(setting, 0.0) + run.compile_seconds
    clock = (
        time.process_time if all(run.facts["device"] == "cpu" for _, _, run in runs) else time.perf_counter
    )
    cases = [Case(f"{setting} {h}", run.simulate, run.worlds) for setting, h, run in runs]
    results = time_interleaved(cases, REPEATS, clock)
    return [
        {"study": study, "problem": problem.name, "program": peer.name, "version": peer.version,
         "curve": f"{peer.name}, {setting}", "knob": "h", "value": h, "h": h,
         "compile_seconds": compiling[setting], "note": deviation.note}
        | accuracy(problem, run, h) | cost(run, result)
        for (setting, h, run), result in zip(runs, results)
    ]  # fmt: skip


def accuracy(problem: Problem, run: Run, h: float) -> dict[str, Any]:
    """Columns of error and overlap; an error is infinite where a state is not finite."""
    states = run.rollout()
    finite = np.isfinite(states).all(axis=(1, 2))
    error = np.where(finite, problem.errors(np.nan_to_num(states[:, -1])), np.inf)
    found = overlap(problem.scene, states[finite], h)
    return problem.typical(error) | {
        "solved_share": finite.mean(), "penetration": found.penetration, "missed": found.missed,
    }  # fmt: skip


def cost(run: Run, result: Result) -> dict[str, Any]:
    """Columns of cost per simulated second and world."""
    seconds, single = result.seconds / run.seconds, run.facts.get("threads") == 1
    low, middle, high = np.percentile(seconds, [10, 50, 90])
    return {
        "seconds": middle, "seconds_p10": low, "seconds_p90": high, "seconds_best": seconds.min(),
        "repeats": len(seconds), "cost_of": "simulated second",
        "clock": "wall" if run.facts["device"] != "cpu" else ONE_THREAD if single else "process CPU",
    } | run.facts  # fmt: skip
