"""One launch that runs a sweep's worlds, with whichever kernels step them."""

from collections.abc import Callable
from typing import Any

import warp as wp

from slcp_warp.kernels.device.launch import Prepared
from slcp_warp.kernels.device.relay import Relay
from slcp_warp.kernels.ensembles.generic_sweep import make_generic_sweep_kernel
from slcp_warp.kernels.ensembles.sweep import make_sweep_kernel
from slcp_warp.kernels.policies.contract import PolicyKernel

from ..measures.tables import MeasureTable
from ..simulator import Simulator
from ..stepping.generic import GenericKernels


def sweep_kernel(sim: Simulator, policy: PolicyKernel, table: MeasureTable, spans: bool) -> wp.Kernel:
    """The kernel of `RunWorlds`; `spans`: where the launch is one of several."""
    stepping, users = sim.kernels.stepping, table.users(sim)
    if isinstance(stepping, GenericKernels):
        return make_generic_sweep_kernel(sim.dtype, stepping.residual, sim.scene.nv, sim.nu, policy, users)
    return make_sweep_kernel(sim.spec, policy, users, spans=spans)


class RunWorlds:
    """A launch that runs worlds to the end, or through a period; called again, it goes on from there.

    Args:
        sim: whose steps they make.
        policy: of the struct in `inputs`.
        table: of what is measured.
        inputs: conditions, events, parameters, x0, and so on as `make_sweep_kernel` takes them.
        grain: worlds that are worth a thread.
        next: where the launch is one of several, (B,) step that is each world's next.
        most: steps of such a launch.
    """

    def __init__(
        self,
        sim: Simulator,
        policy: PolicyKernel,
        table: MeasureTable,
        inputs: list[Any],
        grain: int,
        next: wp.array | None = None,
        most: int = 0,
    ) -> None:
        worlds, stepping, device = len(inputs[3]), sim.kernels.stepping, sim.device
        kernel = sweep_kernel(sim, policy, table, spans=next is not None)
        if isinstance(stepping, GenericKernels):
            slots, s = min(worlds, stepping.chunk) if table.looks_inside else 0, sim.scene.structure
            sizes = *(4 * [len(s.pairs)]), len(s.tendons)
            contacts = [wp.zeros((slots, size), dtype=wp.float64, device=device) for size in sizes]
            own = wp.zeros(0, dtype=wp.int32, device=device) if next is None else next
            self._launch: Callable[[int], None] = lambda last: stepping.launch(
                kernel, worlds, [last, most, own], [*contacts, *inputs], grain
            )
            return
        relay = Relay()
        if next is not None:
            relay.next = next
        prepared = Prepared(kernel, worlds, [0, 0, most, relay, *inputs], device, grain=grain)

        def specialised(last: int) -> None:
            prepared.set_input(1, last)
            prepared()

        self._launch = specialised

    def __call__(self, last: int = 0) -> None:
        """The steps of the launch; of one of several those before `last`."""
        self._launch(last)
