"""Controls that are given, one sequence a world."""

import warp as wp

from ..factories import cached
from .contract import PolicyFunctions, PolicyKernel


@cached
def make_open_loop(nx: int, nu: int, dtype: type) -> PolicyFunctions:
    """Controls (B, N, nu), one sequence per world."""
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(max(nu, 1), dtype)

    @wp.struct
    class OpenLoop:
        us: wp.array3d(dtype=dtype)

    @wp.func
    def control(policy: OpenLoop, world: int, k: int, x: VX):
        u = VU()
        for i in range(wp.static(nu)):
            u[i] = policy.us[world, k, i]
        return u

    return PolicyFunctions(OpenLoop, control)


OPEN_LOOP = PolicyKernel("open_loop", make_open_loop)
