"""What weighs second derivatives that a backward pass finds weighed: V_x, known before it.

V_x of the last pass: about this trajectory where its line search found nothing, else about the one before,
which is that of this one as far as these are alike, to rounding where passes end. Where there is none since
the trajectory was started, costates, (M56): c_N = l_x of the final cost, c_k = l_x + f_x' c_{k+1}, which are
V_x where Q_u = 0. To go on with costates (stagewise Newton) takes 2.7 times the passes (docs/decisions.md).
Gaps of multiple shooting are in neither.
"""

import warp as wp

from ...device.compile import named_by_code
from ...factories import cached
from ..solver_state import SolverState, make_derivative_arrays, make_policy_arrays


@cached
def make_weight_kernel(nx, dtype):
    """Kernel ``(first, Derivatives, Policy, SolverState, asked, weights)`` over problems: of those that go on
    or have moved, which are `asked`.
    """
    Derivatives, Policy = make_derivative_arrays(dtype), make_policy_arrays(dtype)

    @named_by_code(max_unroll=1)
    def weights(
        first: int,
        d: Derivatives,
        policy: Policy,
        state: SolverState,
        asked: wp.array(dtype=wp.int32),  # out (B,)
        out: wp.array3d(dtype=dtype),  # (B, N+1, nx)
    ):
        b = first + wp.tid()
        asked[b] = wp.max(state.active[b], state.fresh[b])
        if asked[b] == 0:
            return
        last = out.shape[1] - 1
        for back in range(last + 1):
            k = last - back
            for i in range(nx):
                total = policy.Vx[b, k, i]
                if state.valued[b] == 0:
                    total = d.lx[b, k, i]
                    if k < last:
                        for j in range(nx):
                            total += d.fx[b, k, j, i] * out[b, k + 1, j]
                out[b, k, i] = total

    return weights
