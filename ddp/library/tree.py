"""The tree of boxes in which kernels find the nearest of many points."""

from typing import Any, NamedTuple

import numpy as np
import warp as wp

from slcp_warp.kernels.policies.tree import WIDTH, groups_of
from slcp_warp.simulator import Simulator


class Boxes(NamedTuple):
    """What `kernels/policies/tree.py` searches.

    Attributes:
        low, high: corners of the boxes of G groups, (G, n, WIDTH); +-inf where there is no child.
        leaves: places of the points, (P, WIDTH); a leaf with fewer has its first one again.
    """

    low: np.ndarray
    high: np.ndarray
    leaves: np.ndarray


def boxes_of(points: np.ndarray) -> Boxes:
    """The tree of points (T, n): leaves as full as that goes, ranges split where they are widest."""
    count = -(-len(points) // WIDTH)
    groups = groups_of(count)
    nodes = groups + count
    leaves = np.ones(nodes, dtype=int)  # below every node
    for n in reversed(range(groups)):
        leaves[n] = leaves[WIDTH * n + 1 : WIDTH * n + WIDTH + 1].sum()
    rows: dict[int, np.ndarray] = {0: np.arange(len(points))}
    low = np.full((groups, points.shape[1], WIDTH), np.inf)
    high = -low
    for n in range(groups):
        children = np.arange(WIDTH * n + 1, min(WIDTH * n + WIDTH + 1, nodes))
        _share(points, rows.pop(n), children, leaves, rows)
        for i, child in enumerate(children):
            inside = points[rows[int(child)]]
            low[n, :, i], high[n, :, i] = inside.min(axis=0), inside.max(axis=0)
    last = [np.sort(rows[n]) for n in range(groups, nodes)]
    return Boxes(low, high, np.stack([np.append(r, np.full(WIDTH - len(r), r[0])) for r in last]))


def _share(
    points: np.ndarray, rows: np.ndarray, children: np.ndarray, leaves: np.ndarray, out: dict[int, np.ndarray]
) -> None:
    """Give the rows to children, in halves, as many as they have leaves for."""
    if len(children) == 1:
        out[int(children[0])] = rows
        return
    half = len(children) // 2
    cut = len(rows) * leaves[children[:half]].sum() // leaves[children].sum()
    dimension = int(np.argmax(np.ptp(points[rows], axis=0)))
    rows = rows[np.argsort(points[rows, dimension], kind="stable")]
    _share(points, rows[:cut], children[:half], leaves, out)
    _share(points, rows[cut:], children[half:], leaves, out)


def put_tree(sim: Simulator, struct: Any, points: np.ndarray, entry: np.ndarray) -> None:
    """A tree of points (T, n) of entries (T,) into a kernel's struct."""
    low, high, leaves = boxes_of(points.astype(wp.dtype_to_numpy(sim.dtype)))
    inside = points[leaves].transpose(0, 2, 1)
    kind = wp.types.vector(WIDTH, sim.dtype)
    for name, values in (("boxes", np.concatenate([low, high], axis=1)), ("points", inside)):
        numbers = np.ascontiguousarray(values, wp.dtype_to_numpy(sim.dtype))
        setattr(struct, name, wp.array(numbers, dtype=kind, device=sim.device))
    struct.entry = wp.array(entry[leaves], dtype=wp.int32, device=sim.device)
