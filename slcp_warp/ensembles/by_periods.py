"""A sweep's worlds in several launches: by periods of a policy, or handed on between specialised kernels."""

import functools
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.contact.problem import COLD
from slcp_warp.kernels.device.launch import Prepared
from slcp_warp.kernels.device.relay import Run
from slcp_warp.kernels.ensembles.arrival import Progress, make_arrival, make_span
from slcp_warp.kernels.ensembles.asking import make_sweep_ask_kernel
from slcp_warp.kernels.ensembles.sweep import make_sweep_kernel
from slcp_warp.kernels.policies.contract import PolicyKernel
from slcp_warp.kernels.policies.held import HELD, make_held
from slcp_warp.kernels.structure import STEP_SIZE

from ..measures.tables import MeasureTable
from ..simulator import Simulator
from ..stepping.host import Asked
from .run_worlds import RunWorlds
from .worlds import Worlds
from .worlds.between import HostBetween
from .worlds.columns import read_columns
from .worlds.events import Written, events_of


class OnHost:
    """A policy on the host in one chunk of a sweep.

    Attributes:
        held: its last controls.
        kernel, struct: the policy that holds them, as the sweep's kernels ask it.
        every: steps between two questions.
    """

    def __init__(self, sim: Simulator, policy: Any, conditions: Any, worlds: Worlds) -> None:
        numbers = conditions.world0 + np.arange(len(worlds))
        if worlds.numbers is not None:
            numbers = worlds.numbers.numpy().copy()
        (h,) = read_columns(worlds.params, [STEP_SIZE])
        self._asked, self._worlds, self._sim = Asked(policy, sim, numbers, h), worlds, sim
        most = int(conditions.duration / conditions.step) + 1  # steps: a longer period is one that never ends
        self.every, self.held = min(self._asked.every, most), Held(sim, len(worlds))
        self._between = policy if isinstance(policy, HostBetween) else None
        around = self.held if self._between is None else self._between.around(self.held)
        if self._between is not None and self._between.hold % self.every == 0:
            self.every = self._between.hold  # what it says in between reaches no world
        self.kernel, self.struct = around.kernel(sim)

    def sensor(self, next: wp.array, state: wp.array) -> tuple[Prepared | None, wp.array]:
        """A launch that shows states before the step that is each world's next, and where; None: the states
        themselves.
        """
        numbers = self._worlds.numbers
        if numbers is None:
            numbers = wp.array(self._asked.worlds, dtype=wp.int32, device=self._sim.device)
        if self._between is None:
            return None, state
        return self._between.sensor(self._sim, next, numbers, state)

    def ask(self, k: int, running: "Running") -> None:
        """Controls of step k, where they are due."""
        if k % self.every == 0 and self._asked.nu:
            felt = running.felt() if self._asked.senses else None
            self.held.us.assign(self._asked.controls(k, running.meet().numpy(), felt))


class Held:
    """The controls (B, nu) that a policy on the host gave last, as a policy that kernels ask."""

    def __init__(self, sim: Simulator, worlds: int) -> None:
        self.us = sim.empty(worlds, max(sim.nu, 1))

    def kernel(self, sim: Simulator) -> tuple[PolicyKernel, Any]:
        """Kernel and struct for a simulator."""
        struct = make_held(sim.nx, sim.nu, sim.dtype).Struct()
        struct.us = self.us
        return HELD, struct


class Running:
    """Worlds under a policy on the host, between two launches.

    Attributes:
        kept: of the measures (B, M, WIDTH).
        span: what worlds carry over.
        next: (B,) step of each.
    """

    def __init__(
        self,
        sim: Simulator,
        policy: OnHost,
        conditions: Any,
        table: MeasureTable,
        worlds: Worlds,
        written: Written,
    ) -> None:
        self._sim, self._policy, self._conditions, self._worlds = sim, policy, conditions, worlds
        self.kept, self.events = table.kept(len(worlds), sim.device), events_of(sim, worlds, written)
        self.span = span_of(sim, policy.kernel, conditions, worlds, wp.clone(worlds.x0), written.records)
        self.next: wp.array = wp.zeros(len(worlds), dtype=wp.int32, device=sim.device)
        self._table, self._written = table, written

    @functools.cached_property
    def _run(self) -> RunWorlds:
        """The launch that makes their steps; made, and compiled, when the first one is."""
        policy, sim, own, written = self._policy, self._sim, self._worlds, self._written
        inputs = [self._conditions, self.events, own.params, own.x0, policy.struct, self._table.struct(sim)]
        inputs += [self.span, written.records, self.kept, written.noted, self.span.p.status]
        grain = max(1, 128 // policy.every)
        return RunWorlds(sim, policy.kernel, self._table, inputs, grain, self.next, policy.every)

    @functools.cached_property
    def _meeting(self) -> tuple[list[Prepared], wp.array]:
        """The launches that show a policy the states, and where."""
        sim, own, span = self._sim, self._worlds, self.span
        inputs = [self.next, self._conditions, self.events, own.params, own.x0, span.p, span.state]
        arrival = make_arrival(sim.scene.nv, sim.nu, sim.dtype).kernel
        sensor, shown = self._policy.sensor(self.next, span.state)
        arrive = Prepared(arrival, len(own), inputs, sim.device)
        return [arrive] if sensor is None else [arrive, sensor], shown

    def meet(self) -> wp.array:
        """The states (B, nx) as a policy meets them before each world's next step: after kicks, through the
        task's sensor.
        """
        launches, shown = self._meeting
        for each in launches:
            each()
        return shown

    def felt(self) -> np.ndarray:
        """(B, F) what is felt in the step that was made last, NaN before the first."""
        return self._table.felt(self.kept.numpy())

    def go(self, last: int) -> None:
        """The steps between two questions to the policy, of those before `last`."""
        self._run(last)


def by_periods(
    sim: Simulator,
    policy: OnHost,
    conditions: Any,
    table: MeasureTable,
    worlds: Worlds,
    written: Written,
) -> tuple[wp.array, wp.array]:
    """As `launch.at_once`."""
    running = Running(sim, policy, conditions, table, worlds, written)
    steps = int(running.span.p.steps.numpy().max(initial=0))
    for k in range(0, steps, policy.every):
        policy.ask(k, running)
        running.go(k + policy.every)
    return running.kept, running.span.p.status


def handed_on(
    sim: Simulator,
    policy: tuple[PolicyKernel, Any],
    conditions: Any,
    table: MeasureTable,
    worlds: Worlds,
    written: Written,
) -> tuple[wp.array, wp.array]:
    """As `launch.at_once`, in launches of the fast kernel and of the one that makes the steps it leaves.

    A policy that is asked apart is asked before every step, by a launch of its own.
    """
    count, state, events = len(worlds), wp.clone(worlds.x0), events_of(sim, worlds, written)
    asked, apart = policy, policy[0].apart
    if apart:
        held = Held(sim, count)
        asked = held.kernel(sim)
    kernel, struct = asked
    span = span_of(sim, kernel, conditions, worlds, state, written.records)
    numbers = [conditions, events, worlds.params, worlds.x0]
    before = None
    if apart:
        size = policy[0].functions(sim.nx, sim.nu, sim.dtype).memory
        inputs = [0, *numbers, policy[1], span.p, state, held.us, sim.empty(count, size)]
        begin = make_sweep_ask_kernel(sim.scene.nv, sim.nu, sim.dtype, policy[0])
        ask = Prepared(begin, count, inputs, sim.device)

        def before(k: int) -> None:
            ask.set_input(0, k)
            ask()

    kept, users = table.kept(count, sim.device), table.users(sim)
    both = sim.kernels.specialised("a sweep").both
    assert both is not None
    fast, full = (make_sweep_kernel(spec, kernel, users, spans=True) for spec in both)
    steps = int(span.p.steps.numpy().max(initial=0))
    inputs = [*numbers, struct, table.struct(sim), span, written.records, kept]
    inputs += [written.noted, span.p.status]
    Run(fast, full, count, steps, inputs, sim.device, 1, 1 if apart else None, before)()
    return kept, span.p.status


def span_of(
    sim: Simulator, policy: PolicyKernel, conditions: Any, worlds: Worlds, state: wp.array, records: wp.array
) -> Any:
    """What worlds that begin carry over from launch to launch; `state` (B, nx) where they stand."""
    out = make_span(sim.dtype)()
    out.p = progress(conditions, worlds.params, records)
    out.state, out.warm = state, cold(sim, len(worlds))
    out.memory = sim.empty(len(worlds), policy.functions(sim.nx, sim.nu, sim.dtype).memory)
    return out


def cold(sim: Simulator, worlds: int) -> wp.array:
    """Multipliers (B, nr + 2 pairs) before the first step."""
    width = sim.nr + 2 * len(sim.scene.structure.pairs)
    rows = np.tile(np.where(np.arange(width) < sim.nr, COLD, 0.0), (worlds, 1))
    return wp.array(rows, dtype=sim.dtype, device=sim.device)


def progress(conditions: Any, params: wp.array, records: wp.array) -> Progress:
    """Worlds that begin."""
    p, worlds, device = Progress(), len(params), params.device
    (h,) = read_columns(params, [STEP_SIZE])
    seconds = np.where(h == h.dtype.type(conditions.step), conditions.step, h.astype(float))
    steps = np.floor(conditions.duration / seconds + 0.5)
    for name in ("record", "event", "status"):
        setattr(p, name, wp.zeros(worlds, dtype=wp.int32, device=device))
    p.steps = wp.array(steps.astype(np.int32), dtype=wp.int32, device=device)
    p.records = records
    return p
