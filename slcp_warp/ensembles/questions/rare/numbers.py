"""The numbers of worlds as functions of standard normal ones, as `Draws` has them of random ones."""

import math
from typing import Any

import numpy as np

from slcp_warp.kernels.ensembles.disturbances import DROPOUT_FIELDS, PUSH_FIELDS, TIMING_FIELDS
from slcp_warp.kernels.ensembles.draws import LAWS
from slcp_warp.kernels.structure import STEP_SIZE

from ....simulator import Simulator
from ....tasks.disturbances import Disturbances, laws
from ....tasks.disturbances.laws import Laws
from ....tasks.task import Task
from ...worlds import Worlds
from ...worlds.normals import drawn_rows, normal_share

LARGEST = 2**31 - 1  # number of a world


def noisy(disturbances: Disturbances) -> bool:
    """Whether anything is drawn in single steps."""
    d = disturbances
    sensor = any(d.sensor.values()) if hasattr(d.sensor, "values") else d.sensor > 0.0
    return d.torque > 0.0 or d.dropped > 0.0 or sensor


class Numbers:
    """Starts, parameters and events of a task's worlds, from standard normal z (B, dimension + fresh).

    The first `dimension` numbers are what a task draws once a world: as many as the addresses of its random
    numbers. Behind them come the choice among several starts and, where noise is drawn in single steps or a
    policy's controls follow from more than state and time, the world's number, by which they do; a small
    change of these two is none.

    Attributes:
        dimension: of what is drawn once a world.
        fresh: numbers behind these.
        names: of what each of the first draws.
    """

    def __init__(self, sim: Simulator, task: Task, step_size: float, numbered: bool = False) -> None:
        """Args:
        numbered: whether worlds have numbers whatever the task draws.
        """
        d, scene = task.disturbances, sim.scene
        assert task.duration is not None
        base = sim.params.replace(step_size=step_size).table()[0]
        self.longest, self.sim, self.task = task.duration, sim, task
        self.tables: dict[str, Laws] = {
            "params": laws.parameter_laws(scene, base, d.parameters),
            "x0": d.start_laws(scene, task.start),
            "kicks": d.kick_laws(scene),
            "pushes": d.push_laws(),
            "dropouts": d.dropout_laws(),
            "timing": d.timing_laws(),
        }
        names: dict[tuple[int, int], str] = {}
        for table in self.tables.values():
            for c in table.varied:
                names.setdefault((int(table.stream[c]), int(table.step[c])), table.names[c])
        self.names = tuple(names.values())
        self._place = {address: i for i, address in enumerate(names)}
        self.dimension = len(self.names)
        self._choice, self._noise = len(task.start) > 1, numbered or noisy(d)
        self.fresh = int(self._choice) + int(self._noise)

    def places(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Columns of a table that are drawn, and the numbers that they are drawn from."""
        table = self.tables[name]
        return table.varied, np.array(
            [self._place[int(table.stream[c]), int(table.step[c])] for c in table.varied], int
        )

    def worlds(self, z: np.ndarray) -> Worlds:
        """The worlds of z (B, dimension + fresh)."""
        count, nv = len(z), self.sim.nx // 2
        start = np.zeros(count, int)
        if self._choice:
            starts = len(self.task.start)
            start = np.minimum((normal_share(z[:, self.dimension]) * starts).astype(int), starts - 1)
        rows: dict[str, Any] = {name: self._rows(name, z, start) for name in self.tables}
        rows["params"][:, STEP_SIZE] = np.minimum(rows["params"][:, STEP_SIZE], self.longest)
        for name, width in zip(
            ("kicks", "pushes", "dropouts", "timing"),
            (nv, len(PUSH_FIELDS), len(DROPOUT_FIELDS), len(TIMING_FIELDS)),
        ):
            own = rows[name]
            rows[name] = own.reshape(count, -1, width) if own.size else None
        numbers = (normal_share(z[:, -1]) * LARGEST).astype(np.int32) if self._noise else np.zeros(count, int)
        return Worlds(**rows, numbers=numbers)

    def _rows(self, name: str, z: np.ndarray, start: np.ndarray) -> np.ndarray:
        return drawn_rows(self.tables[name], self.places(name)[1], z, start)

    def slopes(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Slopes (B, C) of a table's columns by the number that each is drawn from, of tables that vary."""
        world, out = self.worlds(z).numpy(), {}
        for name, table in self.tables.items():
            if not len(table.varied):
                continue
            values = np.reshape(getattr(world, name), (len(z), -1))
            rows = np.zeros_like(values)
            for c, place in zip(*self.places(name)):
                law, first = LAWS[table.law[c]], table.first[c]
                if law == "uniform":
                    density = np.exp(-0.5 * z[:, place] ** 2) / math.sqrt(2.0 * math.pi)
                    rows[:, c] = (table.second[c] - first) * density
                else:
                    rows[:, c] = first * (values[:, c] if law == "log-normal" else 1.0)
            out[name] = rows
        return out

    def told(self, z: np.ndarray) -> dict[str, tuple[float, float]]:
        """What z (dimension,) draws, by name: its value, and z itself."""
        world = self.worlds(z[None]).numpy()
        out: dict[str, tuple[float, float]] = {}
        for name, table in self.tables.items():
            if len(table.varied):
                row = np.ravel(getattr(world, name)[0])
                for c, place in zip(*self.places(name)):
                    out[table.names[c]] = float(row[c]), float(z[place])
        return out

    def shared(self) -> tuple[tuple[str, ...], ...]:
        """The names of `told`, those that one number draws together."""
        found: dict[int, list[str]] = {}
        for name, table in self.tables.items():
            for c, place in zip(*self.places(name)):
                found.setdefault(int(place), []).append(table.names[c])
        return tuple(tuple(names) for names in found.values())
