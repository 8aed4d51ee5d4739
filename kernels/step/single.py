"""What follows each step of a rollout that is made in launches of single steps."""

import warp as wp

from ..device.compile import specialised
from ..factories import cached
from ..status import SOLVED


@cached
def make_settle_kernel(dtype: type) -> wp.Kernel:
    """After step k: the new state and what is recorded, or the status of a world that stays where it is."""

    @specialised
    def settle_kernel(
        first: int,
        k: int,
        us: wp.array2d(dtype=dtype),  # (B, nu)
        after: wp.array2d(dtype=dtype),  # (B, nx) of the step
        pushed: wp.array2d(dtype=dtype),  # (B, nr)
        apart: wp.array2d(dtype=dtype),  # (B, nr)
        multiplier: wp.array2d(dtype=dtype),  # (B, nr + 2 pairs)
        code: wp.array(dtype=wp.int32),  # (B,)
        state: wp.array2d(dtype=dtype),  # in and out (B, nx)
        warm: wp.array2d(dtype=dtype),  # out (B, nr + 2 pairs)
        states: wp.array3d(dtype=dtype),  # out (B, N+1, nx)
        controls: wp.array3d(dtype=dtype),  # out (0 or B, N, nu)
        impulse: wp.array3d(dtype=dtype),  # out (0 or B, N, nr)
        gap: wp.array3d(dtype=dtype),  # out (0 or B, N, nr)
        status: wp.array(dtype=wp.int32),  # in and out (B,)
    ):
        i = first + wp.tid()
        if status[i] == wp.static(SOLVED):
            status[i] = code[i]
            if code[i] == wp.static(SOLVED):
                for j in range(state.shape[1]):
                    state[i, j] = after[i, j]
                for j in range(warm.shape[1]):
                    warm[i, j] = multiplier[i, j]
                if controls.shape[0] > 0:
                    for j in range(controls.shape[2]):
                        controls[i, k, j] = us[i, j]
                if impulse.shape[0] > 0:
                    for j in range(pushed.shape[1]):
                        impulse[i, k, j] = pushed[i, j]
                if gap.shape[0] > 0:
                    for j in range(apart.shape[1]):
                        gap[i, k, j] = apart[i, j]
        for j in range(state.shape[1]):
            states[i, k + 1, j] = state[i, j]

    return settle_kernel
