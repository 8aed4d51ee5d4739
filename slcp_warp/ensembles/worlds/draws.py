"""The worlds of a sweep: parameters, starts and events, drawn by world or given; names of what varies."""

import functools
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.device.tables import empty_table, make_table
from slcp_warp.kernels.ensembles.disturbances import DROPOUT_FIELDS, PUSH_FIELDS, TIMING_FIELDS
from slcp_warp.kernels.ensembles.draws import make_columns, make_corners_kernel, make_draw_kernel, pick_kernel
from slcp_warp.kernels.structure import STEP_SIZE

from ...inputs import rules
from ...inputs.checks import array, instance, memory, shown, whole
from ...inputs.errors import ArgumentError
from ...simulator import Simulator
from ...tasks.disturbances import Disturbances, Uniform, laws
from ...tasks.disturbances.laws import Laws
from ...tasks.task import Task
from .arrays import Worlds
from .columns import read_columns, told_once
from .corners import columns_of_corners, with_corners_within

MOST = float(np.finfo(np.float32).max)
WORLDS = 2**31 - 1  # that have numbers


class Which(NamedTuple):
    """The worlds world0, world0 + 1, ..., so many, or those that have the numbers `number` (0 or worlds,)."""

    world0: int
    worlds: int
    number: wp.array


class Columns:
    """The columns of a table on a device."""

    def __init__(self, sim: Simulator, seed: int, drawn: Laws, dtype: Any, most: dict[int, float]) -> None:
        self.laws, self.device, self.dtype = drawn, sim.device, dtype
        self._seed, self._most = seed, most

    @functools.cached_property
    def _struct(self) -> Any:
        """What the kernel draws from; made where there is something to draw."""
        out, drawn = make_columns(self.dtype)(), self.laws
        limit = np.full(len(drawn.law), MOST)
        limit[list(self._most)] = list(self._most.values())
        numbers, address = [drawn.first, drawn.second, limit], [drawn.law, drawn.step, drawn.stream]
        out.seed = self._seed
        out.base = wp.array(np.atleast_2d(drawn.base), dtype=self.dtype, device=self.device)
        out.numbers = wp.array(np.array(numbers), dtype=self.dtype, device=self.device)
        out.address = wp.array(np.array(address), dtype=wp.int32, device=self.device)
        return out

    def draw(self, which: Which, pick: wp.array, *shape: int) -> wp.array:
        """Rows of worlds, (B, *shape)."""
        size = which.worlds, len(self.laws.law)
        if shape:
            out: wp.array = wp.zeros(size, dtype=self.dtype, device=self.device)
        else:
            out = empty_table(size, self.dtype, self.device)
        inputs = [which.world0, which.number, self._struct, pick, out]
        launch(make_draw_kernel(self.dtype), which.worlds, inputs, self.device)
        return out.reshape((which.worlds, *shape)) if shape else out


class Draws:
    """What the worlds of one case are drawn from.

    Attributes:
        disturbances: that they are drawn by.
        numbers: of a world that are kept while it runs, beside its parameters and state.
        numbered: whether worlds have numbers of their own, which are not their places.
        most: beyond every world's number; None: nobody knows.
    """

    most: int | None = None

    def __init__(
        self,
        sim: Simulator,
        disturbances: Disturbances,
        seed: int,
        step_size: float,
        starts: np.ndarray,
        base: np.ndarray,
        longest: float,
        in_order: bool = False,
    ) -> None:
        """Args:
        step_size: [s].
        starts: (M, nx), one of them for each world.
        base: (P,) parameters that are not drawn.
        longest: step size [s].
        in_order: world i begins at start i instead of one that is drawn.
        """
        self.numbered = False
        d, self.sim, self.seed, self.disturbances = disturbances, sim, seed, disturbances
        self.in_order, self.starts = in_order, len(starts)
        base = np.array(base)
        base[STEP_SIZE] = step_size
        scene = sim.scene
        params = laws.parameter_laws(scene, base, d.parameters)
        self._params = Columns(sim, seed, params, sim.dtype, {STEP_SIZE: longest})
        corners = columns_of_corners(scene.structure)
        self._corners = corners[np.isin(corners, params.varied).any(axis=1)]  # of which a number is drawn
        self._x0 = Columns(sim, seed, d.start_laws(scene, starts), sim.dtype, {})
        events = d.push_laws(), d.dropout_laws(), d.timing_laws()
        self._events = [Columns(sim, seed, d.kick_laws(scene), sim.dtype, {})]
        self._events += [Columns(sim, seed, each, wp.float64, {}) for each in events]
        self.numbers = d.numbers(scene.nv)
        self.told = [self._params, self._x0, *self._events]

    def _pick(self, which: Which) -> wp.array:
        """Rows of the starts; none where there is one only."""
        world0, count, number = which
        pick: wp.array = wp.zeros(count if self.starts > 1 else 0, dtype=wp.int32, device=self.sim.device)
        if self.in_order and self.starts > 1:
            numbers = number.numpy() if len(number) else world0 + np.arange(count)
            pick.assign(numbers % self.starts)
        elif self.starts > 1:
            inputs = [world0, number, self.seed, self.starts, pick]
            launch(pick_kernel, count, inputs, self.sim.device)
        return pick

    def _none(self) -> wp.array:
        return wp.zeros(0, dtype=wp.int32, device=self.sim.device)

    def worlds(self, world0: int, count: int) -> Worlds:
        """Worlds world0, world0 + 1, ... on the simulator's device."""
        return self._drawn(Which(world0, count, self._none()))

    def of_numbers(self, numbers: np.ndarray) -> Worlds:
        """The worlds of these numbers (B,), on the simulator's device."""
        own: wp.array = wp.array(numbers, dtype=wp.int32, device=self.sim.device)
        return replace(self._drawn(Which(0, len(numbers), own)), numbers=own)

    def _drawn(self, which: Which) -> Worlds:
        none, count = self._none(), which.worlds
        widths = self.sim.nx // 2, len(PUSH_FIELDS), len(DROPOUT_FIELDS), len(TIMING_FIELDS)
        events = [_some(each, which, none, width) for each, width in zip(self._events, widths)]
        params = self._params.draw(which, none)
        if len(self._corners):
            columns: wp.array = wp.array(self._corners, dtype=wp.int32, device=self.sim.device)
            launch(make_corners_kernel(self.sim.dtype), count, [columns, params], self.sim.device)
        return Worlds(self._x0.draw(which, self._pick(which)), params, *events)

    def columns(self, worlds: Worlds, world0: int) -> dict[str, np.ndarray]:
        """What was drawn of worlds world0, ..., by the name of its column: "drawn_block.mass", ..."""
        out: dict[str, np.ndarray] = {}
        tables = worlds.params, worlds.x0, worlds.kicks, worlds.pushes, worlds.dropouts, worlds.timing
        if self._x0 in self.told and self.starts > 1 and not self.in_order:
            out["drawn_start"] = self._pick(Which(world0, len(worlds), self._none())).numpy()
        for each, table in zip((self._params, self._x0, *self._events), tables):
            if each in self.told and len(each.laws.varied):
                told = told_once(each.laws.names, each.laws.varied.tolist(), each.laws.alike)
                columns = zip(told, read_columns(table, [place for _, place in told]))
                out |= {f"drawn_{name}": drawn.astype(np.float32) for (name, _), drawn in columns}
        return out


def _some(columns: Columns, which: Which, pick: wp.array, width: int) -> wp.array | None:
    rows = len(columns.laws.law) // width
    return columns.draw(which, pick, rows, width) if rows else None


def draws_of_task(
    sim: Simulator, task: Task, disturbances: Disturbances, seed: int, step_size: float
) -> Draws:
    """Of the worlds of a task, disturbed as said; undisturbed ones begin at the starts in their order."""
    assert task.duration is not None
    base = sim.params.table()[0]
    in_order = not disturbances.any()
    return Draws(sim, disturbances, seed, step_size, task.start, base, task.duration, in_order)


class Given:
    """Worlds that are given, in place of `Draws`."""

    def __init__(self, sim: Simulator, task: Task, worlds: Worlds, step_size: float) -> None:
        """Args:
        task: whose disturbances say when kicks are, what is pushed, and what is drawn in single steps.
        step_size: [s], of worlds whose parameters are not given.

        Raises:
            ArgumentError: numbers of another shape than the task's scene and disturbances have.
        """
        d, self.sim, self.disturbances, worlds = task.disturbances, sim, task.disturbances, worlds.numpy()
        count, nv = len(worlds), sim.nx // 2
        table = np.repeat(sim.params.replace(step_size=step_size).table()[:1], count, 0)
        self.tables: dict[str, np.ndarray] = {}
        for name, shape, otherwise in (
            ("x0", (sim.nx,), None),
            ("params", (table.shape[1],), table),
            ("kicks", (len(d.kick_times), nv), None),
            ("pushes", (len(d.pushes), len(PUSH_FIELDS)), None),
            ("dropouts", (len(d.dropouts), len(DROPOUT_FIELDS)), None),
            ("timing", (int(d.timed), len(TIMING_FIELDS)), None),
        ):
            given = getattr(worlds, name)
            if given is None:
                given = np.zeros((count, *shape)) if otherwise is None else otherwise
            if given.shape[1:] != shape:
                need = ", ".join(map(str, (count, *shape)))
                raise ArgumentError(f"Worlds.{name} has shape {given.shape}; ({need}) is needed")
            self.tables[name] = given
        for name, start, extent in sim.params.layout.columns:
            own = self.tables["params"][:, start : start + int(np.prod(extent, dtype=int))]
            rules.check(f"Worlds.params: {name}", own, ArgumentError, name)
        self.tables["params"] = with_corners_within(sim.scene.structure, self.tables["params"])
        _check_timing(d, self.tables["timing"])
        self.numbered = worlds.numbers is not None
        numbers = np.arange(count) if worlds.numbers is None else worlds.numbers
        self.most = int(np.max(numbers, initial=0)) + 1
        self.tables["numbers"] = numbers.astype(np.int32)
        self.numbers = d.numbers(nv)
        params = laws.parameter_laws(sim.scene, table[0], {})
        self._names = (
            *(
                ("params", params.names),
                ("x0", sim.scene.state_names),
                ("kicks", d.kick_laws(sim.scene).names),
            ),
            *(("pushes", d.push_laws().names), ("dropouts", d.dropout_laws().names)),
            ("timing", d.timing_laws().names),
        )

    def worlds(self, world0: int, count: int) -> Worlds:
        """Worlds world0, world0 + 1, ... of these, on the simulator's device."""
        own = {name: wp.int32 if name == "numbers" else self.sim.dtype for name in self.tables}
        own |= dict.fromkeys(("pushes", "dropouts", "timing"), wp.float64)

        def put(table: np.ndarray, dtype: Any, device: Any) -> wp.array:
            if table.ndim == 2 and dtype is self.sim.dtype:
                return make_table(table, dtype, device)
            return wp.array(table, dtype=dtype, device=device)

        rows: dict[str, wp.array] = {
            name: put(table[world0 : world0 + count], own[name], self.sim.device)
            for name, table in self.tables.items()
            if table[0].size
        }
        return Worlds(**rows)

    def columns(self, worlds: Worlds, world0: int) -> dict[str, np.ndarray]:
        """What differs among all worlds, of worlds world0, ...; named as by `Draws`."""
        out: dict[str, np.ndarray] = {}
        for kind, names in self._names:
            table = self.tables[kind].reshape(len(self.tables[kind]), -1)
            varied = np.flatnonzero(np.ptp(table, axis=0)).tolist()
            for name, c in told_once(names, varied, functools.partial(_equal, table)):
                out[f"drawn_{name}"] = table[world0 : world0 + len(worlds), c].astype(np.float32)
        return out


def _equal(table: np.ndarray, columns: list[int]) -> bool:
    """Whether columns of a table hold the same numbers."""
    return not np.ptp(table[:, columns], axis=1).any()


def _check_timing(d: Disturbances, timing: np.ndarray) -> None:
    """Raise ArgumentError for delays and holds that code is not made for."""
    for name, own in zip(TIMING_FIELDS, timing.reshape(-1, len(TIMING_FIELDS)).T):
        most = getattr(d, name)
        most = most.high if isinstance(most, Uniform) else most
        if own.size and not (own.min() >= 0.0 and own.max() <= most):
            raise ArgumentError(
                f"Worlds.timing: {name} is from {own.min():g} to {own.max():g} s; from 0 to "
                f"Disturbances.{name}, {most:g}, is needed"
            )


def draw_worlds(
    task: Task, worlds: Any, seed: int = 0, first: int = 0, *, dtype: str = "float32", device: Any = None
) -> Worlds:
    """The numbers of a task's disturbed worlds `first`, `first` + 1, ...: those that a sweep draws.

    A sweep with these instead of a number of worlds, of the same seed and precision, has the same results to
    the last bit; changed, selected or repeated ones are worlds as good as drawn ones.

    Args:
        task: whose worlds they are.
        worlds: how many; or which, by a list or an array of their numbers.
        seed: as of the sweep.
        first: number of the first, where `worlds` says how many.
        dtype: of the sweep. What is not drawn is in it, too: a step of 0.01 s is 0.00999999978 s in float32.
        device: as of a `Simulator`.
    """
    task = instance("task", task, Task, "a slcp_warp.Task")
    seed, first = whole("seed", seed, 0), whole("first", first, 0)
    several = isinstance(worlds, list | tuple | np.ndarray)
    count = len(array("worlds", worlds, ("B",))) if several else whole("worlds", worlds, 1, WORLDS)
    sim = task.simulator(dtype=dtype, device=device)
    each = sim.params.layout.width + sim.nx + task.disturbances.numbers(task.scene.nv)
    memory("worlds: their numbers", count * each, 16, sim.device)
    draws = draws_of_task(sim, task, task.disturbances, seed, task.scene.step_size)
    return draws.of_numbers(_which(worlds, count, first)).numpy()


def _which(worlds: Any, count: int, first: int) -> np.ndarray:
    """Numbers of worlds: so many from the first on, or those that are given."""
    if not isinstance(worlds, list | tuple | np.ndarray):
        if first > WORLDS - count:
            raise ArgumentError(f"first is {first}; with {count} worlds at most {WORLDS - count} is needed")
        return first + np.arange(count)
    given = array("worlds", worlds)
    if not count or (given % 1.0 != 0.0).any() or given.min() < 0.0 or given.max() >= WORLDS:
        raise ArgumentError(
            f"worlds is {shown(worlds)}; numbers of worlds, from 0 to {WORLDS - 1}, are needed"
        )
    return given.astype(np.int64)
