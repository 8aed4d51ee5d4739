"""One launch that runs a sweep's worlds, with whichever kernels step them."""

from typing import Any, NamedTuple

import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.device.relay import Relay
from slcp_warp.kernels.ensembles.generic_sweep import make_generic_sweep_kernel
from slcp_warp.kernels.ensembles.sweep import make_sweep_kernel
from slcp_warp.kernels.policies.contract import PolicyKernel

from ..measures.tables import MeasureTable
from ..simulator import Simulator
from ..stepping.generic import GenericKernels


class Period(NamedTuple):
    """The steps of one launch of several: from each world's `next` (B,) on, so many, before `last`."""

    last: int
    most: int
    next: wp.array


def sweep_kernel(sim: Simulator, policy: PolicyKernel, table: MeasureTable, spans: bool) -> wp.Kernel:
    """The kernel of `run_worlds`; `spans`: where the launch is one of several."""
    stepping, users = sim.kernels.stepping, table.users(sim)
    if isinstance(stepping, GenericKernels):
        return make_generic_sweep_kernel(sim.dtype, stepping.residual, sim.scene.nv, sim.nu, policy, users)
    return make_sweep_kernel(sim.spec, policy, users, spans=spans)


def run_worlds(
    sim: Simulator,
    policy: PolicyKernel,
    table: MeasureTable,
    inputs: list[Any],
    grain: int,
    period: Period | None = None,
) -> None:
    """Run worlds to the end, or through a period.

    Args:
        sim: whose steps they make.
        policy: of the struct in `inputs`.
        table: of what is measured.
        inputs: conditions, events, parameters, x0, and so on as `make_sweep_kernel` takes them.
        grain: worlds that are worth a thread.
        period: where the launch is one of several.
    """
    worlds, stepping = len(inputs[3]), sim.kernels.stepping
    last, most = (0, 0) if period is None else period[:2]
    kernel = sweep_kernel(sim, policy, table, spans=period is not None)
    if isinstance(stepping, GenericKernels):
        slots = min(worlds, stepping.chunk) if table.looks_at_contacts else 0
        shape = slots, len(sim.scene.structure.pairs)
        contacts = [wp.zeros(shape, dtype=wp.float64, device=sim.device) for _ in range(2)]
        next: wp.array = wp.zeros(0, dtype=wp.int32, device=sim.device) if period is None else period.next
        stepping.launch(kernel, worlds, [last, most, next], [*contacts, *inputs], grain)
        return
    relay = Relay()
    if period is not None:
        relay.next = period.next
    launch(kernel, worlds, [0, last, most, relay, *inputs], sim.device, grain=grain)
