"""The worlds that are watched: state, numbers and contacts, one step at a time."""

from dataclasses import dataclass
from typing import Any

import numpy as np

import slcp_warp as slcp
from slcp_warp.inputs.limits import limit_rows
from slcp_warp.results.pictures.mechanism import Mechanism

from ..support.rules import NO_RULES, Rules
from .knobs import parameters
from .pull import Pull, wrench

VARIANTS = ("smoothed", "hard")


@dataclass(frozen=True)
class Subject:
    """What is watched.

    Attributes:
        name: of the task or the scene.
        scene, options: as of a simulator; options of the smoothed problem, or of the hard one alone.
        rules: options of the steps, of each problem those that it has.
        own: parameters that knobs change; None: the scene's.
        start: (B, nx), one a world.
        limits: of the controls, (lower, upper) or None.
        task: where it is one.
    """

    name: str
    scene: slcp.Scene
    options: slcp.Options
    start: np.ndarray
    limits: Any = None
    task: slcp.Task | None = None
    rules: Rules = NO_RULES
    own: slcp.Parameters | None = None

    @classmethod
    def of(cls, task: slcp.Task, worlds: int = 1, seed: int = 0, rules: Rules = NO_RULES) -> "Subject":
        """A task's scene at its starts; further worlds differ by its disturbances of the start."""
        start = task.start[np.arange(worlds) % len(task.start)].copy()
        noise = np.random.default_rng(seed).standard_normal(start.shape) * task.disturbances.deviation(
            task.scene
        )
        start[1:] += noise[1:]
        return cls(task.name, task.scene, task.options, start, task.control_limits, task, rules)


@dataclass
class Shove:
    """A force and a torque on a body for a while, in all worlds.

    Attributes:
        body: which.
        point: where, in its frame [m].
        force: (2,) in the directions of the world [N].
        torque: [N m].
        left: how long it still lasts [s].
    """

    body: int
    point: np.ndarray
    force: np.ndarray
    torque: float
    left: float


class Worlds:
    """Worlds of one subject; what a step leaves is kept in `states`, `impulse` and `status`.

    Attributes:
        sims: simulators by variant.
        variant: which one steps.
        state: (B, nx).
        warm: multipliers of the last step, or None.
        status: (B,) of the last step; a world that is not solved stays where it was.
        impulse: (B, pairs, 2) of the last step [N s].
    """

    def __init__(self, subject: Subject, device: str | None = None) -> None:
        self.subject = subject
        variants = VARIANTS[1:] if subject.options.hard else VARIANTS
        chosen = dict(zip(variants, subject.rules.variants(subject.options)))
        self.sims = {name: slcp.Simulator(subject.scene, o, device=device) for name, o in chosen.items()}
        self.variant = next(iter(chosen))
        self.values: dict[str, float] = {}
        self.warm: np.ndarray | None = None
        self.turn({})
        self.reset()

    @property
    def sim(self) -> slcp.Simulator:
        """The simulator that steps."""
        return self.sims[self.variant]

    @property
    def step_size(self) -> float:
        """[s]."""
        return float(self.params["step_size"])

    def turn(self, values: dict[str, float]) -> None:
        """Take what the knobs say."""
        self.values |= values
        scene = self.sim.scene
        own = slcp.Parameters(scene) if self.subject.own is None else self.subject.own
        self.params = parameters(own, self.values)
        self.mechanism = Mechanism(scene, {name: np.asarray(self.params[name]) for name in self.params.names})

    def choose(self, variant: str) -> None:
        """Step by another variant."""
        self.variant, self.warm = variant, None
        self.turn({})

    def reset(self) -> None:
        """Back to the start."""
        self.state = self.subject.start.copy()
        self.before = self.state.copy()
        self.warm = None
        self.shoves: list[Shove] = []
        self.status = np.zeros(len(self.state), int)
        self.impulse = np.zeros((len(self.state), len(self.subject.scene.structure.pairs), 2))
        self.force = np.zeros((len(self.state), self.subject.scene.structure.nb, 3))

    def limited(self, u: np.ndarray) -> np.ndarray:
        """Controls within the task's limits."""
        if self.subject.limits is None:
            return u
        lower, upper = limit_rows(self.subject.limits, self.sim.nu)
        return np.clip(u, lower[0], upper[0])

    def step(self, u: np.ndarray, pull: Pull | None = None) -> None:
        """One step of all worlds, (M1) to (M3), with the force of a spring that is held."""
        self.force[:] = self._shoved()
        if pull is not None:
            self.force[pull.world] += self._pulled(u, pull)
        self.advance(u, self.force, self.warm)

    def advance(self, u: np.ndarray, force: np.ndarray, warm: np.ndarray | None) -> None:
        """One step under given forces (B, bodies, 3), from given multipliers."""
        found = self.sim.step(self.state, u, self.params, external_force=force, warm_start=warm)
        solved = found.status == slcp.Status.SOLVED
        self.before, self.status = self.state, np.asarray(found.status)
        self.state = np.where(solved[:, None], found.state, self.state)
        self.impulse = np.where(solved[:, None, None], found.contact_impulse, 0.0)
        self.warm = found.multiplier if solved.all() else None

    def _shoved(self) -> np.ndarray:
        """(B, bodies, 3) of the shoves; of a step that one covers in part it has that share."""
        out, nv, h = np.zeros_like(self.force), self.subject.scene.nv, self.step_size
        for shove in self.shoves:
            share = min(1.0, shove.left / h)
            for i, q in enumerate(self.state[:, :nv]):
                out[i] += share * wrench(self.mechanism, q, shove.body, shove.point, shove.force)
            out[:, shove.body, 2] += share * shove.torque
            shove.left -= h
        self.shoves = [shove for shove in self.shoves if shove.left > 1e-12]
        return out

    def _pulled(self, u: np.ndarray, pull: Pull) -> np.ndarray:
        """The spring's wrench (bodies, 3) in its world."""
        nv, i = self.subject.scene.nv, pull.world
        three = np.repeat([i], 3)
        warm = None if self.warm is None else self.warm[three]

        def move(wrenches: np.ndarray) -> np.ndarray:
            acting = self.force[three] + wrenches
            found = self.sim.step(
                self.state[three], u[three], self.params, external_force=acting, warm_start=warm
            )
            return np.asarray(found.state[:, :nv])

        return pull.advance(self.mechanism, self.state[i, :nv], self.step_size, move)
