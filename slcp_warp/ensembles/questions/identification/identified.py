"""What recorded runs tell of a mechanism's numbers."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ....inputs.checks import device, instance, memory, whole
from ....inputs.errors import ArgumentError
from ....parameters import Parameters
from ....policies import KalmanFilter
from ....storage.printed import Printed, Table, counted
from ....tasks.task import Task
from ...worlds import Worlds, draw_worlds
from ...worlds.seeds import seed_apart
from .fit import Fit, judged
from .laws_after import Law
from .logs import logs_of
from .unknowns import Unknowns

DRAWN = 0x6B6E6F77  # with the seed: of worlds
TWO_SIDED = 1.959963984540054  # 95 %
LEARNED, TOGETHER, EVEN, FAR, MANY, MOVED = 0.9, 0.95, 0.2, 3.0, 3.0, 0.75


@dataclass(frozen=True, repr=False, eq=False)
class Identified(Printed):
    """Outcome of `identify`: what is known of numbers, as a normal distribution of z, which draws them.

    Attributes:
        values: by name (value, low, high) with a 95 % interval.
        learned: by name the standard deviation that is left, of the one before: 1 is nothing learned.
        names: (K,) of what is drawn independently before the logs.
        z, covariance: (K,), (K, K) mean and covariance of z, which was N(0, 1) before.
        params: of the filter's model, with the numbers that were found.
        filter: with all of them: parameters, biases and noise.
        x0: (R, nx) the most likely first states of the logs, with these.
        before, fit: how well the logs are explained at z = 0, and by what was found.
        minima: a row a start, the best first: its cost (M70), the z_i that it ended at, and why.
        counted: share of draws by this mean and covariance that count (M73); .2 and less is rough.
        seed: of the starts and draws.
        others: what explains the logs nearly as well, in words.
        halved: by name by how many of its deviations a number moves in steps half as long, about; NaN: not
            known. Of Euler's steps about as much is left beyond.
        odd: what is odd about the logs, or about what was asked, in words.
    """

    values: dict[str, tuple[float, float, float]]
    learned: dict[str, float]
    names: tuple[str, ...]
    z: np.ndarray
    covariance: np.ndarray
    params: Parameters
    filter: KalmanFilter
    x0: np.ndarray
    before: Fit
    fit: Fit
    minima: dict[str, np.ndarray]
    counted: float
    seed: int
    others: tuple[str, ...]
    halved: dict[str, float]
    odd: tuple[str, ...]
    _unknowns: Unknowns = field(repr=False)

    @property
    def correlation(self) -> np.ndarray:
        """(K, K) of z: what the logs tell together only is near 1 or -1."""
        sd = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(sd, sd))

    @property
    def parameters(self) -> dict[str, Law]:
        """The mechanism's numbers for `Disturbances.parameters`, each by itself, drawn around what was found.

        What is known of them together is not in it: `worlds` draws that, too.
        """
        return self._unknowns.laws_after(self.z, np.sqrt(np.diag(self.covariance)))

    def judge(self, measured: Any, controls: Any, x0: Any = None) -> Fit:
        """How well other logs are explained by what was found; arguments as of `identify`."""
        logs = logs_of(self._unknowns.filter, measured, controls, x0)
        return judged(self._unknowns, logs, self.z)

    def draw(self, count: int, seed: int = 0) -> Parameters:
        """Parameters of so many mechanisms that the logs leave possible, drawn together."""
        return self._unknowns.parameters(self._drawn(count, seed))

    def worlds(self, task: Task, count: int, seed: int = 0) -> Worlds:
        """Worlds of a task, its other disturbances among them, with mechanisms that the logs leave possible.

        Raises:
            ArgumentError: a task of another mechanism.
        """
        task = instance("task", task, Task, "a slcp_warp.Task")
        if task.scene.structure != self.params.scene.structure:
            raise ArgumentError(
                f"task is of scene {task.scene.name!r}, and {self.params.scene.name!r} was identified; the "
                "same mechanism is needed"
            )
        own = draw_worlds(task, whole("count", count), seed, dtype="float64", device="cpu")
        columns = self._unknowns.columns
        table = np.array(own.params)
        table[:, columns] = self._unknowns.table(self._drawn(count, seed))[:, columns]
        return replace(own, params=table)

    def _drawn(self, count: int, seed: int) -> np.ndarray:
        rng = np.random.default_rng(seed_apart(whole("seed", seed, 0), DRAWN))
        width = self.params.layout.width
        memory("count: parameters of the worlds", whole("count", count), 24 * width, device("cpu"))
        normal = rng.normal(size=(int(count), len(self.z)))
        return np.asarray(self.z + normal @ np.linalg.cholesky(self.covariance).T)

    def _line(self) -> str:
        found = ", ".join(
            f"{name} = {value:.4g} ({low:.4g} to {high:.4g})"
            for name, (value, low, high) in self.values.items()
        )
        return f"{found}; from {self.fit.seen:,} measured numbers"

    def _remarks(self) -> list[str]:
        out = []
        if not str(self.minima["ended"][0]) == "resolution":
            why = {"rounds": "more rounds= are needed", "rough": "no step along its derivatives improves it"}
            out.append(f"no minimum to a thirtieth of a deviation: {why[str(self.minima['ended'][0])]}")
        left = [name for name, share in self.learned.items() if share > LEARNED]
        ends = [name for name in left if abs(self.z[self._unknowns.told[name]]) > 1.0]
        if ends:
            out.append(f"at the end of what was possible before, or beyond it: {', '.join(ends)}")
        nothing = [name for name in left if name not in ends]
        if nothing:
            out.append(f"the logs say next to nothing of: {', '.join(nothing)}")
        linked = self.correlation
        out += [
            f"told together only: {self.names[i]} and {self.names[j]} (correlation {linked[i, j]:.3g})"
            for i in range(len(linked))
            for j in range(i)
            if abs(linked[i, j]) > TOGETHER
        ]
        out += [
            f"{name} is {abs(z):.2g} deviations from what was expected before"
            for name, z in zip(self.names, self.z)
            if abs(z) > FAR
        ]
        noise = {"process", *(f"noise of {name}" for name in self.filter.sensors)}
        coarse = [
            f"{name} by {abs(each):.2g}"
            for name, each in self.halved.items()
            if abs(each) > MOVED and name not in noise
        ]
        if coarse:
            out.append(
                "steps are too long for these intervals: half as long ones move, in deviations, "
                f"{', '.join(coarse)} (shorter ones, or without contact Options(integrator='trapezoidal'))"
            )
        process = self.values.get("process", (1.0,))[0]
        if process > MANY:
            out.append(
                f"the process strays {process:.3g} times as much as was said: what the mechanism has not "
                "got, steps that are too long (halve them, or Options(integrator='trapezoidal')), or a "
                "minimum that takes all for noise (look at minima, or give it less process)"
            )
        rubs = [name for name in self.values if name.split(".")[-1] == "friction"]
        if rubs and self.filter.model.options.friction != "coulomb":
            out.append(
                "what slides under Anitescu's friction rides h mu v above the ground, and tells another mu "
                f"than Coulomb's law: {', '.join(rubs)} (Options('hard', friction='coulomb'))"
            )
        if not self.counted >= EVEN:
            out.append(
                f"what is known is not normal: of draws {100.0 * self.counted:.0f} % count, so intervals "
                "and drawn worlds are rough"
            )
        if self.fit.failures:
            steps = counted(self.fit.failures, "step")
            out.append(f"{steps} of the logs had no solution in the model, or no derivatives")
        return [*out, *self.others, *self.odd, *self.fit.told()]

    def _tables(self) -> list[Table]:
        rows = [(name, *value, self.learned[name]) for name, value in self.values.items()]
        fits = [
            (name, each.cost, each.rms, 100.0 * each.beyond, max(map(abs, each.echo.values())))
            for name, each in (("before", self.before), ("found", self.fit))
        ]
        head = ("", "value", "low", "high", "deviation left")
        fit = ("sensors off by", "cost", "rms, of deviations", "beyond three [%]", "largest echo")
        return [Table("", head, rows, most=len(rows)), Table("", fit, fits)]
