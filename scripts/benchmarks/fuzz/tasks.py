"""What is run: a task is one random scene under the generic kernels and many methods, or under specialised
ones, which compile for seconds, and one method. World i of scene s of a seed is always the same. A task is of
a part (`parts.py`), which says what scenes and states there are, and for how many steps they are followed.
"""

import dataclasses
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from slcp_warp import Scene
from slcp_warp.description.kinematics import Array
from slcp_warp.options import OptionError, Options

from .draws import CHUNK, Worlds, decades, single
from .parts import PARTS, Part
from .structures import SMALL, Size

DTYPES = ("float64", "float32")
FIELDS = (
    "residual", "scaling", "friction", "integrator", "noise", "deviation", "gap", "depenetration_speed"
)  # fmt: skip
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
    """A scene's worlds under some kernels: `scene` is its number; `chunks` of `per_chunk` worlds each;
    `explains`: whether it is looked into why worlds are NOT_CONVERGED; `device`: of Warp, by its name.
    """

    seed: int
    scene: int
    strategy: str
    chunks: int = 1
    residuals: tuple[str, ...] = ()
    per_chunk: int = CHUNK
    part: str = "steps"
    explains: bool = False
    device: str = "cpu"

    @property
    def own(self) -> bool:
        """Whether it has kernels of its own."""
        return self.strategy != "generic"

    @property
    def kernels(self) -> str:
        """What its rows of the table are called."""
        return self.strategy if self.part == "steps" else f"{self.strategy}, {self.part}"

    @property
    def differentiates(self) -> bool:
        """Whether derivatives are compared, too: with kernels of its own they compile as long again."""
        if self._part().differentiated:
            return True
        own = self.strategy == "specialised" and self.part in ("steps", "rotors", "tendons")
        return own and self.scene % DIFFERENTIATED == 0

    @property
    def steps(self) -> int:
        """For how many steps every world is followed."""
        low, high = PARTS[self.part].steps
        return int(self._rng(0, 1).integers(low, high + 1))

    def _rng(self, *more: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, self.scene, self.own, *PARTS[self.part].seeds, *more])

    def _part(self) -> Part:
        return PARTS[self.part]

    def make_scene(self) -> Scene:
        """The random scene."""
        name = f"fuzz-{self.seed}-{self.kernels.replace(', ', '-')}-{self.scene}"
        return self._part().scene(self._rng(), name, SMALL if self.own else Size())

    def worlds(self, chunk: int, scene: Scene) -> Worlds:
        """One chunk of its worlds."""
        return self._part().worlds(self._rng(1 + chunk), scene, self.per_chunk)

    def controls(self, chunk: int, scene: Scene) -> Array:
        """Controls (worlds, steps, nu) of one chunk that is followed, exact in float32."""
        shape = (self.per_chunk, self.steps, scene.nu)
        rng = self._rng(1 + chunk, 2)
        return single(rng.standard_normal(shape) * decades(rng, -1, 2, self.per_chunk, 1, 1))

    def methods(self) -> list[tuple[Options, str]]:
        """Options and precisions that it runs."""
        if (self.part == "sweeps" or self._part().differentiated) and self.strategy == "generic":
            chosen = [(GENERIC[self.scene % len(GENERIC)], "float64")]
        elif self.part == "sweeps":
            chosen = [(random_options(self._rng(0, 2), self._part().wanted), "float64")]
        elif self.strategy == "generic":
            chosen = [(o, d) for o in GENERIC for d in DTYPES]
        else:
            rng = np.random.default_rng([self.seed, self.scene, 2])
            chosen = [(random_options(rng, self._part().wanted), DTYPES[int(rng.random() < 0.4)])]
        speeds = self._part().depenetration
        if speeds:
            speed = speeds[self.scene % len(speeds)]
            chosen = [(dataclasses.replace(o, depenetration_speed=speed), d) for o, d in chosen]
        if self._part().integrator:
            chosen = [(dataclasses.replace(o, integrator=self._part().integrator), d) for o, d in chosen]
        return [(o, d) for o, d in chosen if not self.residuals or o.residual in self.residuals]


@dataclasses.dataclass(frozen=True)
class Failure:
    """A world that is wrong, by where it comes from, and what is wrong with it; `step`: of those that it is
    followed for, the one that is.
    """

    task: Task
    world: int
    options: Options
    dtype: str
    kind: str
    verdict: str
    reason: str
    error: float
    step: int | None = None


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


def random_options(rng: np.random.Generator, wanted: Callable[[Options], bool]) -> Options:
    """A method that the library offers, and a part wants."""
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
            options = Options(**values)
        except OptionError:
            continue
        if wanted(options):
            return options


def key_of(task: Task, options: Options, dtype: str) -> tuple[str, ...]:
    """What a row of the table is about."""
    return (task.kernels, *(str(getattr(options.method, name)) for name in FIELDS), dtype)
