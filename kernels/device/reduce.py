"""Sums over worlds, by strips in a fixed order: the same bits on any number of threads, of any device.

Strips of `STRIP` rows are added up by items of their own, then strips of these sums, and so on: neighbouring
items take neighbouring columns, and the rounding grows with the number of levels instead of that of rows.
"""

import warp as wp

from ..factories import cached
from .compile import specialised
from .launch import launch

STRIP = 256  # rows that one item adds up
MOST = 2**31 - 1  # items of a launch


@cached
def make_sum_kernel(dtype: type) -> wp.Kernel:
    """One item a strip and a column: total[strip, j] += sum over the strip's rows of part[b, j]."""

    @specialised
    def sum_kernel(
        first: int,
        part: wp.array2d(dtype=dtype),  # (B, width)
        length: int,  # rows of a strip; the last may be shorter
        total: wp.array2d(dtype=dtype),  # accumulated (strips, width)
    ):
        item = first + wp.tid()
        strip = item // part.shape[1]
        column = item % part.shape[1]
        value = dtype(0.0)
        for world in range(strip * length, wp.min((strip + 1) * length, part.shape[0])):
            value += part[world, column]
        total[strip, column] = total[strip, column] + value

    return sum_kernel


def add_rows(part: wp.array, total: wp.array) -> None:
    """total (1, width) += the sum over worlds of part (B, width); total (B, width) += each world's own."""
    kernel, width = make_sum_kernel(part.dtype), part.shape[1]
    if total.shape[0] == part.shape[0]:
        rows = max(1, MOST // max(1, width))
        for first in range(0, part.shape[0], rows):
            last = min(first + rows, part.shape[0])
            some, sums = part[first:last], total[first:last]
            launch(kernel, some.shape[0] * width, [some, 1, sums], part.device)
        return
    while part.shape[0] > STRIP:
        strips = -(-part.shape[0] // STRIP)
        sums = wp.zeros((strips, width), dtype=part.dtype, device=part.device)
        launch(kernel, strips * width, [part, STRIP, sums], part.device, grain=2)
        part = sums
    launch(kernel, width, [part, STRIP, total], part.device)
