"""What a rollout gives back: worlds over time, with the scene, parameters and options that they are of."""

import functools
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from ..description.scene import Scene
from ..inputs import checks
from ..inputs.arrays import Array, to_numpy
from ..inputs.errors import ArgumentError
from ..measures.reductions import Measure, Success
from ..measures.signals import Signal
from ..options import Options
from ..parameters import Parameters
from ..storage.printed import Printed, Table, counted
from .energies import Energies, energies
from .measured import RECORDED, measured, series
from .momentum import Momentum, momentum
from .overlaps import failed, failed_table
from .pictures.contacts import contact_table
from .pictures.motion import Motion
from .record_checks import TRAJECTORY, check_trajectory, made_steps
from .records import Record, read_record
from .simulated import Simulated
from .statuses import statuses
from .step import contact_impulse
from .tensions import forces_are_known, tendon_forces
from .turning import turned
from .worlds import columns, selected, some_worlds

ARRAYS = ("states", "status", *RECORDED)


@dataclass(frozen=True, repr=False)
class Trajectory(Printed):
    """Outcome of a rollout; arrays are of the caller's kind, batch first.

    `trajectory[3]` is one world, `trajectory[2:5]`, an index or a mask some worlds; `len` their number.

    Attributes:
        states: (B, N+1, nx), the start first.
        status: (B,) see `Status`.
        controls: (B, N, nu) if recorded, else None; NaN from the step on that was not solved.
        impulse: (B, N, nr) of the rows [N s, N m s], likewise.
        gap: (B, N, nr) of the rows before every step [m, rad], likewise.
        simulated: scene, options and parameters of the worlds; None: unknown.
        kept: which steps the states are of, where a rollout kept checkpoints only; None: all.
        header: further entries of its file, JSON values.
    """

    states: Array
    status: Array
    controls: Array = None
    impulse: Array = None
    gap: Array = None
    simulated: Simulated | None = None
    kept: tuple[int, ...] | None = None
    header: dict[str, Any] = field(default_factory=dict)
    _measured: Callable[[np.ndarray, Parameters], np.ndarray] | None = field(default=None, compare=False)
    _made: np.ndarray | None = field(default=None, compare=False)  # (B,) steps, of what failures ended

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_measured": None}

    @property
    def batched(self) -> bool:
        """Whether there is an axis of worlds."""
        return len(self.states.shape) == 3

    def __len__(self) -> int:
        return int(self.states.shape[0]) if self.batched else 1

    def __iter__(self) -> Iterator["Trajectory"]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, worlds: Any) -> Self:
        if not self.batched:
            raise ArgumentError("this trajectory is one world without an axis of worlds; it has no others")
        index = some_worlds(worlds, len(self))
        values: dict[str, Any] = {name: selected(getattr(self, name), index) for name in ARRAYS}
        own = None if self.simulated is None else self.simulated.select(index)
        made = None if self._made is None else np.atleast_1d(self._made[index])
        return replace(self, simulated=own, _made=made, **values)

    def _known(self) -> Simulated:
        if self.simulated is None:
            raise ArgumentError("this trajectory does not know its scene; a simulator's rollout does")
        return self.simulated

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self._known().scene

    @property
    def options(self) -> Options:
        """What its steps solved."""
        return self._known().options

    @property
    def params(self) -> Parameters:
        """The parameters of its worlds."""
        return self._known().parameters

    @property
    def step_size(self) -> float:
        """The time step h, of the first world if they differ [s]."""
        return self._known().step_size

    @property
    def times(self) -> np.ndarray:
        """When the states are [s]: (N+1,), or (B, N+1) where worlds have step sizes of their own."""
        steps = np.arange(self.states.shape[-2]) if self.kept is None else np.array(self.kept)
        return np.asarray(self.params["step_size"][..., None] * steps)

    def recorded(self, name: str) -> np.ndarray:
        """States, status, controls, impulse or gap in NumPy, batch first: (B, ...).

        Raises:
            ArgumentError: the rollout did not record it.
        """
        checks.choice("name", name, ARRAYS)
        given = getattr(self, name)
        if given is None:
            raise ArgumentError(f"{name} was not recorded; roll out with record={name!r}")
        found = to_numpy(given)
        if name == "status":
            return found.reshape(-1)
        structure = self.scene.structure
        size = {"states": 2 * structure.nv, "controls": structure.nu}.get(name, structure.nr)
        return (found if self.batched else found[None])[..., :size]

    @functools.cached_property
    def _by_pair(self) -> np.ndarray:
        """`contact_impulse`, batch first."""
        return contact_impulse(self.scene, self.recorded("impulse"), self.params["friction"], self.options)

    @property
    def contact_impulse(self) -> np.ndarray:
        """Normal and tangential impulse on shape_b along (n, t) of every pair, (B, N, pairs, 2) [N s].

        Without the axis of worlds where the states have none. Needs the impulse recorded. Which of several
        contacts of the same bodies carries what is not unique.
        """
        return self._by_pair if self.batched else self._by_pair[0]

    def contacts(self, world: int = 0, least: float = 1e-9) -> dict[str, np.ndarray]:
        """What presses where in a world: columns with a row for every step and pair whose contact does.

        step, time [s] and pair (its name), x, y: where it touches as the step begins [m], normal_x,
        normal_y: from shape_a to shape_b, normal_force and tangential_force: what pushes shape_b along that
        and along it turned by 90 degrees counter-clockwise [N]. `pandas.DataFrame(run.contacts())`.

        Args:
            world: which.
            least: normal impulses up to that are none [N s].

        Raises:
            ArgumentError: impulses were not recorded, or there are checkpoints only.
        """
        if self.kept is not None:
            raise ArgumentError("this trajectory has checkpoints only; contacts need all states")
        index = checks.whole("world", world, 0, len(self) - 1)
        impulse = np.nan_to_num(self._by_pair[index])
        return contact_table(self.motion(index), impulse, checks.number("least", least, 0.0))

    def measure(self, what: Measure | Success) -> Any:
        """(B,) values of a measure of `slcp_warp.measures`, or whether worlds succeeded; one number of one
        world without an axis of worlds.

        NaN, and no success, of worlds that are not SOLVED. Of a world of a replay that a failure ended the
        steps until then count, as in a sweep.

        Raises:
            ArgumentError: it looks at what was not recorded (controls; "impulse" for contacts; "gap"), or at
                what the scene has not got.
        """
        found = measured(self, what)
        return found if self.batched else found[0]

    def series(self, signal: Signal) -> np.ndarray:
        """(B, N+1) values of a signal of `slcp_warp.measures` in every step; (N+1,) of one world without an
        axis of worlds. The last is of the last state, with the last step's controls and contacts.

        NaN of worlds that are not SOLVED; a world of a replay that a failure ended goes on as it stood.

        Raises:
            ArgumentError: see `measure`.
        """
        found = series(self, signal)
        return found if self.batched else found[0]

    @property
    def _staggered(self) -> bool:
        return self.options.method.leapfrog

    @property
    def energies(self) -> Energies:
        """Kinetic, potential and elastic energy of every state, (B, N+1) [J]: see `slcp_warp.energies`.

        Without the axis of worlds where the states have none; of a leapfrog, half a step before each.
        """
        found = energies(self.recorded("states"), self.params, staggered=self._staggered)
        if self.batched:
            return found
        return Energies(found.kinetic[0], found.potential[0], found.elastic[0])

    @property
    def momentum(self) -> Momentum:
        """Momentum and centre of mass of every state, of all bodies, (B, N+1): see `slcp_warp.momentum`.

        Without the axis of worlds where the states have none; of a leapfrog, momenta half a step before each.
        """
        found = momentum(self.recorded("states"), self.params, staggered=self._staggered)
        if self.batched:
            return found
        return Momentum(found.mass[0], found.place[0], found.linear[0], found.angular[0])

    @property
    def tendon_forces(self) -> np.ndarray:
        """How hard every tendon pulls in every step, (B, N, tendons) [N, N m]: spring, damper and actuators
        together, within its limit (M57), (M64); positive towards a greater length; 0 once a failure has
        ended a world of a replay. Without the axis of worlds where the states have none. Where controls pull
        at tendons they have to be recorded.
        """
        if self.kept is not None:
            raise ArgumentError("this trajectory has checkpoints only; forces of tendons need all states")
        found = self._pulls(np.full(len(self), True))
        return found if self.batched else found[0]

    def _pulls(self, worlds: np.ndarray) -> np.ndarray:
        own = self._known().select(worlds).parameters
        numbers = {name: own[name] for name in own.names}
        controls = None if self.controls is None else self.recorded("controls")[worlds]
        out = tendon_forces(self.scene, self.options, numbers, self.recorded("states")[worlds], controls)
        if self._made is not None:
            out[np.arange(out.shape[1]) >= self._made[worlds, None]] = 0.0
        return out

    def failures(self) -> list[tuple[int, str, str]]:
        """The first worlds that are not SOLVED: number, status, what overlaps in the state they failed at.

        Raises:
            ArgumentError: see `last_gap`.
        """
        return failed(self.scene, self.status, self.last_gap)

    def last_gap(self, worlds: Any) -> np.ndarray:
        """(K, nr) distances of the rows of worlds in their last states [m, rad], measured by a step.

        Args:
            worlds: as in `trajectory[worlds]`.

        Raises:
            ArgumentError: this trajectory has no simulator: it is from a file, or unpickled.
        """
        if self._measured is None:
            raise ArgumentError("this trajectory has no simulator; Simulator.step measures gaps, too")
        index = np.atleast_1d(np.arange(len(self))[some_worlds(worlds, len(self))])
        return self._measured(self.recorded("states")[index, -1], self._known().select(index).parameters)

    def table(self) -> dict[str, np.ndarray]:
        """Tidy columns by name, a row for every world and state: `pandas.DataFrame(run.table())`.

        World, time [s], status, states by their names; `control NAME`, `impulse ROW` and `gap ROW` of the
        step that begins there, NaN after the last one, where recorded.
        """
        steps = {name: self.recorded(name) for name in RECORDED if getattr(self, name) is not None}
        return columns(self.scene, self.times, self.recorded("states"), self.recorded("status"), steps)

    def record(self) -> Record:
        """What its file holds."""
        if self.kept is not None:
            raise ArgumentError("this trajectory has checkpoints only; a file needs all states")
        names = ("states", "status", *(name for name in RECORDED if getattr(self, name) is not None))
        arrays = {name: self.recorded(name) for name in names}
        if self.impulse is not None:
            arrays["contact_impulse"] = self._by_pair
        made = {} if self._made is None else {"made": self._made.tolist()}
        return Record("trajectory", arrays, self._known(), self.header | {"batched": self.batched} | made)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write an .npz file, with scene, options and parameters; replaced only once complete.

        Raises:
            ArgumentError: another ending, an unknown scene, or checkpoints only.
        """
        return self.record().save(path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Trajectory":
        """Read a file of `save` or of `slcp simulate`; arrays are NumPy's.

        Raises:
            FileError: truncated, no trajectory, of a newer version, or inconsistent.
            FileNotFoundError: no such file.
        """
        record = read_record(path, "trajectory", TRAJECTORY, check_trajectory)
        values: dict[str, Any] = {name: record.arrays.get(name) for name in ARRAYS}
        if record.header.get("batched") is False and len(record["states"]) == 1:
            values = {name: None if each is None else each[0] for name, each in values.items()}
        header = {name: value for name, value in record.facts().items() if name not in ("batched", "made")}
        made = made_steps(record.header.get("made"), record["states"].shape, path)
        return cls(**values, simulated=record.simulated, header=header, _made=made)

    def motion(self, world: int = 0) -> Motion:
        """One world as pictures take it.

        Raises:
            ArgumentError: there is no such world, or its states are not finite.
        """
        index = checks.whole("world", world, 0, len(self) - 1)
        states = self.recorded("states")[index].astype(float)
        if not np.isfinite(states).all():
            raise ArgumentError(f"the states of world {index} are not finite")
        times = self.times[index] if self.times.ndim == 2 else self.times
        known = {name: getattr(self, name) is not None for name in ("controls", "impulse")}
        pushes = self._by_pair[index, :, :, 0].sum(axis=-1).astype(float) if known["impulse"] else None
        controls = self.recorded("controls")[index] if known["controls"] else None
        known_pulls = forces_are_known(self.scene, self.options, controls)
        pulls = self._pulls(np.arange(len(self)) == index)[0] if known_pulls else None
        return Motion(self.scene, self._known().world(index), times, states, pushes, controls, pulls)

    def plot(self, world: int = 0) -> Any:
        """A matplotlib figure of a world: the mechanism on its way, its states and what was recorded.

        Raises:
            ImportError: matplotlib is missing.
        """
        from .pictures import run  # it loads matplotlib

        return run.figure(self.motion(world))

    def animate(
        self, path: str | os.PathLike[str], world: int = 0, seconds: float | None = None, rate: int = 10
    ) -> Path:
        """Write a GIF of a world's motion, in real time.

        Args:
            path: of the .gif.
            world: which.
            seconds: only the last ones [s]; None: all.
            rate: pictures a second.

        Raises:
            ImportError: matplotlib or pillow are missing.
        """
        from .pictures import animation  # it loads matplotlib

        place = checks.path("path", path)
        if place.suffix != ".gif":
            raise ArgumentError(f"path {place} ends in {place.suffix!r}; .gif is needed")
        span = np.inf if seconds is None else checks.number("seconds", seconds, 0.0, above=True)
        return animation.animation(self.motion(world), place, span, checks.whole("rate", rate, 1, 50))

    def _line(self) -> str:
        steps = self.states.shape[-2] - 1 if self.kept is None else self.kept[-1]
        known = "" if self.simulated is None else f"{self.scene.name!r}, "
        of = "" if self.simulated is None else f" of {self.step_size:g} s"
        more = ", ".join(name for name in RECORDED if getattr(self, name) is not None)
        recorded = f"; recorded: {more}" if more else ""
        return f"{known}{counted(len(self), 'world')}, {steps} steps{of}: {statuses(self.status)}{recorded}"

    def _remarks(self) -> list[str]:
        if self.simulated is None or not len(self):
            return []
        fast = turned(self.scene, self.recorded("states"), self.params["step_size"])
        return [fast] if fast else []

    def _tables(self) -> list[Table]:
        if self.simulated is None or not len(self):
            return []
        first = self.recorded("states")[0]
        numbers = zip(*(map(float, each) for each in (first[0], first[-1], first.min(0), first.max(0))))
        names = zip(self.scene.state_names, self.scene.state_units)
        rows = [(*name, *values) for name, values in zip(names, numbers)]
        return [
            Table("the first world", ("state", "unit", "start", "end", "lowest", "highest"), rows, left=2),
            *([] if self._measured is None else [failed_table(self.scene, self.status, self.last_gap)]),
        ]
