"""Problems of many contacts: what should stay at rest, what is thrown, falls or lands.

At rest the truth is the start. Else it is our own motion of hard contact with Coulomb's friction in float64
under a fine step, every step of it solved; `Truth` says how much it changes when its step is halved, and how
far MuJoCo's overdamped contacts under the same step are from it.
"""

import functools
import time
from dataclasses import dataclass, replace

import numpy as np

import slcp_warp as slcp

from ..exact.problems import Problem
from ..peers.mujoco import SETTINGS, model_of
from ..shared.workload import Workload
from .cost import LAWS
from .worlds import world

FINE = 1e-4  # [s]
SEED = 5
THROWN = 0.2  # [s]: long enough for every pair to meet, short enough for most motions not to have parted
PATIENCE = 300.0  # CPU seconds that a truth may take
LONG = 10.0  # [s] at rest


@dataclass(frozen=True)
class Truth:
    """The reference of a problem.

    Attributes:
        states, limit: (B, nx) at T, ours and MuJoCo's.
        solved: (B,) whether every step of a world was.
        change: median over the worlds of the largest change of a position when the step is halved [m].
        mujoco: the same to MuJoCo's end [m].
    """

    states: np.ndarray
    limit: np.ndarray
    solved: np.ndarray
    change: float
    mujoco: float

    @property
    def note(self) -> str:
        """One line."""
        return (f"truth: h = {FINE:g}, {self.change:.1e} m from twice that, MuJoCo at the same h "
                f"{self.mujoco:.1e} m off, {(~self.solved).sum()} starts unsolved and left out")  # fmt: skip


def truth_of(scene: slcp.Scene, starts: np.ndarray, duration: float, components: tuple[int, ...]) -> Truth:
    """The reference of starts (B, nx).

    Raises:
        ValueError: it would take more than PATIENCE, by the first hundredth of a motion.
    """
    sim = slcp.Simulator(scene, slcp.Options(**LAWS["coulomb"]), device="cpu", dtype="float64")
    ends, solved = [], np.ones(len(starts), bool)
    steps = round(duration / FINE)
    count, params = max(1, steps // 100), sim.params.replace(step_size=FINE)
    sim.rollout(starts[:1], np.zeros((1, 1, sim.nu)), params)  # compiles
    begin = time.process_time()
    sim.rollout(starts[:1], np.zeros((1, count, sim.nu)), params)
    needed = 1.5 * steps / count * len(starts) * (time.process_time() - begin)
    if needed > PATIENCE:
        raise ValueError(f"scene {scene.name!r}: a truth would take {needed:.0f} s, more than {PATIENCE:g} s")
    for h in (FINE, 2.0 * FINE):
        us = np.zeros((len(starts), round(duration / h), sim.nu))
        done = sim.rollout(starts, us, sim.params.replace(step_size=h))
        ends.append(done.states[:, -1].copy())
        solved &= done.status == slcp.Status.SOLVED
    work = Workload(starts, np.zeros((len(starts), round(duration / FINE), sim.nu)))
    ends.append(model_of(scene, FINE, SETTINGS["overdamped"]).rollout(work)[:, -1])
    off = [np.abs(end - ends[0])[:, list(components)].max(axis=1) for end in ends[1:]]
    change, mujoco = (float(np.median(part[solved])) if solved.any() else np.nan for part in off)
    return Truth(ends[0], ends[2], solved, change, mujoco)


def places(scene: slcp.Scene) -> tuple[int, ...]:
    """The positions among a scene's q: angles left out, where bodies are free."""
    free = all(body.joint == "free" for body in scene.bodies)
    return tuple(i for i in range(scene.nv) if not free or i % 3 != 2)


def rests(name: str) -> Problem:
    """A pile that should stay as it is."""
    found = world(name)
    start = found.starts("rest", 1, SEED)
    return Problem(f"{name} rests", found.scene, start, LONG, start, places(found.scene), "m")


@functools.cache
def moves(name: str) -> tuple[Problem, Problem]:
    """A motion from 16 starts (8 of large piles): piles are thrown, beams fall askew, robots land.

    The second problem is the same with MuJoCo's limit for a truth.

    Raises:
        ValueError: no start has a truth.
    """
    kind = name.partition(":")[0]
    found = world(name)
    scene, rng = found.scene, np.random.default_rng(SEED)
    count, duration = (16 if found.bodies < 30 else 8), (1.0 if kind in ("walker", "hopper") else THROWN)
    starts = found.starts("tumbling", count, SEED)
    if kind == "beam":
        duration, starts = 0.3, np.tile(starts[:1], (count, 1))
        starts[:, 2], starts[:, 3:] = rng.uniform(-0.2, 0.2, count), 0.0
        starts[:, 1] += 0.5 * np.abs(np.sin(starts[:, 2])) + rng.uniform(0.02, 0.1, count)
    elif kind in ("walker", "hopper"):
        starts[:, scene.nv :] *= 0.1
    components = places(scene)
    truth = truth_of(scene, starts, duration, components)
    if not truth.solved.any():
        raise ValueError(f"{name}: no start has a truth: {truth.note}")
    word = {"beam": "falls", "walker": "lands", "hopper": "lands"}.get(kind, "is thrown")
    unit = "m, rad" if kind in ("walker", "hopper") else "m"
    problem = Problem(f"{name} {word}", scene, starts[truth.solved], duration, truth.states[truth.solved],
                      components, unit, average="median", note=truth.note)  # fmt: skip
    return problem, replace(problem, exact=truth.limit[truth.solved])


def energy_gained(scene: slcp.Scene, states: np.ndarray) -> float:
    """How far the energy of any world of (B, N+1, nx) ever rises above its start, over m g (1 m) of a body.

    NaN where bodies are joined or sprung: then more than motion and height stores energy.
    """
    if not all(b.joint == "free" and b.parent is None and b.com == (0.0, 0.0) for b in scene.bodies):
        return np.nan
    q, v = (part.reshape(*states.shape[:2], -1, 3) for part in np.split(states, 2, axis=2))
    mass, inertia = (np.array([getattr(b, name) for b in scene.bodies]) for name in ("mass", "inertia"))
    kinetic = 0.5 * mass * (v[..., 0] ** 2 + v[..., 1] ** 2) + 0.5 * inertia * v[..., 2] ** 2
    weight = np.array(scene.gravity)
    height = -(q[..., :2] @ weight) * mass
    total = (kinetic + height).sum(axis=2)
    return float((total - total[:, :1]).max() / (np.linalg.norm(weight) * mass.mean()))
