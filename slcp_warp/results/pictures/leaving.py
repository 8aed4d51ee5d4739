"""By which side a corner of a rectangle leaves another rectangle that both overlap, as in (M62)."""

from collections.abc import Callable

import numpy as np

from ...description.kinematics import across

MOST, PASSED, BESIDE = 1.5, 1e-9, 1e-6  # see `kernels.contact.aside`; of a normal that is a side's

Reach = Callable[[np.ndarray], np.ndarray]  # how far a shape reaches (T,) along directions (T, 2)


def leaving(
    angles: tuple[np.ndarray, np.ndarray],
    apart: np.ndarray,
    block: Reach,
    whole: Reach,
    corner: Reach,
    first: bool,
    normal: np.ndarray,
) -> np.ndarray:
    """Normals (T, 2) of a block A at a corner of a rectangle B, by their distance `normal` (T, 2) or, where
    they overlap, those by which B leaves as a whole.

    Args:
        angles: of A and B, (T,) each.
        apart: (T, 2) from A's centre to B's.
        block, whole, corner: how far A, B and B's corner reach from the centres of A, B and B.
        first: whether A comes first.
    """
    sides = [np.stack([np.cos(angle), np.sin(angle)], -1) for angle in angles]
    ways, moves, pasts = [], [], []
    for axis in (sides[0], across(sides[0]), sides[1], across(sides[1])):
        way = (apart * axis).sum(-1)
        back = (way < 0.0) | ((way == 0.0) & (not first))
        n = np.where(back[:, None], -axis, axis)
        far = (apart * n).sum(-1)
        ways.append(n)
        moves.append(block(n) + whole(-n) - far)
        pasts.append(np.maximum(block(n) - whole(n) - far, whole(-n) - block(-n) - far))
    rows = np.arange(len(normal))
    least = np.argmin(moves, axis=0)
    chosen = np.stack(ways)[least, rows]
    near = np.abs([(way * chosen).sum(-1) for way in ways[:2]])
    side = np.where((near[0] >= near[1])[:, None], ways[0], ways[1])
    gap = (apart * normal).sum(-1) - block(normal) - corner(-normal)
    deep = block(side) + corner(-side) - (apart * side).sum(-1)
    along = np.abs([(axis * normal).sum(-1) for axis in (sides[0], across(sides[0]))])
    moved = (gap < 0.0) & (along.max(0) > 1.0 - BESIDE) & (np.array(pasts)[least, rows] <= PASSED)
    moved &= deep <= MOST * np.array(moves)[least, rows]
    return np.where(moved[:, None], side, normal)
