"""A policy asked once in every world, with Warp's adjoint: derivatives of what a user wrote."""

import warp as wp

from ..device.compile import with_adjoint
from ..factories import cached
from .contract import PolicyKernel


@cached
def make_asked_kernel(policy: PolicyKernel, nx: int, nu: int, dtype: type) -> wp.Kernel:
    """Controls of step k, and with memory what is remembered then; every number is written once."""
    functions = policy.functions(nx, nu, dtype)
    Policy, control, size = functions.Struct, functions.control, functions.memory
    VX, Memory = wp.types.vector(nx, dtype), wp.types.vector(max(size, 1), dtype)

    @with_adjoint
    def asked_kernel(
        k: int,
        policy: Policy,
        state: wp.array2d(dtype=dtype),  # (B, nx)
        memories: wp.array2d(dtype=dtype),  # (B, memory of the policy)
        us: wp.array2d(dtype=dtype),  # out (B, nu)
        after: wp.array2d(dtype=dtype),  # out (B, memory of the policy)
    ):
        i = wp.tid()
        x = VX()
        for j in range(nx):
            x[j] = state[i, j]
        if wp.static(size > 0):
            memory = Memory()
            for j in range(size):
                memory[j] = memories[i, j]
            u, kept = control(policy, i, k, x, memory)
            for j in range(size):
                after[i, j] = kept[j]
        else:
            u = control(policy, i, k, x)
        for j in range(nu):
            us[i, j] = u[j]

    return asked_kernel


@cached
def make_begun_kernel(policy: PolicyKernel, nx: int, nu: int, dtype: type) -> wp.Kernel:
    """What a policy with a start remembers before the first step."""
    functions = policy.functions(nx, nu, dtype)
    Policy, start, size = functions.Struct, functions.start, functions.memory
    VX = wp.types.vector(nx, dtype)

    @with_adjoint
    def begun_kernel(
        policy: Policy,
        state: wp.array2d(dtype=dtype),  # (B, nx)
        memories: wp.array2d(dtype=dtype),  # out (B, memory of the policy)
    ):
        i = wp.tid()
        x = VX()
        for j in range(nx):
            x[j] = state[i, j]
        memory = start(policy, i, x)
        for j in range(size):
            memories[i, j] = memory[j]

    return begun_kernel
