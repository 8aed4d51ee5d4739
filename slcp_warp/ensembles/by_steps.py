"""A sweep's worlds rolled out with generic kernels: a launch a step instead of one for the whole run."""

from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.ensembles.generic_sweep import make_sweep_begin_kernel, make_sweep_end_kernels
from slcp_warp.kernels.ensembles.measures import make_row_contacts
from slcp_warp.kernels.policies.contract import PolicyKernel

from ..measures.tables import MeasureTable
from ..simulator import Simulator
from ..stepping.arrays import StepArrays
from .by_periods import OnHost, cold, progress
from .worlds import Worlds
from .worlds.events import events_of


def bytes_of_world(sim: Simulator) -> int:
    """Memory of a world beyond its parameters, start and records."""
    return 8 * (2 * sim.nx + sim.nu + 4 * sim.nr + 4 * len(sim.scene.structure.pairs)) + 32


def by_steps(
    sim: Simulator,
    policy: tuple[PolicyKernel, Any] | OnHost,
    conditions: Any,
    table: MeasureTable,
    worlds: Worlds,
    records: wp.array,
) -> tuple[wp.array, wp.array]:
    """As `launch.at_once`."""
    params, state, events = worlds.params, wp.clone(worlds.x0), events_of(sim, worlds)
    count, width = len(state), sim.nr + 2 * len(sim.scene.structure.pairs)
    dtype, device = sim.dtype, sim.device
    after, us = sim.empty(count, sim.nx), sim.empty(count, max(sim.nu, 1))
    impulse, gap = sim.empty(count, sim.nr), sim.empty(count, sim.nr)
    warm, multiplier = cold(sim, count), sim.empty(count, width)
    code: wp.array = wp.zeros(count, dtype=wp.int32, device=device)
    kept, measures = table.kept(count, device), table.struct(sim)
    p = progress(conditions, params, records)
    host = policy if isinstance(policy, OnHost) else None
    policy_kernel, struct = (policy.kernel, policy.struct) if isinstance(policy, OnHost) else policy
    memory = sim.empty(count, policy_kernel.functions(sim.nx, sim.nu, dtype).memory)
    step = StepArrays(params, state, us, events.external, warm, after, impulse, gap, multiplier, code)
    begin = make_sweep_begin_kernel(sim.scene.nv, sim.nu, dtype, policy_kernel)
    kernels = make_sweep_end_kernels(sim.scene.nv, sim.nu, dtype, table.users(sim))
    contacts = make_row_contacts(dtype).Contacts()
    contacts.rows = wp.array(normal_rows(sim), dtype=wp.int32, device=device)
    contacts.impulse, contacts.distance, contacts.multiplier = impulse, gap, multiplier
    for k in range(int(p.steps.numpy().max(initial=0))):
        if host is not None:
            host.ask(k, events, p, state)
        launch(begin, count, [k, conditions, events, params, worlds.x0, struct, p, state, us, memory], device)
        sim.kernels.stepping.step(step)
        outcome = [params, after, us, contacts, code, measures, p, state, warm, kept]
        launch(kernels.end, count, [k, *outcome], device)
    launch(kernels.finish, count, [conditions, worlds.x0, state, p], device)
    return kept, p.status


def normal_rows(sim: Simulator) -> np.ndarray:
    """(pairs, 2): first row of a pair's normal impulses, and one after the last."""
    rows = [(i, row) for i, row in enumerate(sim.scene.structure.rows) if row.kind == "contact"]
    tangents = sim.options.friction == "coulomb"
    normal = [(i, row) for i, row in rows if not (tangents and row.sign < 0)]
    count = len(sim.scene.structure.pairs)
    own = [[i for i, row in normal if row.index == pair] for pair in range(count)]
    return np.array([(each[0], each[-1] + 1) for each in own], np.int32).reshape(-1, 2)
