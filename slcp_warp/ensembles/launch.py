"""The launches of one case of a sweep, and what they leave."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from slcp_warp.kernels.ensembles.arrival import NOTED, OVERLAP, STOPPED, make_span
from slcp_warp.kernels.ensembles.disturbances import ROUNDING, make_conditions
from slcp_warp.kernels.policies.contract import PolicyKernel
from slcp_warp.kernels.structure import STEP_SIZE

from ..description.scene import Scene
from ..inputs import checks
from ..inputs.checks import shown
from ..inputs.errors import ArgumentError, ArgumentTypeError
from ..inputs.limits import limit_rows
from ..measures import Measure
from ..measures.tables import MeasureTable, priced
from ..simulator import Simulator
from ..stepping.arguments import at_step_size, policy_arrays
from ..stepping.host import acts_on_host, senses_of
from ..tasks.disturbances import Disturbances
from ..tasks.task import RECORDED
from .by_periods import OnHost, by_periods, handed_on
from .run_worlds import RunWorlds, sweep_kernel
from .worlds import Worlds
from .worlds.between import counted_in_steps
from .worlds.columns import read_columns
from .worlds.draws import Draws, Given
from .worlds.events import Written, events_of, put_pushes
from .worlds.placed import placed

CHUNK_BYTES = 128 * 2**20
CHUNK_SHARE = 128  # of a GPU's memory, where that is more: few worlds leave it idle


class Recorded(NamedTuple):
    """Components of the state that are recorded while worlds run; none costs nothing.

    Attributes:
        states: by name or place.
        every: time between two records [s]; the first is of the start, and one comes before what happens to
            a world at its time.
    """

    states: tuple[str | int, ...] = ()
    every: float = 0.5

    def count(self, duration: float) -> int:
        """Records of a world in a run of a duration [s]."""
        return int(duration / self.every + ROUNDING) + 1 if self.states else 0

    @classmethod
    def of(cls, scene: Scene, states: Any, every: Any, duration: float) -> "Recorded":
        """Of a task's scene, checked.

        Raises:
            ArgumentError: states that the scene has not got, or a time beyond the duration.
        """
        if not isinstance(states, list | tuple):
            raise ArgumentTypeError(
                f"record is {shown(states)}; a tuple of states is needed, by name or place"
            )
        every = checks.number("record_every", every, 0.0, above=True)
        if not states:
            return NOT_RECORDED
        names = tuple(scene.state_names[scene.state_index(which)] for which in states)
        if len(set(names)) < len(names):
            raise ArgumentError(f"record is {shown(states)}; each state once is needed")
        if not duration / checks.MOST <= every <= duration:
            raise ArgumentError(
                f"record_every is {every}; at most the duration {duration}, and {checks.MOST} records, please"
            )
        return cls(names, every)

    def columns(self, scene: Scene, records: np.ndarray) -> dict[str, np.ndarray]:
        """Records (B, S, R), less the start, by state and time: "recorded_block.x_0.5"."""
        names = [scene.state_names[scene.state_index(which)] for which in self.states]
        return {
            f"{RECORDED}{name}_{n * self.every:.9g}": records[:, n, j]
            for j, name in enumerate(names)
            for n in range(records.shape[1])
        }


NOT_RECORDED = Recorded()


class Case:
    """The worlds of one case under one policy.

    Attributes:
        chunk: worlds of a launch.
        conditions: what all of them go through, as kernels take it.
        records: (S, R) of a world.
    """

    def __init__(
        self,
        sim: Simulator,
        policy: Any,
        draws: Draws | Given,
        step_size: float,
        duration: float,
        *,
        worlds: int,
        seed: int = 0,
        chunk: int | None = None,
        measures: Sequence[Measure] = (),
        limits: Any = None,
        failure: Measure | None = None,
        cost: Any = None,
        record: Recorded = NOT_RECORDED,
    ) -> None:
        self.sim, self.draws = sim, draws
        policy = at_step_size(policy, step_size)
        asked = checks.attribute(policy, "worlds") if draws.numbered else None  # by number, not by place
        asked = asked if isinstance(asked, int) and asked > 1 else draws.most or worlds
        self.policy = policy if acts_on_host(policy) else policy_arrays(policy, sim, asked)
        self._timed = policy if isinstance(checks.attribute(policy, "step_size"), float) else None
        self.records = record.count(duration), len(record.states)
        self.roll_out = _road(sim, policy)
        fit = worlds_at_once(sim, self.records, len(measures), draws.numbers)
        self.chunk = chunk or min(worlds, fit)
        self.conditions = _conditions(sim, draws.disturbances, limits, record)
        self.conditions.seed, self.conditions.duration, self.conditions.world0 = seed, duration, 0
        self.conditions.step = step_size
        cost = (
            None if cost is None or not priced(measures) else cost.in_steps_of(step_size, sim.scene.step_size)
        )
        self._counted = counted_in_steps(draws.disturbances)
        if cost is not None and cost.follows_steps(sim.nx, sim.nu):
            self._counted.append("the cost that is measured")
        senses = senses_of(policy) if acts_on_host(policy) else {}
        self.table = MeasureTable(measures, sim.scene, failure, cost, tuple(senses.values()))

    @property
    def kernel(self) -> wp.Kernel | None:
        """The one kernel that runs its worlds; None where there are several."""
        if self.roll_out is not at_once:
            return None
        return sweep_kernel(self.sim, self.policy[0], self.table, spans=False)

    def launch(self, world0: int, count: int, told: wp.array | None = None) -> dict[str, np.ndarray]:
        """Worlds world0, ...: records (B, S, R), measures (B, M); (B,) status, what was drawn, how deep rows
        overlap at the start, and when the step began that was not solved, infinite: none.

        `told`: see `Written`, filled with what steps begin from.
        """
        worlds = self.draws.worlds(world0, count)
        begun = placed(self.sim, self.draws.disturbances, worlds)
        records: wp.array = wp.zeros((count, *self.records), dtype=wp.float32, device=self.sim.device)
        self.conditions.world0 = world0
        policy = self.policy
        if self._timed is not None or self._counted:  # no world makes steps of another size
            self._check_sizes(np.ravel(read_columns(worlds.params, [STEP_SIZE])))
        if not isinstance(policy, tuple):
            policy = OnHost(self.sim, policy, self.conditions, begun)
        written = Written(records, nothing_noted(self.sim, count), told)
        whole = told is not None and self.roll_out is handed_on  # fast kernels tell nothing
        roll_out: Any = at_once if whole else self.roll_out
        kept, status = roll_out(self.sim, policy, self.conditions, self.table, begun, written)
        seen = written.noted.numpy()
        found = {
            "records": records.numpy().copy(),
            "measures": self.table.values(kept.numpy()),
            "status": status.numpy().copy(),
            "start_overlap": seen[:, OVERLAP].copy(),
            "unsolved_time": seen[:, STOPPED].copy(),
        }
        return found | self.draws.columns(worlds, world0)

    def _check_sizes(self, sizes: np.ndarray) -> None:
        """Raise ArgumentError for step sizes of worlds that a plan, or what is counted in steps, has not."""
        if self._timed is not None:
            at_step_size(self._timed, sizes)
        step = self.conditions.step
        if self._counted and not np.allclose(sizes, step, rtol=1e-6, atol=0.0):
            raise ArgumentError(
                f"{' and '.join(self._counted)} count in steps of {step:g} s; the worlds make steps of "
                f"{sizes.min():g} to {sizes.max():g} s (step_size is drawn, or given by world), and one for "
                "all is needed: one after the other by step_sizes="
            )


def _road(sim: Simulator, policy: Any) -> Any:
    """How a case's worlds run."""
    if acts_on_host(policy):
        return by_periods
    return handed_on if sim.kernels.fast_path else at_once


def worlds_at_once(sim: Simulator, records: tuple[int, int], measures: int, events: int = 0) -> int:
    """Worlds of a launch of `CHUNK_BYTES` or a share of a GPU's memory, with so many records, measures and
    events each.
    """
    room = CHUNK_BYTES
    if sim.device.is_cuda:
        room = max(room, sim.device.total_memory // CHUNK_SHARE)
    kept = 4 * records[0] * records[1] + 48 * measures
    per_world = 8 * (sim.params.layout.width + sim.nx + events) + kept + 16
    return max(1, room // per_world)


def at_once(
    sim: Simulator,
    policy: tuple[PolicyKernel, Any],
    conditions: Any,
    table: MeasureTable,
    worlds: Worlds,
    written: Written,
) -> tuple[wp.array, wp.array]:
    """Run a chunk of worlds to the end in one launch.

    Args:
        sim: whose steps they make.
        policy: its kernel, and its struct.
        conditions: struct of what all worlds go through.
        table: of what is measured.
        worlds: on the simulator's device.
        written: filled where there is something.

    Returns:
        What is kept of the measures (B, M, WIDTH), and status (B,).
    """
    count, (policy_kernel, struct) = len(worlds), policy
    kept = table.kept(count, sim.device)
    status: wp.array = wp.zeros(count, dtype=wp.int32, device=sim.device)
    events, measured = events_of(sim, worlds, written), table.struct(sim)
    inputs = [conditions, events, worlds.params, worlds.x0, struct, measured, make_span(sim.dtype)()]
    RunWorlds(sim, policy_kernel, table, [*inputs, written.records, kept, written.noted, status], 1)()
    return kept, status


def nothing_noted(sim: Simulator, worlds: int) -> wp.array:
    """Of worlds that begin, (B, NOTED)."""
    rows = np.tile(np.where(np.arange(NOTED) == STOPPED, np.inf, np.nan), (worlds, 1))
    return wp.array(rows, dtype=wp.float64, device=sim.device)


def _conditions(sim: Simulator, disturbances: Disturbances, limits: Any, record: Recorded) -> Any:
    """What all worlds go through, as the kernels take it; limits of the controls: (lower, upper) or None."""
    out, d = make_conditions(sim.dtype)(), disturbances
    none = np.zeros((1, 0))
    lower, upper = (none, none) if limits is None else limit_rows(limits, sim.nu)
    out.lower, out.upper = (wp.array(a[0], dtype=sim.dtype, device=sim.device) for a in (lower, upper))
    places = [sim.scene.state_index(which) for which in record.states]
    out.recorded = wp.array(np.array(places, np.int32), dtype=wp.int32, device=sim.device)
    out.interval = record.every
    out.torque, out.dropped = d.torque, d.dropped
    out.kick_times = wp.array(np.array(d.kick_times, float), dtype=wp.float64, device=sim.device)
    if d.pushes:
        put_pushes(sim, out, d.pushes)
    return out
