"""A policy asked once in every world, for what steps in launches of single steps."""

import warp as wp

from ..device.compile import specialised
from ..factories import cached
from ..status import SOLVED
from .contract import PolicyKernel, make_policy


@cached
def make_ask_kernel(policy: PolicyKernel, nx: int, nu: int, dtype: type) -> wp.Kernel:
    """Controls of step k of all worlds that are still solved; `fresh` 1: it is the first of them."""
    asked = make_policy(policy, nx, nu, dtype)
    Policy = asked.Struct
    VX = wp.types.vector(nx, dtype)

    @specialised
    def ask_kernel(
        first: int,
        k: int,
        fresh: int,
        control: Policy,
        numbers: wp.array(dtype=wp.int32),  # (B,) of the worlds
        state: wp.array2d(dtype=dtype),  # (B, nx)
        status: wp.array(dtype=wp.int32),  # (B,)
        memories: wp.array2d(dtype=dtype),  # in and out (B, memory of the policy)
        us: wp.array2d(dtype=dtype),  # out (B, nu)
    ):
        i = first + wp.tid()
        if status[i] != wp.static(SOLVED):
            return
        x = VX()
        for j in range(nx):
            x[j] = state[i, j]
        memory = asked.recall(control, memories, i, numbers[i], wp.where(fresh == 1, 0, k), x)
        u, memory = asked.ask(control, numbers[i], k, x, memory)
        asked.keep(memories, i, memory)
        for j in range(nu):
            us[i, j] = u[j]

    return ask_kernel
