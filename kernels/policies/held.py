"""Controls that the host sets between launches, held in between."""

import warp as wp

from ..factories import cached
from .contract import PolicyFunctions, PolicyKernel


@cached
def make_held(nx: int, nu: int, dtype: type) -> PolicyFunctions:
    """Controls (B, nu) of the worlds of a launch, whatever the step and the state."""
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(max(nu, 1), dtype)

    @wp.struct
    class Held:
        us: wp.array2d(dtype=dtype)

    @wp.func
    def control(policy: Held, world: int, k: int, x: VX):
        u = VU()
        for i in range(wp.static(nu)):
            u[i] = policy.us[world, i]
        return u

    return PolicyFunctions(Held, control)


HELD = PolicyKernel("held", make_held, by_row=True)
