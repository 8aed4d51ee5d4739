"""Tables with a row a world, copied on their device whatever their strides and types."""

import warp as wp

from ..factories import cached
from .compile import specialised
from .launch import launch


@cached
def make_copy_kernel(source: type, target: type) -> wp.Kernel:
    """One item a row: kept[i, j] = given[i, j]."""

    @specialised
    def copy_kernel(first: int, given: wp.array2d(dtype=source), kept: wp.array2d(dtype=target)):
        i = first + wp.tid()
        for j in range(given.shape[1]):
            kept[i, j] = target(given[i, j])

    return copy_kernel


def copy_rows(given: wp.array, kept: wp.array) -> None:
    """Copy (B, width) to (B, width), of any types and strides.

    Where an array has gaps a graph of a CPU does not record `wp.copy`, and where types differ it would be a
    way over the host.
    """
    if given.is_contiguous and kept.is_contiguous and given.dtype is kept.dtype:
        wp.copy(kept, given)
        return
    launch(make_copy_kernel(given.dtype, kept.dtype), kept.shape[0], [given, kept], kept.device)
