"""Controls that are given step by step, for all worlds or for each; the last ones are held."""

import warp as wp

from ..factories import cached
from .contract import PolicyFunctions, PolicyKernel


@cached
def make_sequence(nx: int, nu: int, dtype: type) -> PolicyFunctions:
    """u = us_k of one sequence per world, or of one for all; beyond its end that of its last step."""
    VX, VU = wp.types.vector(nx, dtype), wp.types.vector(max(nu, 1), dtype)

    @wp.struct
    class Sequence:
        us: wp.array3d(dtype=dtype)  # (1 or B, N, nu)

    @wp.func
    def control(policy: Sequence, world: int, k: int, x: VX):
        row = wp.where(policy.us.shape[0] == 1, 0, world)
        at = wp.min(k, policy.us.shape[1] - 1)
        u = VU()
        for i in range(wp.static(nu)):
            u[i] = policy.us[row, at, i]
        return u

    return PolicyFunctions(Sequence, control)


SEQUENCE = PolicyKernel("sequence", make_sequence)
