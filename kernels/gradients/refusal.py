"""What a loss asks of outputs through which no gradient flows: numbers that are none, and a flag."""

import warp as wp

from ..device.compile import specialised
from ..factories import cached


@cached
def make_refusal_kernel(dtype: type) -> wp.Kernel:
    """One item a world: where a gradient by an output without derivatives is not zero, the world's gradient
    by its last state becomes NaN, which reaches all gradients before it, and the output's flag is set.
    """

    @wp.func
    def asks(by: wp.array2d(dtype=dtype), world: int):
        found = int(0)
        if by.shape[0] > 0:
            for j in range(by.shape[1]):
                if by[world, j] != dtype(0.0):  # true of NaN, too
                    found = 1
        return found

    @specialised
    def refusal_kernel(
        first: int,
        by_impulse: wp.array2d(dtype=dtype),  # (0 or B, n)
        by_gap: wp.array2d(dtype=dtype),  # (0 or B, n)
        slopes: wp.array2d(dtype=dtype),  # by the last state (B, nx)
        flags: wp.array(dtype=wp.int32),  # (2,) of impulses, of gaps
    ):
        world = first + wp.tid()
        impulse = asks(by_impulse, world)
        gap = asks(by_gap, world)
        if impulse == 1:
            flags[0] = 1
        if gap == 1:
            flags[1] = 1
        if impulse + gap > 0:
            for j in range(slopes.shape[1]):
                slopes[world, j] = dtype(wp.NAN)

    return refusal_kernel
