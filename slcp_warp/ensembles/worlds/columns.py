"""Columns of tables with a row a world, as NumPy arrays."""

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
import warp as wp

from ...description.names import END


def read_columns(table: wp.array, places: Sequence[int] | np.ndarray) -> list[np.ndarray]:
    """Columns (rows,) of a table (rows, width), or of one whose further axes count as one; views on a CPU.

    No more than these come from a GPU.
    """
    if table.ndim == 2:
        return [table[:, int(place)].numpy() for place in places]
    rows = table.numpy().reshape(table.shape[0], -1)
    return [rows[:, place] for place in places]


def told_once(
    names: Sequence[str], places: Sequence[int], alike: Callable[[list[int]], bool]
) -> list[tuple[str, int]]:
    """Some columns with the names that they are told by: those of all ends and corners of the same shapes
    that hold the same numbers are told once, by the shapes' names.

    Args:
        names: of all columns.
        places: which of them are told.
        alike: whether columns hold the same numbers.
    """
    plain = [_without_ends(name) for name in names]
    counts = Counter(plain)
    by: dict[str, list[int]] = {}
    for place in places:
        by.setdefault(plain[place], []).append(place)
    out: list[tuple[str, int]] = []
    for name, own in by.items():
        if len(own) == counts[name] and alike(own):
            out.append((name, own[0]))
        else:
            out += [(names[place], place) for place in own]
    return out


def _without_ends(name: str) -> str:
    """The name of a part's number without the ends of its shapes, "left/box.friction" of all its corners."""
    part, dot, number = name.rpartition(".")
    return END.sub("", part) + dot + number
