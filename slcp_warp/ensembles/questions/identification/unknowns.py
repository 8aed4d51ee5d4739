"""What is looked for: numbers, from standard normal ones by what is known before."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from slcp_warp.kernels.structure import STEP_SIZE, layout

from ....description.scene import Scene
from ....inputs.checks import number
from ....inputs.errors import ArgumentError
from ....parameters import Parameters
from ....policies import KalmanFilter
from ....policies.estimated.sensing import by_sensor
from ....tasks.disturbances import Disturbances, LogNormal, Normal, laws
from ....tasks.disturbances.distributions import MOST_SPREAD
from ....tasks.disturbances.laws import Laws
from ...worlds.columns import told_once
from ...worlds.corners import columns_of_corners, with_corners_within
from ...worlds.normals import drawn_rows
from .laws_after import Law, laws_after


class Unknowns:
    """Parameters, biases and noise of a filter from z (C, K), what is known before being z ~ N(0, 1).

    Attributes:
        names: of the K numbers: what each draws, or the first of it.
        told: by name what is drawn, and the number of z that it is drawn from.
        given: what it was made from, beside the filter.
        tied, with_inertia: whether mass and inertia are one number, and the bodies of which both are drawn.
    """

    def __init__(
        self,
        filter: KalmanFilter,
        parameters: Mapping[str, Any] | None,
        bias: Mapping[str, float] | None,
        sensor_noise: float,
        process_noise: float,
        tied: bool = True,
    ) -> None:
        """Args: as of `identify`.

        Raises:
            ArgumentError: names that there are not, nothing to look for.
        """
        self.given: dict[str, Any] = {"parameters": parameters, "bias": bias, "sensor_noise": sensor_noise}
        self.given |= {"process_noise": process_noise, "tied": tied}
        scene, self.filter, self.tied = filter.model.scene, filter, tied
        self.prior = Disturbances(parameters={} if parameters is None else parameters).parameters
        self._mechanism = laws.parameter_laws(scene, filter.params.table()[0], self.prior)
        self.with_inertia = _tie(scene, self._mechanism, self.prior, tied)
        if STEP_SIZE in self._mechanism.varied:
            raise ArgumentError("parameters names step_size; a log has the step of the filter's model")
        self._around = self._laws_around(bias, sensor_noise, process_noise)
        both = self._mechanism, self._around
        addresses: dict[tuple[int, int, int], int] = {}
        self._places = []
        for i, table in enumerate(both):
            own = [(i, int(table.stream[c]), int(table.step[c])) for c in table.varied]
            self._places.append(np.array([addresses.setdefault(each, len(addresses)) for each in own], int))
        if not addresses:
            raise ArgumentError(
                "parameters, bias, sensor_noise and process_noise leave nothing open; what is looked for is "
                "needed, such as parameters={'block.mass': 0.5}"
            )
        self.told: dict[str, int] = {}
        self._column: dict[str, tuple[int, int]] = {}
        base = filter.params.table()[0]
        alone = {key: laws.parameter_laws(scene, base, {key: law}).varied for key, law in self.prior.items()}
        asked = {int(columns[0]): key for key, columns in alone.items() if len(columns) == 1 and "." in key}
        for i, (table, places) in enumerate(zip(both, self._places)):
            place_of = dict(zip(table.varied.tolist(), places.tolist()))
            for column, c in told_once(table.names, table.varied.tolist(), table.alike):
                name = column if i else asked.get(c, column)
                self.told[name], self._column[name] = place_of[c], (i, c)
        first: dict[int, str] = {}
        for name, place in self.told.items():
            first.setdefault(place, name)
        self.names = tuple(first[place] for place in range(len(first)))

    def __len__(self) -> int:
        return len(self.names)

    @property
    def noisy(self) -> bool:
        """Whether noise is looked for."""
        return bool((self._around.varied >= len(self.filter.sensors)).any())

    def _laws_around(self, bias: Any, sensor_noise: Any, process_noise: Any) -> Laws:
        """Columns: bias and noise of each sensor, and a factor on what the process strays by."""
        filter, count = self.filter, len(self.filter.sensors)
        spread = by_sensor("bias", bias, filter.sensors)
        if (spread < 0.0).any():
            raise ArgumentError(f"bias holds {spread.min():g}; standard deviations are needed")
        noise = [number(name, given, 0.0) for name, given in
                 (("sensor_noise", sensor_noise), ("process_noise", process_noise))]  # fmt: skip
        for name, sd in zip(("sensor_noise", "process_noise"), noise):
            if sd >= MOST_SPREAD:
                raise ArgumentError(f"{name} is {sd:g}; a number in [0, {MOST_SPREAD:g}) is needed")
        if noise[1] and not filter.process.any():
            raise ArgumentError(f"process_noise is {noise[1]:g}, and the filter's process is 0: give it some")
        names = [f"bias of {name}" for name in filter.sensors]
        names += [*(f"noise of {name}" for name in filter.sensors), "process"]
        base = [*filter.bias, *np.sqrt(filter.variance), 1.0]
        out = laws.still(base, range(2 * count + 1), [0] * (2 * count + 1), names)
        for c, sd in enumerate(spread):
            out.put(c, Normal(float(sd)))
        for c in range(count, 2 * count + 1):
            out.put(c, LogNormal(noise[c == 2 * count]))
        return out

    def _rows(self, which: int, z: np.ndarray) -> np.ndarray:
        table = (self._mechanism, self._around)[which]
        return drawn_rows(table, self._places[which], z, np.zeros(len(z), int))

    def table(self, z: np.ndarray) -> np.ndarray:
        """Rows (C, P) of the table of parameters."""
        return with_corners_within(self.filter.model.scene.structure, self._rows(0, z))

    def parameters(self, z: np.ndarray, times: int = 1) -> Parameters:
        """The same as parameters of worlds, each row so many times."""
        return self.filter.params.from_table(np.repeat(self.table(z), times, axis=0))

    def parameters_at(self, z: np.ndarray) -> Parameters:
        """Of one z (K,), for all worlds."""
        given, row = self.filter.params, self.table(z[None])[0]
        ends = {name: (start, start + int(np.prod(shape, dtype=int))) for name, start, shape in
                given.layout.columns}  # fmt: skip
        varied = self.columns
        own = [name for name, (start, end) in ends.items() if ((varied >= start) & (varied < end)).any()]
        return given.replace(**{
            name: row[slice(*ends[name])].reshape(given.layout.shape(name)) for name in own
        })  # fmt: skip

    def filter_at(self, z: np.ndarray) -> KalmanFilter:
        """The filter with numbers, biases and noise of z (K,)."""
        of, (bias, variance, process) = self.filter, self.around(z[None])
        return KalmanFilter(
            of.model,
            of.sensing.with_noise(np.sqrt(variance[0])),
            dict(zip(of.model.scene.state_names, (process[0] * np.sqrt(of.process)).tolist())),
            dict(zip(of.model.scene.state_names, np.sqrt(np.diag(of.first)).tolist())),
            of.x0,
            self.parameters_at(z),
            dict(zip(of.sensors, bias[0].tolist())),
        )

    def around(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Bias (C, sensors), variance of sensors (C, sensors), and the process's factor (C,)."""
        count, rows = len(self.filter.sensors), self._rows(1, z)
        return rows[:, :count], np.square(rows[:, count : 2 * count]), rows[:, -1]

    @property
    def columns(self) -> np.ndarray:
        """Of the table of parameters, those that are looked for, and corners that these keep within."""
        corners = columns_of_corners(self.filter.model.scene.structure)
        kept = corners[np.isin(corners, self._mechanism.varied).any(axis=1), 0]
        return np.union1d(self._mechanism.varied, kept)

    def laws_after(self, mean: np.ndarray, sd: np.ndarray) -> dict[str, Law]:
        """What is known of the mechanism where z has these means and deviations (K,), see `laws_after`."""
        places = self._places[0]
        return laws_after(self.filter.model.scene, self.prior, self._mechanism, mean[places], sd[places])

    def values(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """What is drawn, by name, (C,) each."""
        rows = [self._rows(0, z), self._rows(1, z)]
        return {name: rows[i][:, c] for name, (i, c) in self._column.items()}


def _tie(scene: Scene, mechanism: Laws, prior: Mapping[str, Any], tied: bool) -> tuple[str, ...]:
    """The bodies whose mass and inertia are both drawn, from one number each, or, not tied, of their own; but
    for those of which one name of `prior` says that they are one.
    """
    one = {name for key in prior if len(laws.names_in(key)) > 1 for name in laws.names_in(key)}
    first = {name: start for name, start, _ in layout(scene.structure).columns}
    varied = set(mechanism.varied.tolist())
    both = [
        i
        for i, body in enumerate(scene.bodies)
        if {first["mass"] + i, first["inertia"] + i} <= varied
        and not one & {"inertia", f"{body.name}.inertia"}
    ]
    of = first["inertia"] + np.array(both, int)
    if not tied:
        mechanism.step[of] += first["inertia"] - first["mass"]
    return tuple(scene.bodies[i].name for i in both)
