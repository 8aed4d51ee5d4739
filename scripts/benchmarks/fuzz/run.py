"""Running a task: verdicts on its worlds under its methods, and the twins that must agree bit for bit."""

from collections import Counter
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import StrategyError
from slcp_warp.kernels.device import launch
from slcp_warp.options import Options, Status
from slcp_warp.results.pictures.kinematics import Array

from .differences import LIMIT, gradient_errors, jacobian_errors
from .draws import CLASSES, Worlds
from .judged import judged, numbers_for, predicted, step
from .problem import Truth
from .tasks import Failure, Tally, Task, key_of
from .verdicts import HOLDS, SILENT, UNPROVEN, WRONG, Verdicts

SHOWN = 5  # failures that a task keeps of each kind
COMPARED = 12  # worlds of a scene whose derivatives are compared


def run_task(task: Task, threads: int = 1) -> Tally:
    """All of a task."""
    launch._default_threads = threads
    tally, scene = Tally(), task.make_scene()
    for chunk in range(task.chunks):
        worlds = task.worlds(chunk, scene)
        truth = Truth(scene, worlds)
        for options, dtype in task.methods():
            try:
                sim = slcp.Simulator(scene, options, device="cpu", dtype=dtype, strategy=task.strategy)
            except StrategyError:
                continue
            push, known = None, np.ones(len(worlds.x), bool)
            if options.integrator == "trapezoidal":
                push, known = predicted(scene, worlds, options, dtype)
            verdicts, done = judged(worlds, sim, push, truth)
            _count(tally, task, chunk, worlds, options, dtype, verdicts, known)
            _twins(tally, task, chunk, worlds, sim, done)
            if chunk == 0 and task.differentiates and dtype == "float64" and options.gap == "start":
                _derivatives(tally, task, worlds, sim, verdicts)
    return tally


def _count(tally: Tally, task: Task, chunk: int, worlds: Worlds, options: Options, dtype: str,
           verdicts: Verdicts, known: Array) -> None:  # fmt: skip
    """Put the verdicts into the tally; `known`: worlds whose equation of motion the oracle can write down."""
    kept: Counter[str] = Counter()
    unknown = ["motion", "update", "no solution", "runaway"]
    unknown += ["contact"] if options.gap == "end" else []
    for i, kind in enumerate(worlds.kind):
        verdict, reason = verdicts.verdict[i], verdicts.reason[i]
        if not known[i] and verdict == SILENT and any(part in reason for part in unknown):
            verdict = UNPROVEN
        key = (*key_of(task, options, dtype), CLASSES[kind])
        status = Status(int(verdicts.out.status[i])).name
        tally.counts.update([(*key, "worlds"), (*key, status), (*key, f"verdict {verdict}")])
        error = float(verdicts.worst[i])
        if verdict == HOLDS and known[i]:
            tally.worst[key] = max(error, tally.worst.get(key, 0.0))
        if verdict in (SILENT, WRONG):
            kept[verdict] += 1
            if kept[verdict] <= SHOWN:
                error, place = float(verdicts.errors.worst()[i]), chunk * task.per_chunk + i
                tally.failures.append(
                    Failure(task, place, options, dtype, CLASSES[kind], verdict, str(reason), error)
                )


def _twins(tally: Tally, task: Task, chunk: int, worlds: Worlds, sim: Any, done: Any) -> None:
    """A world alone, and the batch under two threads, must give the same bits."""

    def same(other: Any, keep: Any) -> Array:
        parts = ("state", "impulse", "gap")
        equal = [np.asarray(getattr(done, n))[keep] == np.asarray(getattr(other, n)) for n in parts]
        return np.concatenate(equal, 1).all(1) & (np.asarray(done.status)[keep] == np.asarray(other.status))

    few = np.arange(0, len(worlds.x), max(1, len(worlds.x) // 8))
    alone = [same(step(sim, worlds.part(i), numbers_for(sim, worlds.part(i))), [i])[0] for i in few]
    before, launch._default_threads = launch._default_threads, 2
    together = same(step(sim, worlds, numbers_for(sim, worlds)), slice(None))
    launch._default_threads = before
    for what, places, equal in (
        ("single", few, np.array(alone)),
        ("threads", np.arange(len(together)), together),
    ):
        key = (*key_of(task, sim.options, sim.dtype.__name__), "all")
        tally.counts[(*key, f"compared {what}")] += len(places)
        for i in places[~equal][:SHOWN]:
            place, kind = chunk * task.per_chunk + int(i), CLASSES[worlds.kind[i]]
            tally.failures.append(Failure(task, place, sim.options, sim.dtype.__name__, kind, WRONG,
                                          f"differs: {what}", np.inf))  # fmt: skip


def _derivatives(tally: Tally, task: Task, worlds: Worlds, sim: Any, verdicts: Verdicts) -> None:
    """A, B and gradients by all parameters at a few solved worlds, against differences of the step."""
    solved = np.flatnonzero((verdicts.verdict == HOLDS) & (verdicts.out.status == Status.SOLVED))
    places = solved[:: max(1, len(solved) // COMPARED)][:COMPARED]
    if not len(places) or not task.differentiates:
        return
    part = worlds.part(places)
    params = sim.params.replace(**{n: v for n, v in numbers_for(sim, part).items() if np.size(v)})
    key = (*key_of(task, sim.options, sim.dtype.__name__), "all")
    with np.errstate(all="ignore"):
        found = {
            "derivatives": jacobian_errors(sim, part.x, part.u, params),
            "gradients": gradient_errors(sim, part.x, part.u, params, task.seed),
        }
    for what, (error, trusted) in found.items():
        tally.counts[(*key, f"compared {what}")] += int(trusted.sum())
        for i in np.flatnonzero(trusted & ~(error <= LIMIT)).tolist()[:SHOWN]:
            tally.failures.append(
                Failure(task, int(places[i]), sim.options, sim.dtype.__name__, CLASSES[part.kind[i]], WRONG,
                        f"differs: {what}", float(error[i]))
            )  # fmt: skip
