"""Running a random scene: its worlds under its methods, verdicts, and the twins that must agree bit for bit.

A task is one scene under the generic kernels and many methods, or under specialised
kernels and one method, which compile for seconds. World i of scene s of a seed is always the same.
"""

import dataclasses
from collections import Counter
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp import Scene
from slcp_warp.kernels.device import launch
from slcp_warp.options import OptionError, Options, Status
from slcp_warp.strategy import StrategyError

from ...support.kinematics import Array
from .differences import LIMIT, gradient_errors, jacobian_errors
from .draws import CHUNK, CLASSES, Worlds, draw_worlds
from .judge import Outcome
from .problem import Problem, Truth
from .proofs import least_motion
from .structures import SMALL, Size, random_scene
from .verdicts import HOLDS, SILENT, UNPROVEN, WRONG, Verdicts

DTYPES = ("float64", "float32")
FIELDS = ("residual", "scaling", "friction", "integrator", "noise", "deviation", "gap")
WELL_POSED = 1e4  # condition of a mass matrix in units of its diagonal
DIFFERENTIATED, COMPARED = 4, 12  # every so many scenes with kernels of their own; worlds of it
SHOWN = 5  # failures that a task keeps of each kind
GENERIC = [
    Options(residual, scaling, friction)
    for residual, friction, scalings in (
        ("hard", "anitescu", ("inertia", "none")), ("hard", "coulomb", ("inertia",)),
        ("rem-logistic", "anitescu", ("inertia", "none")), ("rem-normal", "anitescu", ("inertia", "none")),
    )
    for scaling in scalings
]  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Task:
    """A scene's worlds under some kernels: `scene` is its number; `chunks` of CHUNK worlds each."""

    seed: int
    scene: int
    strategy: str
    chunks: int = 1
    residuals: tuple[str, ...] = ()
    per_chunk: int = CHUNK

    @property
    def differentiates(self) -> bool:
        """Whether derivatives are compared, too: they compile as long again."""
        return self.strategy == "specialised" and self.scene % DIFFERENTIATED == 0

    def make_scene(self) -> Scene:
        """The random scene."""
        rng = np.random.default_rng([self.seed, self.scene, self.strategy == "specialised"])
        name = f"fuzz-{self.seed}-{self.strategy}-{self.scene}"
        return random_scene(rng, name, SMALL if self.strategy == "specialised" else Size())

    def worlds(self, chunk: int, scene: Scene) -> Worlds:
        """One chunk of its worlds."""
        rng = np.random.default_rng([self.seed, self.scene, self.strategy == "specialised", 1 + chunk])
        return draw_worlds(rng, scene, self.per_chunk)

    def methods(self) -> list[tuple[Options, str]]:
        """Options and precisions that it runs."""
        if self.strategy == "generic":
            chosen = [(o, d) for o in GENERIC for d in DTYPES]
        else:
            rng = np.random.default_rng([self.seed, self.scene, 2])
            chosen = [(random_options(rng), DTYPES[int(rng.random() < 0.4)])]
        return [(o, d) for o, d in chosen if not self.residuals or o.residual in self.residuals]


@dataclasses.dataclass(frozen=True)
class Failure:
    """A world that is wrong, by where it comes from, and what is wrong with it."""

    task: Task
    world: int
    options: Options
    dtype: str
    kind: str
    verdict: str
    reason: str
    error: float


@dataclasses.dataclass
class Tally:
    """What a task found: counts by (strategy, method's fields, precision, class, what), the worst error that
    holds by the same key less the last, failures.
    """

    counts: Counter[tuple[str, ...]] = dataclasses.field(default_factory=Counter)
    worst: dict[tuple[str, ...], float] = dataclasses.field(default_factory=dict)
    failures: list[Failure] = dataclasses.field(default_factory=list)

    def add(self, other: "Tally") -> None:
        """Take in another task's."""
        self.counts.update(other.counts)
        for key, value in other.worst.items():
            self.worst[key] = max(value, self.worst.get(key, 0.0))
        self.failures += other.failures


def random_options(rng: np.random.Generator) -> Options:
    """A method that the library offers."""
    while True:
        residual = str(rng.choice(
            ["hard", "rem-logistic", "rem-normal", "erm-logistic", "erm-normal"], p=(0.5, 0.2, 0.1, 0.1, 0.1)
        ))  # fmt: skip
        values: dict[str, Any] = {
            "residual": residual,
            "scaling": str(rng.choice(["inertia", "none"])),
            "friction": str(rng.choice(["anitescu", "coulomb"])),
            "integrator": str(rng.choice(["euler", "trapezoidal"], p=(0.75, 0.25))),
            "noise": str(rng.choice(["row", "state"], p=(0.75, 0.25))),
            "deviation": [None, "scale", "standard-deviation"][int(rng.integers(3))],
            "gap": str(rng.choice(["start", "end"], p=(0.6, 0.4))),
        }
        try:
            return Options(**values)
        except OptionError:
            continue


def numbers_for(sim: Any, worlds: Worlds, seed: int = 0) -> dict[str, Array]:
    """The parameters that the simulator takes, with covariances where it has noise of the state."""
    numbers = dict(worlds.numbers)
    if "position_covariance" in sim.params.names:
        nv, rng = sim.scene.nv, np.random.default_rng(seed)
        for name, size in (("position_covariance", 1e-3), ("velocity_covariance", 0.1)):
            root = size * np.asarray(rng.standard_normal((nv, nv)), np.float32).astype(float)
            numbers[name] = np.broadcast_to(
                (root @ root.T).astype(np.float32).astype(float), (len(worlds.x), nv, nv)
            )
    if not sim.nr:
        numbers.pop("sigma")
    return numbers


def step(sim: Any, worlds: Worlds, numbers: dict[str, Array], external: Array | None = None) -> Any:
    """The package's step of the worlds."""
    kind = {"float64": np.float64, "float32": np.float32}[sim.dtype.__name__]
    u = worlds.u.astype(kind) if sim.nu else None
    params = sim.params.replace(**{n: v for n, v in numbers.items() if np.size(v)})
    return sim.step(worlds.x.astype(kind), u, params, external_force=external)


def judged(worlds: Worlds, sim: Any, push: Array | None = None, truth: Truth | None = None,
           force: Array | None = None) -> tuple[Verdicts, Any]:  # fmt: skip
    """Verdicts on one step of the worlds, and the step. `push`: of the trapezoidal method, see `predicted`;
    `force` (B, nv): more generalised forces.
    """
    numbers, dtype = numbers_for(sim, worlds), sim.dtype.__name__
    full = dataclasses.replace(worlds, numbers=numbers | {"sigma": worlds.numbers["sigma"]})
    method, nv = sim.options.method, sim.scene.nv
    inner = "float64" if sim.strategy == "generic" else dtype

    def pose(keep: Array | None) -> Problem:
        if keep is None and truth is not None and not method.state_noise:
            here = truth
        elif keep is None:
            here = Truth(sim.scene, full, force)
        else:
            here = Truth(sim.scene, full.part(keep), None if force is None else force[keep])
        force_there = push if keep is None or push is None else push[keep]
        return Problem(here, here.drive(force_there), method, dtype, inner)

    problem = pose(None)
    external = None if force is None else problem.truth.mech.wrenches(worlds.x[:, :nv], force)
    done = step(sim, worlds, numbers, external)
    with np.errstate(all="ignore"):
        return Verdicts(problem, Outcome.of(done), pose), done


def predicted(scene: Scene, worlds: Worlds, options: Options) -> tuple[Array, Array]:
    """N^-1 J' lambda (B, nv) that the trapezoidal method predicts, and in which worlds it is known: where no
    row can act, where the hard problem is solved by least distances, and where without dampers the common
    kernels solve Euler's problem under a force that gives it the same free velocity and the oracle confirms
    it. Mass matrices that amplify what is left of an error are left out, Coulomb's friction, which may have
    several solutions, and gaps at the end, whose predictor bends its rows.
    """
    none = np.zeros((len(worlds.x), scene.nv))
    truth = Truth(scene, worlds)
    drive = truth.drive(none)
    method = dataclasses.replace(options, noise="row", gap="start").method
    p = Problem(truth, drive, method, "float64")
    known = np.full(len(worlds.x), method.hard) & (p.free > 0.0).all(1)
    push = none.copy()
    if method.coulomb or options.gap == "end":
        return push, known & (options.gap == "start")
    if method.hard:
        for i in np.flatnonzero(~known).tolist():
            found = least_motion(p, i)
            if found is not None and p.condition[i] < WELL_POSED:
                push[i], known[i] = found[0] - drive.free[i], True
        return push, known
    euler = dataclasses.replace(options, integrator="euler", gap="start")
    try:
        sim = slcp.Simulator(scene, euler, device="cpu", strategy="generic")
    except StrategyError:
        return push, known
    start = truth.drive()
    force = np.einsum("bij,bj->bi", start.h_mass, drive.free - start.free) / truth.h[:, None]
    verdicts, done = judged(worlds, sim, force=force)
    sure = (verdicts.verdict == HOLDS) & (np.asarray(done.status) == Status.SOLVED)
    sure &= ~known & ~truth.motion.damping.any((1, 2))
    sure &= p.condition < WELL_POSED
    found = np.asarray(done.state, float)[:, scene.nv :] - drive.free
    return np.where(sure[:, None], found, push), known | sure


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
                push, known = predicted(scene, worlds, options)
            verdicts, done = judged(worlds, sim, push, truth)
            _count(tally, task, chunk, worlds, options, dtype, verdicts, known)
            _twins(tally, task, chunk, worlds, sim, done)
            if chunk == 0 and task.differentiates and dtype == "float64" and options.gap == "start":
                _derivatives(tally, task, worlds, sim, verdicts)
    return tally


def key_of(task: Task, options: Options, dtype: str) -> tuple[str, ...]:
    """What a row of the table is about."""
    return (task.strategy, *(str(getattr(options.method, name)) for name in FIELDS), dtype)


def _count(tally: Tally, task: Task, chunk: int, worlds: Worlds, options: Options, dtype: str,
           verdicts: Verdicts, known: Array) -> None:  # fmt: skip
    """Put the verdicts into the tally; `known`: worlds whose equation of motion the oracle can write down."""
    kept: Counter[str] = Counter()
    unknown = ("motion", "update", "contact") if options.gap == "end" else ("motion", "update")
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
