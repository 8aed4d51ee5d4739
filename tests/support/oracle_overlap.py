"""By which side a rectangle leaves another that it overlaps, from the places of all corners."""

import numpy as np


def direction(angle):
    """Unit vector (..., 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], -1)


def leaving(oracle, q, k, angle, gap):
    """The angle (...) of pair k of two rectangles, where they overlap and its corner is beside a side of
    the other, as a whole: the normal of the side by which the corner's rectangle leaves with the least
    motion, if that frees the corner with no more than 1.5 times as much.
    """
    pair = oracle.structure.pairs[k]
    shapes = (pair.shape_b, pair.shape_a) if pair.end_a else (pair.shape_a, pair.shape_b)
    end = pair.end_a or pair.end_b
    (ca, ta), (cb, _) = (oracle.shape_pose(q, shape) for shape in shapes)
    turn = [oracle.shape_pose(q, shape)[1] for shape in shapes]
    corners = [np.stack([oracle.shape_pose(q, shape, e)[0] for e in (2, 3, 4, 5)]) for shape in shapes]
    round_ = [oracle.p["corner_radius"][..., shape] for shape in shapes]

    def reach(way, points, radius):  # how far discs at points (n, ..., 2) reach along a direction (...)
        return np.max(np.sum(direction(way) * points, -1), 0) + radius

    found = []  # motion of the corner's rectangle, the angle of that motion, and by what one passes the other
    for axis in (turn[0], turn[0] + np.pi / 2, turn[1], turn[1] + np.pi / 2):
        apart = np.sum(direction(axis) * (cb - ca), -1)
        way = axis + np.where((apart < 0.0) | ((apart == 0.0) & (shapes[0] > shapes[1])), np.pi, 0.0)
        ends = [
            (reach(way, points, radius), reach(way + np.pi, points, radius))
            for points, radius in zip(corners, round_)
        ]
        past = np.maximum(ends[0][0] - ends[1][0], ends[1][1] - ends[0][1])
        found.append((ends[0][0] + ends[1][1], way, past))
    least = np.argmin([move for move, _, _ in found], 0)
    move, way, past = (np.take_along_axis(np.array(each), least[None], 0)[0] for each in zip(*found))
    sides = np.array([way for _, way, _ in found[:2]])
    near = np.argmax(np.abs(np.cos(sides - way)), 0)
    side = np.take_along_axis(sides, near[None], 0)[0]
    corner = oracle.shape_pose(q, shapes[1], end)[0]
    deep = reach(side, corners[0], round_[0]) + reach(side + np.pi, corner[None], round_[1])
    beside = np.abs(np.sin(2.0 * (angle - ta))) < 1e-6
    moved = beside & (gap < 0.0) & (deep <= 1.5 * move) & (past <= 1e-12)
    return np.where(moved, side + (np.pi if pair.end_a else 0.0), angle)
