"""How far bodies of a trajectory overlap, and how often one passes through another."""

import math
from dataclasses import dataclass

import numpy as np

from slcp_warp import Scene

from ..mechanics.scene import every_contact

SAMPLE = 0.005  # longest time between the configurations looked at [s]
DIRECTIONS = 24  # normals tried at each, before Newton's method


@dataclass(frozen=True)
class Overlap:
    """Deepest penetration of all pairs, worlds and steps [m], and the contacts passed through.

    A contact is missed when the shortest way out of an overlap turns by more than 90 degrees from one moment
    to the next: the bodies then leave on the other side. Moments are SAMPLE apart or closer, on straight
    lines between the steps.
    """

    penetration: float
    missed: int


def overlap(scene: Scene, states: np.ndarray, h: float) -> Overlap:
    """Overlaps of trajectories (B, N+1, nx) in steps of h [s]. Limits of joints are not looked at."""
    q = states[:, :, : scene.nv]
    worlds, count = q.shape[:2]
    parts = max(1, math.ceil(h / SAMPLE - 1e-9))
    between = [q[:, :-1] + k / parts * (q[:, 1:] - q[:, :-1]) for k in range(parts)]
    fine = np.concatenate([np.stack(between, 2).reshape(worlds, -1, scene.nv), q[:, -1:]], 1)
    deepest, missed = 0.0, 0
    for d, normal in every_contact(scene, fine.reshape(-1, scene.nv), DIRECTIONS):
        d, normal = d.reshape(worlds, -1), normal.reshape(worlds, -1)
        deepest = max(deepest, float(-d[:, ::parts].min(initial=0.0)))
        inside = (d[:, 1:] < 0.0) & (d[:, :-1] < 0.0)
        flipped = np.cos(np.diff(normal, axis=1)) < 0.0
        missed += int(np.count_nonzero(inside & flipped))
    assert fine.shape[1] == parts * (count - 1) + 1
    return Overlap(deepest, missed)
