"""Columns of tables with a row a world, as NumPy arrays."""

from collections.abc import Sequence

import numpy as np
import warp as wp


def read_columns(table: wp.array, places: Sequence[int] | np.ndarray) -> list[np.ndarray]:
    """Columns (rows,) of a table (rows, width), or of one whose further axes count as one; views on a CPU.

    No more than these come from a GPU.
    """
    if table.ndim == 2:
        return [table[:, int(place)].numpy() for place in places]
    rows = table.numpy().reshape(table.shape[0], -1)
    return [rows[:, place] for place in places]
