"""Tables with a row a world: their layout by device, copies on their device whatever strides and types.

On a GPU neighbouring threads are neighbouring worlds: a table of every world's own numbers lies there column
by column, so that a warp reads a column in few transactions; rows would be 32 of them. On a CPU a world's row
is in one place. Kernels index both alike, by strides.
"""

from typing import Any

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


def by_columns(rows: int, device: Any) -> bool:
    """Whether a table lies column by column."""
    return rows > 1 and not wp.get_device(device).is_cpu


def empty_table(shape: tuple[int, ...], dtype: type, device: Any) -> wp.array:
    """A table of zeros (rows, width)."""
    rows, width = shape
    if by_columns(rows, device):
        return wp.zeros((width, rows), dtype=dtype, device=device).transpose()
    return wp.zeros((rows, width), dtype=dtype, device=device)


def make_table(values: Any, dtype: type, device: Any, requires_grad: bool = False) -> wp.array:
    """A table of numbers, a NumPy array (rows, width); its gradient, where required, in the same layout."""
    kind = {"dtype": dtype, "device": device, "requires_grad": requires_grad}
    if by_columns(len(values), device):
        return wp.array(values.T.copy(), **kind).transpose()
    return wp.array(values, **kind)


def copy_table(table: wp.array) -> wp.array:
    """A copy in the layout of its device."""
    out = empty_table(table.shape, table.dtype, table.device)
    wp.copy(out, table)
    return out


def laid_out(table: wp.array) -> wp.array:
    """A table by rows in the layout of its device: itself, or a copy of its numbers."""
    return copy_table(table) if by_columns(table.shape[0], table.device) else table
