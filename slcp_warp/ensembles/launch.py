"""The launches of one case of a sweep, chunk after chunk, and what they left."""

import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.ensembles.arrival import make_span
from slcp_warp.kernels.ensembles.disturbances import make_conditions
from slcp_warp.kernels.ensembles.sweep import make_sweep_kernel
from slcp_warp.kernels.policies.contract import PolicyKernel
from slcp_warp.kernels.structure import STEP_SIZE

from ..inputs import checks
from ..inputs.errors import ArgumentError
from ..inputs.limits import limit_rows
from ..measures import Measure, contact_share, lowest_gap
from ..measures.tables import MeasureTable
from ..simulator import Simulator
from ..stepping.arguments import at_step_size, policy_arrays
from ..stepping.host import acts_on_host
from ..tasks.disturbances import Disturbances
from .by_periods import OnHost, by_periods
from .by_steps import by_steps, bytes_of_world
from .spec import SweepSpec
from .worlds import Worlds
from .worlds.draws import Draws, Given, draws_of_spec
from .worlds.events import events_of, put_pushes

CHUNK_BYTES = 128 * 2**20
NOWHERE = 1e30  # lowest gap of a world without an acting contact


class Case:
    """One (residual, step size) of a sweep.

    Attributes:
        chunk: worlds of a launch.
        count: samples of a world.
        seconds: spent in launches so far.
    """

    def __init__(
        self,
        sim: Simulator,
        policy: Any,
        spec: SweepSpec,
        step_size: float,
        chunk: int | None,
        measures: Sequence[Measure] = (),
        draws: Draws | Given | None = None,
        limits: Any = None,
        failure: Measure | None = None,
        cost: Any = None,
    ) -> None:
        self.sim, self.spec, self.step_size = sim, spec, step_size
        self.draws = draws_of_spec(sim, spec, step_size) if draws is None else draws
        policy = at_step_size(policy, step_size)
        self.policy = policy if acts_on_host(policy) else policy_arrays(policy, sim, spec.worlds)
        self._timed = policy if isinstance(checks.attribute(policy, "step_size"), float) else None
        if not 0 <= spec.observe < sim.nx:
            raise ArgumentError(
                f"SweepSpec.observe is {spec.observe}; a state component 0..{sim.nx - 1} is needed"
            )
        self.count = int(round(spec.duration / spec.sample_every)) + 1
        generic = sim.strategy == "generic"
        self.roll_out: Any = by_steps if generic else by_periods if acts_on_host(policy) else at_once
        fit = worlds_at_once(sim, self.count, len(measures), self.draws.numbers)
        self.chunk = chunk or min(spec.worlds, fit)
        self.seconds = 0.0
        self._parts: list[dict[str, np.ndarray]] = []
        self._conditions = _conditions(sim, spec, self.draws.disturbances, limits)
        self.table = MeasureTable([contact_share(), lowest_gap(), *measures], sim.scene, failure, cost)

    def run(self) -> Iterator[int]:
        """Launch chunk after chunk; yields the worlds finished."""
        kept = "SweepSpec.duration / sample_every: the samples"
        checks.memory(kept, self.spec.worlds * self.count, 4, self.sim.device)
        for world0 in range(0, self.spec.worlds, self.chunk):
            count = min(self.chunk, self.spec.worlds - world0)
            began = time.perf_counter()
            self._parts.append(self.launch(world0, count))
            self.seconds += time.perf_counter() - began
            yield count

    def launch(self, world0: int, count: int) -> dict[str, np.ndarray]:
        """One chunk of worlds."""
        worlds = self.draws.worlds(world0, count)
        samples: wp.array = wp.zeros((count, self.count), dtype=wp.float32, device=self.sim.device)
        self._conditions.world0 = world0
        policy = self.policy
        if self._timed is not None:  # a plan: no world makes steps of another size
            at_step_size(self._timed, worlds.params.numpy()[:, STEP_SIZE])
        if not isinstance(policy, tuple):
            policy = OnHost(self.sim, policy, self._conditions, worlds)
        kept, status = self.roll_out(self.sim, policy, self._conditions, self.table, worlds, samples)
        share, lowest, *values = self.table.values(kept.numpy()).T
        found = {
            "samples": samples.numpy().copy(),
            "contact_share": share.astype(np.float32),
            "lowest_gap": np.minimum(lowest, NOWHERE).astype(np.float32),
            "status": status.numpy().copy(),
            "measures": np.array(values).reshape(-1, count).T,
        }
        return found | self.draws.columns(worlds, world0)

    def finished(self) -> dict[str, np.ndarray]:
        """Columns of the finished worlds: samples (B, S), measures (B, M), contact_share, lowest_gap, status,
        what was drawn (B,); nothing before the first chunk is through.
        """
        if not self._parts:
            return {}
        return {name: np.concatenate([part[name] for part in self._parts]) for name in self._parts[0]}


def worlds_at_once(sim: Simulator, samples: int, measures: int, events: int = 0) -> int:
    """Worlds whose launch stays within `CHUNK_BYTES`, with so many samples, measures and events each."""
    own = bytes_of_world(sim) if sim.strategy == "generic" else 0
    per_world = 8 * (sim.params.layout.width + sim.nx + events) + 4 * samples + 16 + own + 48 * measures
    return max(1, CHUNK_BYTES // per_world)


def at_once(
    sim: Simulator,
    policy: tuple[PolicyKernel, Any],
    conditions: Any,
    table: MeasureTable,
    worlds: Worlds,
    samples: wp.array,
) -> tuple[wp.array, wp.array]:
    """Run a chunk of worlds to the end in one launch of the specialised kernel.

    Args:
        sim: whose steps they make.
        policy: its kernel, and its struct.
        conditions: struct of what all worlds go through.
        table: of what is measured.
        worlds: on the simulator's device.
        samples: (B, S), filled.

    Returns:
        What is kept of the measures (B, M, WIDTH), and status (B,).
    """
    count, (policy_kernel, struct) = len(worlds), policy
    kept = table.kept(count, sim.device)
    status: wp.array = wp.zeros(count, dtype=wp.int32, device=sim.device)
    kernel = make_sweep_kernel(sim.spec, policy_kernel, table.users(sim))
    events, measured = events_of(sim, worlds), table.struct(sim)
    inputs = [conditions, events, worlds.params, worlds.x0, struct, measured, make_span(sim.dtype)()]
    inputs += [samples, kept, status]
    launch(kernel, count, inputs, sim.device, grain=1)
    return kept, status


def _conditions(sim: Simulator, spec: SweepSpec, disturbances: Disturbances, limits: Any) -> Any:
    """What all worlds go through, as the kernels take it; limits of the controls: (lower, upper) or None."""
    out, d = make_conditions(sim.dtype)(), disturbances
    none = np.zeros((1, 0))
    lower, upper = (none, none) if limits is None else limit_rows(limits, sim.nu)
    out.lower, out.upper = (wp.array(a[0], dtype=sim.dtype, device=sim.device) for a in (lower, upper))
    out.seed, out.component = spec.seed, spec.observe
    out.torque, out.dropped = d.torque, d.dropped
    out.kick_times = wp.array(np.array(d.kick_times, float), dtype=wp.float64, device=sim.device)
    out.duration, out.interval = spec.duration, spec.sample_every
    if d.pushes:
        put_pushes(sim, out, d.pushes)
    return out
