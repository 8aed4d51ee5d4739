"""Study "contact": error against cost on problems with exact solutions, ours and then the peers'.

Each curve is a way to simulate, its knob the step size. Errors are judged on the problem's own starts; timed
are the same starts repeated until a call takes STEPS world steps, from Python with NumPy arrays, copies
included. Every point is timed in turn with the others of its problem.
"""

import functools
import multiprocessing
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

import slcp_warp as slcp
from slcp_warp import Scene
from slcp_warp.kernels.device import launch

from ..exact.problems import MAKERS, STEP_SIZES, Problem, problem
from ..peers.mujoco import MuJoCo
from ..peers.peer import Peer
from ..shared.overlap import overlap
from ..shared.rows import Rows, Say, timed
from ..shared.timing import Case
from . import contact_peers

STEPS = 20_000  # world steps of a timed call, at least
REPEATS = 3


@dataclass(frozen=True)
class Curve:
    """A way to simulate: options, noise level, precision, device and threads. Its step size is the knob.

    `problems` names those it runs.
    """

    name: str
    residual: str = "hard"
    friction: str = "coulomb"
    integrator: str = "euler"
    scaling: str = "inertia"
    gap: str = "start"
    sigma: float | None = None
    dtype: str = "float64"
    device: str = "cpu"
    threads: int = 1
    problems: tuple[str, ...] = tuple(MAKERS)

    def simulator(self, scene: Scene) -> slcp.Simulator:
        """The scene's simulator."""
        options = slcp.Options(residual=self.residual, friction=self.friction, integrator=self.integrator,
                               scaling=self.scaling, gap=self.gap)  # fmt: skip
        return slcp.Simulator(scene, options, device=self.device, dtype=self.dtype)

    def facts(self) -> dict[str, Any]:
        """Columns of its rows."""
        return {
            "program": "slcp-warp", "version": slcp.__version__, "curve": self.name,
            "residual": self.residual, "friction": self.friction, "integrator": self.integrator,
            "scaling": self.scaling, "gap": self.gap, "sigma": "" if self.sigma is None else self.sigma,
            "dtype": self.dtype, "device": self.device, "threads": self.threads,
        }  # fmt: skip


TOUCHING = tuple(name for name in MAKERS if name not in ("pendulum chain", "finger swing"))
CURVES = (
    Curve("Coulomb"),
    Curve("Coulomb, float32", dtype="float32"),
    Curve("Coulomb, trapezoidal", integrator="trapezoidal"),
    Curve("Coulomb, end gap", gap="end", problems=("finger impact",)),  # the only one with two curved shapes
    Curve("Anitescu", friction="anitescu", problems=TOUCHING),
    Curve("smoothed, sigma = .02", "rem-logistic", "anitescu", sigma=0.02, problems=TOUCHING),
)


# -------------------------------------------------------------------- compiling


def set_up(cache: str | None) -> None:
    """Make a process compile quietly into this cache."""
    wp.config.kernel_cache_dir = cache
    wp.config.log_level = wp.LOG_ERROR


def compile_once(scene: Scene, curve: Curve) -> float:
    """Seconds until a first step has run, kernels compiled or taken from the cache on disk."""
    begin = time.perf_counter()
    sim = curve.simulator(scene)
    sim.rollout(scene.x0, np.zeros((1, sim.nu)))
    return time.perf_counter() - begin


def compile_all(chosen: list[tuple[Scene, Curve]], processes: int) -> dict[tuple[str, Curve], float]:
    """Compile what scenes and curves need, each once, side by side; seconds by scene's name and curve."""
    needed = {(scene.structure, curve): (scene, curve) for scene, curve in chosen}
    calls = list(needed.values())
    if processes > 1:
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(processes, context, set_up, (wp.config.kernel_cache_dir,)) as pool:
            seconds = list(pool.map(compile_once, *zip(*calls)))
    else:
        seconds = [compile_once(*call) for call in calls]
    took = dict(zip(needed, seconds))
    return {(scene.name, curve): took[scene.structure, curve] for scene, curve in chosen}


# -------------------------------------------------------------------- points


def point(p: Problem, curve: Curve, h: float, least: int = STEPS, study: str = "contact") -> Case:
    """A curve on a problem at a step size: its errors and overlaps as facts, and the call to be timed.

    That takes at least `least` world steps.
    """
    sim = curve.simulator(p.scene)
    params = sim.params.replace(step_size=h)
    if curve.sigma is not None:
        params = params.replace(sigma=curve.sigma)
    count = round(p.duration / h)
    kind = np.dtype(curve.dtype)

    def run(starts: np.ndarray) -> Any:
        return sim.rollout(starts.astype(kind), np.zeros((len(starts), count, sim.nu), kind), params)

    done = run(p.starts)
    states = done.states.astype(float)
    error, found = p.errors(states[:, -1]), overlap(p.scene, states, h)
    copies = max(1, -(-least // (count * len(p.starts))))
    starts = np.tile(p.starts, (copies, 1)).astype(kind)
    controls = np.zeros((len(starts), count, sim.nu), kind)
    facts = {"study": study, "problem": p.name} | curve.facts() | {
        "knob": "h", "value": h, "h": h, "batch": len(starts), **p.typical(error),
        "penetration": found.penetration, "missed": found.missed,
        "solved_share": (done.status == slcp.Status.SOLVED).mean(), "cost_of": "simulated second",
    }  # fmt: skip
    call = functools.partial(sim.rollout, starts, controls, params)
    return Case(f"{curve.name} {h}", call, len(starts) * p.duration, facts=facts)


def problem_rows(p: Problem, curves: list[Curve], step_sizes: tuple[float, ...], repeats: int) -> Rows:
    """Our rows of a problem, all points timed in turn."""
    cases = [point(p, curve, h) for curve in curves for h in step_sizes]
    out: Rows = []
    for threads in sorted({curve.threads for curve in curves}):
        out += timed([case for case in cases if case.facts["threads"] == threads], repeats, threads)
    return out


def all_rows(
    say: Say,
    beside: Iterable[Peer] = (),
    names: Iterable[str] = tuple(MAKERS),
    curves: Iterable[Curve] = CURVES,
    step_sizes: tuple[float, ...] = STEP_SIZES,
    repeats: int = REPEATS,
    processes: int | None = None,
) -> Rows:
    """Rows of the named problems: ours, and at once after them those of the peers `beside`.

    Kernels are compiled before, by as many processes as there are cores.
    """
    chosen = {name: [curve for curve in curves if name in curve.problems] for name in names}
    begin = time.perf_counter()
    needed = [(problem(name).scene, curve) for name, those in chosen.items() for curve in those]
    compiling = compile_all(needed, processes or launch.thread_count())
    say(f"slcp-warp: compiled in {time.perf_counter() - begin:.0f} s")
    out: Rows = []
    for name, those in chosen.items():
        begin, p = time.perf_counter(), problem(name)
        took = {curve.name: compiling[p.scene.name, curve] for curve in those}
        found = problem_rows(p, those, step_sizes, repeats)
        out += [row | {"compile_seconds": took[row["curve"]]} for row in found]
        for peer in beside:
            out += contact_peers.problem_rows(peer, p, step_sizes)
        programs = " and ".join(["slcp-warp", *(peer.name for peer in beside)])
        say(f"{programs} on {name}: {time.perf_counter() - begin:.0f} s")
    return out


def pieces(say: Say) -> list[tuple[str, Callable[[], Rows]]]:
    """The study in pieces: every problem, ours beside MuJoCo; then the other installed peers, each alone."""
    peers = contact_peers.everyone(say)
    beside = [peer for peer in peers if isinstance(peer, MuJoCo)]
    out: list[tuple[str, Callable[[], Rows]]] = [
        (name, functools.partial(all_rows, say, beside, (name,))) for name in MAKERS
    ]
    return out + [(peer.name, functools.partial(_of_peer, say, peer)) for peer in peers if peer not in beside]


def _of_peer(say: Say, peer: Peer) -> Rows:
    try:
        return contact_peers.rows(say, [peer])
    except Exception as error:
        say(f"left out: {peer.name} failed, {type(error).__name__}: {error}")
        return []


def rows(say: Say) -> Rows:
    """All of the study."""
    return [row for _, measure in pieces(say) for row in measure()]
