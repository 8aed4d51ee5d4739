"""What is run: a task is one random scene under the generic kernels and many methods, or under specialised
ones, which compile for seconds, and one method. World i of scene s of a seed is always the same.
"""

import dataclasses
from collections import Counter
from typing import Any

import numpy as np

from slcp_warp import Scene
from slcp_warp.options import OptionError, Options

from .draws import CHUNK, Worlds, draw_worlds
from .structures import SMALL, Size, random_scene

DTYPES = ("float64", "float32")
FIELDS = ("residual", "scaling", "friction", "integrator", "noise", "deviation", "gap")
DIFFERENTIATED = 4  # of so many scenes with specialised kernels one is
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


def key_of(task: Task, options: Options, dtype: str) -> tuple[str, ...]:
    """What a row of the table is about."""
    return (task.strategy, *(str(getattr(options.method, name)) for name in FIELDS), dtype)
