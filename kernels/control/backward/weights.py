"""What weighs second derivatives that a backward pass finds weighed: V_x, known before it.

V_x of the last pass, about the trajectory before: it is that of this one as far as these are alike, to
rounding where passes end. Before the first pass costates, (M56): c_N = l_x of the final cost, c_k = l_x +
f_x' c_{k+1}, which are V_x where Q_u = 0. To go on with costates (stagewise Newton) takes 2.7 times the
passes (docs/decisions.md).
"""

import warp as wp

from ...device.compile import named_by_code
from ...factories import cached
from ..solver_state import make_derivative_arrays, make_policy_arrays


@cached
def make_weight_kernel(nx, dtype):
    """Kernel ``(first, Derivatives, Policy, passes, active, weights)`` over problems."""
    Derivatives, Policy = make_derivative_arrays(dtype), make_policy_arrays(dtype)

    @named_by_code(max_unroll=1)
    def weights(
        first: int,
        d: Derivatives,
        policy: Policy,
        passes: wp.array(dtype=wp.int32),
        active: wp.array(dtype=wp.int32),
        out: wp.array3d(dtype=dtype),  # (B, N+1, nx)
    ):
        b = first + wp.tid()
        if active[b] == 0:
            return
        last = out.shape[1] - 1
        for back in range(last + 1):
            k = last - back
            for i in range(nx):
                total = policy.Vx[b, k, i]
                if passes[b] == 0:
                    total = d.lx[b, k, i]
                    if k < last:
                        for j in range(nx):
                            total += d.fx[b, k, j, i] * out[b, k + 1, j]
                out[b, k, i] = total

    return weights
