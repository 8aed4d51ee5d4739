"""A sweep's policy asked in a launch of its own, before the step that takes its controls."""

import warp as wp

from ..device.compile import specialised
from ..factories import cached
from ..policies.contract import PolicyKernel, make_policy
from ..status import SOLVED
from .arrival import Progress, make_arrival
from .disturbances import make_conditions, make_disturbances, make_events


@cached
def make_sweep_ask_kernel(nv: int, nu: int, dtype: type, policy: PolicyKernel) -> wp.Kernel:
    """Before step k: records, kicks, and the controls as the policy gives them."""
    asked = make_policy(policy, 2 * nv, nu, dtype)
    disturb, arrive = make_disturbances(nv, nu, dtype), make_arrival(nv, nu, dtype).arrive
    Conditions, Events, Policy = make_conditions(dtype), make_events(dtype), asked.Struct

    @specialised
    def sweep_ask_kernel(
        first: int,
        k: int,
        c: Conditions,
        e: Events,
        params: wp.array2d(dtype=dtype),  # (B, P)
        x0: wp.array2d(dtype=dtype),  # (B, nx)
        control: Policy,
        p: Progress,
        state: wp.array2d(dtype=dtype),  # in and out (B, nx)
        us: wp.array2d(dtype=dtype),  # out (B, nu)
        memories: wp.array2d(dtype=dtype),  # in and out (B, memory of the policy)
    ):
        i = first + wp.tid()
        who = wp.where(wp.static(policy.by_row), i, disturb.number(c, e, i))
        if k >= p.steps[i]:
            return
        if wp.static(policy.timed):
            control = asked.of_row(control, e.timing, i, c.step)
        x = arrive(c, e, params, x0, p, i, k, state)
        if p.status[i] == wp.static(SOLVED):
            memory = asked.recall(control, memories, i, who, k, x)
            u, memory = asked.ask(control, who, k, x, memory)
            for j in range(nu):
                us[i, j] = u[j]
            asked.keep(memories, i, memory)

    return sweep_ask_kernel
