"""Sensors: what they show of a state, or of the forces of a step, and its slopes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from slcp_warp.kernels.ensembles.measures import NONE

from ...description.names import index_of
from ...description.scene import Scene
from ...inputs.checks import number, numeric, shown
from ...inputs.errors import ArgumentError, ArgumentTypeError
from ...inputs.user_code import of_user
from ...measures.recorded import Recorded
from ...measures.signals import Signal
from ...parameters import Parameters

LEAST, MOST = 1e-50, 1e50  # of standard deviations: their squares are numbers
REACH = 1e-6  # of central differences, of a state that is not large
OF_STATES = ("state", "cosine", "point", "distance", "sum")
OF_STEPS = ("impulse", "normal_force", "tangential_impulse", "tangential_force", "tendon_force")
OF_PLACES = ("anchor", "angle", "axis")  # numbers of a mechanism by which its points are where they are
OF_MASS = (*OF_PLACES, "mass", "com")  # and centres of mass


@dataclass(frozen=True)
class Sensor:
    """A sensor of something else than one state, or one that is not always read.

    Attributes:
        of: a state by its name; a signal of `slcp_warp.measures` of states (`state`, `cosine`, `point`,
            `distance`, their sums and products), or of the forces of a step (`normal_force`,
            `tangential_force`, the impulses, `tendon_force`), which is read when the step has been made; or a
            function of states (n, nx) that gives (n,).
        noise: standard deviation of what it shows, 1e-50 to 1e50 [its unit].
        period: differences count modulo this, 2 pi of an angle that is shown within a turn; 0: as they are.
        every: from one reading to the next in a run [s]; 0: whenever a policy is asked.
        late: from a reading to when it is there [s], in a run; by then it is of what was. A log has it where
            it was taken.
        lost: share of the readings of a run that never come, at random.
    """

    of: str | Signal | Callable[[np.ndarray], Any]
    noise: float
    period: float = 0.0
    every: float = 0.0
    late: float = 0.0
    lost: float = 0.0

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "noise", number("Sensor.noise", self.noise, LEAST, MOST))
        for name in ("period", "every", "late"):
            put(self, name, number(f"Sensor.{name}", getattr(self, name), 0.0))
        put(self, "lost", number("Sensor.lost", self.lost, 0.0, 1.0))
        if isinstance(self.of, Signal):
            kinds = {each.kind for each in self.of.parts()}
            other = sorted(kinds - {*OF_STATES, *OF_STEPS})
            if other or any(each.since_start for each in self.of.parts()):
                what, can = other[0] if other else "since_start", ", ".join(OF_STATES + OF_STEPS)
                raise ArgumentError(
                    f"Sensor.of is {self.of!r}, with {what}; a sensor is of {can}, or of a function of states"
                )
        elif not isinstance(self.of, str) and not callable(self.of):
            raise ArgumentTypeError(
                f"Sensor.of is {shown(self.of)}; a state's name, a signal of slcp_warp.measures, or a "
                "function of states, is needed"
            )

    @property
    def of_step(self) -> bool:
        """Whether it is of the forces of a step."""
        return isinstance(self.of, Signal) and any(each.kind in OF_STEPS for each in self.of.parts())


class Sensors:
    """The sensors of a filter.

    Attributes:
        names: (S,) by which logs and biases know them.
        places: (S,) of the states that they show, -1 of others.
        variance, period: (S,).
        of_step: (F,) which of them are of the forces of a step.
        every, drawn: (S,) each, and whether it was given as a `Sensor`, whose noise is drawn beside a run's.
    """

    def __init__(self, scene: Scene, given: Mapping[str, float | Sensor]) -> None:
        """Args:
        given: by name; a number is the noise of the state of this name.

        Raises:
            ArgumentError, ArgumentTypeError: what the scene has not got, numbers out of range.
        """
        if not isinstance(given, Mapping) or not given:
            raise ArgumentTypeError(
                f"sensors is {shown(given)}; a dict of numbers by state name is needed, or of policies.Sensor"
            )
        self.scene = scene
        names: list[str] = []
        every: list[Sensor] = []
        for name, one in given.items():
            every.append(one if isinstance(one, Sensor) else _of_state(scene, name, one))
            if isinstance(one, Sensor) and not (isinstance(name, str) and name):
                raise ArgumentTypeError(f"sensors has the name {shown(name)}; a text is needed")
            names.append(name if isinstance(one, Sensor) else str(every[-1].of))
        if len(set(names)) < len(names):
            raise ArgumentError(f"sensors names a state twice: {', '.join(names)}")
        places = [self._place(each) for each in every]
        self.names, self.every, self.places = tuple(names), tuple(every), np.array(places)
        self.drawn = np.array([isinstance(one, Sensor) for one in given.values()])
        self.variance = np.square([each.noise for each in every])
        of_scene = np.asarray(scene.state_period)
        own_period = np.array([each.period for each in every])
        plain = (self.places >= 0) & (own_period == 0.0)
        self.period = np.where(plain, of_scene[self.places], own_period)
        self.of_step = np.flatnonzero([each.of_step for each in every])
        self._others = [i for i in range(len(every)) if places[i] < 0 and not every[i].of_step]
        self._moves = self._coordinates()
        self._selected = np.eye(2 * scene.nv)[self.places] * (self.places >= 0)[:, None]

    def _place(self, sensor: Sensor) -> int:
        """Of the state that it shows; -1: it shows something else, which the scene has."""
        if isinstance(sensor.of, Signal):
            for each in sensor.of.parts():
                each.place(self.scene)
                each.less(self.scene)
            return sensor.of.place(self.scene) if sensor.of.plain else -1
        if isinstance(sensor.of, str):
            return index_of("Sensor.of", sensor.of, self.scene.state_names)
        self._of_function(sensor.of, np.tile(self.scene.x0, (1, 2, 1)))
        return -1

    def _coordinates(self) -> np.ndarray:
        """Of the states those that sensors depend on which show no state: by points, on places."""
        found = set[int]()
        for of in (self.every[i].of for i in self._others):
            if not isinstance(of, Signal):
                return np.arange(2 * self.scene.nv)
            for each in of.parts():
                own = {each.place(self.scene), each.less(self.scene)} - {NONE}
                found |= own if each.kind in ("state", "cosine") else set()
                found |= set(range(self.scene.nv)) if each.kind in ("point", "distance") else set()
        return np.array(sorted(found), int)

    def __len__(self) -> int:
        return len(self.names)

    @property
    def bends(self) -> bool:
        """Whether slopes depend on where they are taken."""
        return bool(self._others)

    def with_noise(self, deviations: np.ndarray) -> dict[str, float | Sensor]:
        """The same, by name, with other standard deviations (S,)."""
        every = zip(self.names, self.every, self.drawn, deviations.tolist())
        return {name: replace(each, noise=sd) if drawn else sd for name, each, drawn, sd in every}

    def expected(self, states: np.ndarray, params: Parameters | None = None) -> np.ndarray:
        """(B, S) what they show of states (B, nx), NaN of those of a step, and where a function gives none.

        Args:
            params: of the worlds, or one row; None: the scene's.
        """
        out = np.where(self.places >= 0, states[:, self.places], np.nan)
        if self._others:
            out[:, self._others] = self._values(states[:, None].repeat(2, axis=1), params)[:, 0]
        return out

    def slopes(self, states: np.ndarray, params: Parameters | None = None) -> np.ndarray:
        """(B, S, nx) of what they show by states (B, nx), 0 of those of a step: C of (M68)."""
        return self.seen(states, params)[1]

    def seen(self, states: np.ndarray, params: Parameters | None = None) -> tuple[np.ndarray, np.ndarray]:
        """`expected` and `slopes` together; NaN and 0 where a sensor has no slopes."""
        expected = np.where(self.places >= 0, states[:, self.places], np.nan)
        slopes = np.tile(self._selected, (len(states), 1, 1))
        if self._others:
            known = np.isfinite(states).all(axis=1)
            around, twice = moved(np.where(known[:, None], states, self.scene.x0), self._moves)
            values = self._values(around, params)
            forth, back = np.split(values[:, 1:], 2, axis=1)
            of_moves = difference(forth, back, self.period[self._others]) / twice[:, :, None]
            known = known[:, None] & np.isfinite(of_moves).all(axis=1)
            expected[:, self._others] = np.where(known, values[:, 0], np.nan)
            own = np.where(known[:, :, None], of_moves.swapaxes(1, 2), 0.0)
            slopes[:, np.array(self._others)[:, None], self._moves] = own
        return expected, slopes

    def _values(self, states: np.ndarray, params: Parameters | None) -> np.ndarray:
        """(B, M, others) of states (B, M, nx); NaN of those that are not finite."""
        known = np.isfinite(states).all(axis=2)
        states = np.where(known[..., None], states, self.scene.x0)
        recorded = Recorded(self.scene, self.scene.step_size, states, numbers=_numbers(params))
        every = [self.every[i].of for i in self._others]
        values = [
            recorded.series(of) if isinstance(of, Signal) else self._of_function(of, states) for of in every
        ]
        return np.where(known[..., None], np.stack(values, axis=2), np.nan)

    @staticmethod
    def _of_function(of: Any, states: np.ndarray) -> np.ndarray:
        """(B, M) of states (B, M, nx)."""
        flat = states.reshape(-1, states.shape[2])
        with of_user("Sensor.of, a function, does not take states (n, nx)"), np.errstate(all="ignore"):
            given = of(flat.copy())
        if getattr(given, "dtype", None) in (np.float16, np.float32):
            raise ArgumentError(
                f"Sensor.of, a function, gave {given.dtype}, whose differences are noise; float64 is needed"
            )
        if (found := numeric(given)) is None or found.shape != (len(flat),):
            got = shown(given) if found is None else f"shape {found.shape}"
            raise ArgumentError(
                f"Sensor.of, a function, gave {got} of states {flat.shape}; ({len(flat)},) numbers are needed"
            )
        return found.reshape(states.shape[:2])


def _of_state(scene: Scene, name: Any, sd: Any) -> Sensor:
    """A sensor of a state by its name, or its place, and standard deviation."""
    place = index_of("a name of sensors", name, scene.state_names)
    return Sensor(scene.state_names[place], number(f"sensors[{name!r}]", sd, LEAST, MOST))


def difference(measured: np.ndarray, expected: np.ndarray, period: np.ndarray) -> np.ndarray:
    """What was measured less what was expected, (.., sensors), modulo their period; NaN stays."""
    off = measured - expected
    turns = np.round(np.divide(off, period, out=np.zeros_like(off), where=period > 0.0))
    return np.asarray(off - turns * period)


def moved(states: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States (B, 1 + 2 W, nx): themselves, each of W of theirs moved forth, and back; and by how much
    together, (B, W).
    """
    nx = states.shape[1]
    reach = REACH * np.maximum(1.0, np.abs(states[:, which]))
    steps = reach[:, :, None] * np.eye(nx)[which]
    both = np.concatenate([np.zeros((len(states), 1, nx)), steps, -steps], axis=1)
    return states[:, None] + both, 2.0 * reach


def _numbers(params: Parameters | None) -> dict[str, np.ndarray] | None:
    """Those that points depend on, an axis of states behind that of the worlds."""
    if params is None:
        return None
    every = ((name, params[name], len(params.layout.shape(name))) for name in OF_MASS)
    return {name: value[:, None] if value.ndim > own else value for name, value, own in every}
