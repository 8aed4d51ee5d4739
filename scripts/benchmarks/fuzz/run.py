"""Running a task: verdicts on its worlds under its methods, and the twins that must agree bit for bit."""

import contextlib
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from slcp_warp import StrategyError
from slcp_warp.description.kinematics import Array
from slcp_warp.kernels.device import launch
from slcp_warp.options import Options, Status

from . import swept
from .differences import CURVED, LIMIT, curvature_errors, gradient_errors, jacobian_errors
from .draws import CLASSES, Worlds
from .judged import judged, led, numbers_for, parameters, predicted, simulator, step
from .problem import Truth
from .rolled import follow, roll
from .tasks import Failure, Tally, Task, key_of
from .verdicts import HOLDS, SILENT, WRONG, Verdicts, reasons

SHOWN = 5  # failures that a task keeps of each kind
COMPARED = 12  # worlds of a scene whose derivatives are compared


def run_task(task: Task, threads: int = 1) -> Tally:
    """All of a task."""
    launch._default_threads = threads
    tally, scene = Tally(), task.make_scene()
    for chunk in range(task.chunks):
        worlds = task.worlds(chunk, scene)
        truth = Truth(scene, worlds) if task.steps == 1 else None
        for options, dtype in task.methods():
            if task.part == "sweeps":
                _sweep(tally, task, chunk, worlds, options)
                continue
            try:
                sim = simulator(scene, options, dtype, task.strategy, task.device)
            except StrategyError:
                continue
            if truth is None:
                _rollout(tally, task, chunk, worlds, sim)
                continue
            push, known = None, np.ones(len(worlds.x), bool)
            if options.integrator == "trapezoidal":
                push, known = predicted(scene, worlds, options, dtype)
            reached = None
            if options.integrator == "leapfrog":
                reached, known = led(sim, worlds)
            verdicts, done = judged(worlds, sim, push, truth, reached=reached)
            places = [(chunk * task.per_chunk + i, None) for i in range(len(worlds.x))]
            _count(tally, task, places, worlds, options, dtype, verdicts, known)
            _twins(tally, task, chunk, worlds, sim, done)
            if chunk == 0 and task.differentiates and dtype == "float64" and options.gap == "start":
                _derivatives(tally, task, worlds, sim, verdicts)
    return tally


def _sweep(tally: Tally, task: Task, chunk: int, worlds: Worlds, options: Options) -> None:
    """A sweep of the worlds, and a loop over steps that makes the same."""
    scene = task.make_scene()
    us = task.controls(chunk, scene)
    equal, trusted = swept.compare(scene, worlds, us, options, task.strategy, task.device)
    sim = simulator(scene, options, "float64", task.strategy, task.device)
    places = np.flatnonzero(trusted)
    _compared(tally, task, chunk, worlds, sim, "sweep", places, equal[places])


def _rollout(tally: Tally, task: Task, chunk: int, worlds: Worlds, sim: Any) -> None:
    """Worlds that are followed: every step judged, and twins: a world alone, two threads."""
    us = task.controls(chunk, sim.scene)
    run = roll(sim, worlds, us)
    options, dtype = sim.options, sim.dtype.__name__
    for piece in follow(run, worlds, us).pieces():
        push, known = None, np.ones(len(piece.world), bool)
        if options.integrator == "trapezoidal":
            push, known = predicted(sim.scene, piece.worlds, options, dtype)
        verdicts, _ = judged(piece.worlds, sim, push, out=piece.out)
        first = chunk * task.per_chunk
        places = [(first + int(i), int(k)) for i, k in zip(piece.world, piece.step)]
        _count(tally, task, places, piece.worlds, options, dtype, verdicts, known)

    def same(other: Any, keep: Any) -> Array:
        equal = np.asarray(run.states)[keep] == np.asarray(other.states)
        return equal.all((1, 2)) & (np.asarray(run.status)[keep] == np.asarray(other.status))

    few = np.arange(0, len(worlds.x), max(1, len(worlds.x) // 4))
    alone = np.array([same(roll(sim, worlds.part(i), us[[i]]), [i])[0] for i in few])
    _compared(tally, task, chunk, worlds, sim, "single", few, alone)
    with _threads(2):
        together = same(roll(sim, worlds, us), slice(None))
    _compared(tally, task, chunk, worlds, sim, "threads", np.arange(len(together)), together)


def _count(tally: Tally, task: Task, places: Sequence[tuple[int, int | None]], worlds: Worlds,
           options: Options, dtype: str, verdicts: Verdicts, known: Array) -> None:  # fmt: skip
    """Put the verdicts into the tally; `places`: world and step of each; `known`: worlds whose equation of
    motion the oracle can write down.
    """
    kept: Counter[str] = Counter()
    verdicts.doubt(known)
    if task.explains:
        for name, reason in reasons(verdicts.out.status, worlds.kind, verdicts.part):
            tally.counts[(*key_of(task, options, dtype), name, f"unsolved {reason}")] += 1
    for i, kind in enumerate(worlds.kind):
        verdict, reason = verdicts.verdict[i], verdicts.reason[i]
        key = (*key_of(task, options, dtype), CLASSES[kind])
        status = Status(int(verdicts.out.status[i])).name
        tally.counts.update([(*key, "worlds"), (*key, status), (*key, f"verdict {verdict}")])
        error = float(verdicts.worst[i])
        if verdict == HOLDS and known[i]:
            tally.worst[key] = max(error, tally.worst.get(key, 0.0))
        if verdict in (SILENT, WRONG):
            kept[verdict] += 1
            if kept[verdict] <= SHOWN:
                error, (place, step_of) = float(verdicts.errors.worst()[i]), places[i]
                tally.failures.append(
                    Failure(task, place, options, dtype, CLASSES[kind], verdict, str(reason), error, step_of)
                )


def _twins(tally: Tally, task: Task, chunk: int, worlds: Worlds, sim: Any, done: Any) -> None:
    """A world alone, and the batch under two threads, must give the same bits."""

    def same(other: Any, keep: Any) -> Array:
        parts = ("state", "impulse", "gap")
        equal = [np.asarray(getattr(done, n))[keep] == np.asarray(getattr(other, n)) for n in parts]
        return np.concatenate(equal, 1).all(1) & (np.asarray(done.status)[keep] == np.asarray(other.status))

    few = np.arange(0, len(worlds.x), max(1, len(worlds.x) // 8))
    alone = [same(step(sim, worlds.part(i), numbers_for(sim, worlds.part(i))), [i])[0] for i in few]
    with _threads(2):
        together = same(step(sim, worlds, numbers_for(sim, worlds)), slice(None))
    _compared(tally, task, chunk, worlds, sim, "single", few, np.array(alone))
    _compared(tally, task, chunk, worlds, sim, "threads", np.arange(len(together)), together)


@contextlib.contextmanager
def _threads(count: int) -> Iterator[None]:
    """Kernels run in so many threads."""
    before, launch._default_threads = launch._default_threads, count
    try:
        yield
    finally:
        launch._default_threads = before


def _compared(tally: Tally, task: Task, chunk: int, worlds: Worlds, sim: Any, what: str, places: Array,
              equal: Array) -> None:  # fmt: skip
    """Count worlds that were run otherwise, and keep those with other bits."""
    key = (*key_of(task, sim.options, sim.dtype.__name__), "all")
    tally.counts[(*key, f"compared {what}")] += len(places)
    for i in np.asarray(places)[~equal][:SHOWN]:
        place, kind = chunk * task.per_chunk + int(i), CLASSES[worlds.kind[i]]
        tally.failures.append(Failure(task, place, sim.options, sim.dtype.__name__, kind, WRONG,
                                      f"differs: {what}", np.inf))  # fmt: skip


def _derivatives(tally: Tally, task: Task, worlds: Worlds, sim: Any, verdicts: Verdicts) -> None:
    """A, B, second derivatives and gradients by parameters at a few solved worlds, against differences."""
    smooth = (verdicts.verdict == HOLDS) & (verdicts.out.status == Status.SOLVED)
    if sim.options.depenetration_speed is not None:  # what touches exactly has a kink, where overlaps stay
        smooth &= (verdicts.problem.near != 0.0).all(1)
    solved = np.flatnonzero(smooth)
    places = solved[:: max(1, len(solved) // COMPARED)][:COMPARED]
    if not len(places) or not task.differentiates:
        return
    part = worlds.part(places)
    params = parameters(sim, numbers_for(sim, part))
    key = (*key_of(task, sim.options, sim.dtype.__name__), "all")
    with np.errstate(all="ignore"):
        found = {
            "derivatives": jacobian_errors(sim, part.x, part.u, params),
            "curvatures": curvature_errors(sim, part.x, part.u, params, task.seed),
            "gradients": gradient_errors(sim, part.x, part.u, params, task.seed),
        }
    for what, (error, trusted) in found.items():
        limit = CURVED if what == "curvatures" else LIMIT
        tally.counts[(*key, f"compared {what}")] += int(trusted.sum())
        for i in np.flatnonzero(trusted & ~(error <= limit)).tolist()[:SHOWN]:
            tally.failures.append(
                Failure(task, int(places[i]), sim.options, sim.dtype.__name__, CLASSES[part.kind[i]], WRONG,
                        f"differs: {what}", float(error[i]))
            )  # fmt: skip
