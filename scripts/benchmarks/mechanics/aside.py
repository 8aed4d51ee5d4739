"""By which side a rectangle leaves another one that it overlaps, from the corners of both cores."""

from typing import NamedTuple

import numpy as np

from slcp_warp.description.kinematics import across, turn

Array = np.ndarray
MOST = 1.5  # times the motion that frees the whole: as far as it may free a corner
PASSED = 1e-12  # [m] by which one may reach beyond the other: a rounding
SIGNS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], float)


class Block(NamedTuple):
    """A rectangle of every world: centre (B, 2), angle (B,), half sizes of its core (B, 2), corner radius."""

    at: Array
    angle: Array
    half: Array
    corner: Array

    def corners(self) -> Array:
        """Of its core (4, B, 2)."""
        return np.stack([self.at + turn(self.angle, sign * self.half) for sign in SIGNS])

    def reach(self, way: Array) -> Array:
        """How far it reaches (B,) along directions (B, 2)."""
        return np.max(np.sum(self.corners() * way, -1), 0) + self.corner


def leave(a: Block, b: Block, corner: Array, n: Array, gap: Array, first: bool) -> tuple[Array, Array, Array]:
    """Normal (B, 2) and distance (B,) of a corner of B (its centre, (B, 2)) from A, by its own normal n and
    gap; and by how much the choice is the better one (B,).

    Args:
        first: whether A goes to its own left or down where both are in one place.
    """
    unit = np.stack([np.cos(a.angle), np.sin(a.angle)], -1)
    other = np.stack([np.cos(b.angle), np.sin(b.angle)], -1)
    ways, moves, pasts = [], [], []
    for axis in (unit, across(unit), other, across(other)):
        apart = np.sum((b.at - a.at) * axis, -1)
        back = (apart < 0.0) | ((apart == 0.0) & (not first))
        way = np.where(back[:, None], -axis, axis)
        ways.append(way)
        moves.append(a.reach(way) + b.reach(-way))
        pasts.append(np.maximum(a.reach(way) - b.reach(way), b.reach(-way) - a.reach(-way)))
    move, order = np.array(moves), np.argsort(moves, axis=0, kind="stable")
    least = np.take_along_axis(move, order[:1], 0)[0]
    past = np.take_along_axis(np.array(pasts), order[:1], 0)[0]
    chosen = np.stack(ways)[order[0], np.arange(len(gap))]
    near = np.abs(np.stack([np.sum(way * chosen, -1) for way in ways[:2]]))
    side = np.where((near[0] >= near[1])[:, None], ways[0], ways[1])
    deep = a.reach(side) - (np.sum(corner * side, -1) - b.corner)
    beside = np.max(np.abs(np.stack([np.sum(n * axis, -1) for axis in (unit, across(unit))])), 0) > 1.0 - 1e-9
    there = beside & (gap < 0.0)
    moved = there & (deep <= MOST * least) & (past <= PASSED)
    doubt = np.minimum(np.abs(deep - MOST * least), np.abs(near[0] - near[1]) * least)
    doubt = np.minimum(doubt, np.where(past == 0.0, np.inf, np.abs(past - PASSED)))
    second = np.take_along_axis(move, order[1:2], 0)[0] - least
    same = np.abs(np.sum(np.stack(ways)[order[1], np.arange(len(gap))] * chosen, -1)) > 0.999
    doubt = np.minimum(doubt, np.where(same, np.inf, second))
    margin = np.where(there, doubt, np.inf)
    return np.where(moved[:, None], side, n), np.where(moved, -deep, gap), margin
