"""Sums over worlds, in a fixed order."""

import warp as wp

from ..factories import cached
from .compile import specialised


@cached
def make_sum_kernel(dtype: type) -> wp.Kernel:
    """One item a column: total[0 or b, j] += sum over worlds, or each world's own, of part[b, j]."""

    @specialised
    def sum_kernel(
        first: int,
        part: wp.array2d(dtype=dtype),  # (B, width)
        total: wp.array2d(dtype=dtype),  # accumulated (1 or B, width)
    ):
        column = first + wp.tid()
        value = dtype(0.0)
        for world in range(part.shape[0]):
            if total.shape[0] == 1:
                value += part[world, column]
            else:
                total[world, column] = total[world, column] + part[world, column]
        if total.shape[0] == 1:
            total[0, column] = total[0, column] + value

    return sum_kernel
