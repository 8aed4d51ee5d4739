"""A scene's own numbers at given configurations: benchmarks choose states by them, peers are held to them."""

from collections.abc import Iterable, Iterator

import numpy as np

from slcp_warp import Scene
from slcp_warp.description.kinematics import Array

from .contact import DIRECTIONS, place, touch
from .tree import Mechanics

CHUNK = 1 << 14  # configurations whose distances are searched at once
CONCENTRIC = 1e-12  # distance of the centres of discs that have no normal [m]


def mass_matrix(scene: Scene, q: Array) -> Array:
    """M (B, nv, nv) at q (B, nv)."""
    return Mechanics(scene, {}).motion(q, np.zeros(q.shape)).mass


def contact(scene: Scene, q: Array, pair: int = 0, directions: int = DIRECTIONS) -> tuple[Array, Array]:
    """Signed distance (B,) of a pair and the angle (B,) of its normal, which points from A to B.

    The angle is 0 where discs are concentric.

    Args:
        scene: the scene.
        q: configurations (B, nv).
        pair: index of the pair.
        directions: normals that are tried before the best are refined.
    """
    (found,) = every_contact(scene, q, directions, (pair,))
    return found


def every_contact(
    scene: Scene, q: Array, directions: int = DIRECTIONS, pairs: Iterable[int] | None = None
) -> Iterator[tuple[Array, Array]]:
    """What `contact` gives, of one pair after the other; all of the scene's if none are named."""
    mechanics, chosen = Mechanics(scene, {}), range(len(scene.structure.pairs)) if pairs is None else pairs
    frames = [mechanics.frames(q[first : first + CHUNK]) for first in range(0, len(q), CHUNK)]
    for row in (scene.structure.pairs[k] for k in chosen):
        gaps, angles = [np.zeros(0)], [np.zeros(0)]
        for part in frames:
            a = place(mechanics, part, row.shape_a, row.end_a)
            b = place(mechanics, part, row.shape_b, row.end_b)
            normal, gap, _, _, _, turning = touch(a, b, directions)
            gaps.append(gap)
            angles.append(np.where(turning < CONCENTRIC, 0.0, np.arctan2(normal[:, 1], normal[:, 0])))
        yield np.concatenate(gaps), np.concatenate(angles)


def distance(scene: Scene, q: Array, pair: int = 0) -> Array:
    """Signed distance (B,) of a pair."""
    return contact(scene, q, pair)[0]
