"""Where pairs touch: the direction of their distance, for arrows and tables of the contact forces."""

from collections.abc import Sequence

import numpy as np

from slcp_warp.kernels.ensembles.contacts import TOUCH
from slcp_warp.kernels.structure import CORNERS, HALFPLANE, RECTANGLE, SIDED, WALLS

from ...description.kinematics import across, turn
from ..moving import MovingBodies
from .leaving import Reach, leaving
from .mechanism import Mechanism
from .motion import Motion

Part = tuple[int, int]  # a shape, and which end of it: 0, the whole shape

DIRECTIONS = 72
REFINED = 6  # times the grid is narrowed


def contact_points(
    mechanism: Mechanism, q: np.ndarray, pairs: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Where some pairs touch, (k, 2) [m], and normals from shape_a to shape_b, (k, 2), at q (nv,).

    The point is that of shape B, or of shape A where B is a wall, or a side on which A has a corner or a
    round part.
    """
    points, normals = np.zeros((len(pairs), 2)), np.zeros((len(pairs), 2))
    for i, pair in enumerate(pairs):
        _, found, normal, own = contact_ends(mechanism, q[None], pair)
        points[i], normals[i] = found[0, own], normal[0]
    return points, normals


def contact_ends(
    mechanism: Mechanism, q: np.ndarray, pair: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Distance (T,) [m] of a pair at q (T, nv), points of shape_a and shape_b (T, 2, 2) between which it is,
    normals from a to b (T, 2), and which of the two shapes has one such point alone.

    The direction n that maximises n.(c_B - c_A) - h_A(n) - h_B(-n), by a grid that narrows; h is the support
    function.
    """
    centre, angle = mechanism.shapes(q)
    structure = mechanism.scene.structure
    ends = structure.pairs[pair]
    a, b = (ends.shape_a, ends.end_a), (ends.shape_b, ends.end_b)
    wall = [part for part in (a, b) if structure.shapes[part[0]].kind in WALLS]
    if wall:
        facing = _facing(mechanism, centre, angle, wall[0], b if wall[0] == a else a)
        normal = facing if wall[0] == a else -facing
    else:
        normal = _normal(mechanism, centre, angle, a, b)
        if all(structure.shapes[part[0]].kind == RECTANGLE for part in (a, b)):
            normal = _of_wholes(mechanism, centre, angle, a, b, normal)
    own = 0 if b in wall or (_is_point(mechanism, a) and not _is_point(mechanism, b)) else 1
    parts = (a, b)
    places = [_end(mechanism, centre, angle, part, sign * normal) for part, sign in zip(parts, (1.0, -1.0))]
    gap = ((places[1] - places[0]) * normal).sum(-1)
    places[1 - own] = places[own] + (gap if own == 0 else -gap)[:, None] * normal
    return gap, np.stack(places, 1), normal, own


def _end(
    mechanism: Mechanism, centre: np.ndarray, angle: np.ndarray, part: Part, n: np.ndarray
) -> np.ndarray:
    """A point of a part that lies farthest along n (T, 2), of a wall one of its surface."""
    kind = mechanism.scene.structure.shapes[part[0]].kind
    if kind == HALFPLANE:
        return centre[:, part[0]]
    if kind in WALLS:
        return centre[:, part[0]] - mechanism.size(part[0])[0] * n
    return centre[:, part[0]] + _support(mechanism, angle, part, n)


def _is_point(mechanism: Mechanism, part: Part) -> bool:
    """Whether one point of a part alone lies farthest along every normal: it has no sides."""
    return part[1] != 0 or mechanism.scene.structure.shapes[part[0]].kind not in SIDED


def _facing(
    mechanism: Mechanism, centre: np.ndarray, angle: np.ndarray, wall: Part, other: Part
) -> np.ndarray:
    """Where a half-plane looks to, or a ring at the centre of what is in it, (T, 2)."""
    ahead = np.tile([1.0, 0.0], (len(centre), 1))
    if mechanism.scene.structure.shapes[wall[0]].kind == HALFPLANE:
        return np.asarray(turn(angle[:, wall[0]], ahead))
    both = [_support(mechanism, angle, other, sign * ahead) for sign in (1.0, -1.0)]
    inwards = centre[:, wall[0]] - centre[:, other[0]] - 0.5 * (both[0] + both[1])
    length = np.linalg.norm(inwards, axis=1, keepdims=True)
    return np.where(length > 0.0, inwards / np.where(length > 0.0, length, 1.0), -ahead)


def _normal(mechanism: Mechanism, centre: np.ndarray, angle: np.ndarray, a: Part, b: Part) -> np.ndarray:
    """The unit vectors of the largest signed distance, (T, 2)."""
    middle, width = np.zeros((len(centre), 1)), np.pi
    apart = (centre[:, b[0]] - centre[:, a[0]])[:, None]
    for _ in range(REFINED):
        angles = middle + width * np.linspace(-1.0, 1.0, DIRECTIONS)
        n = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        reach = _support(mechanism, angle, a, n) - _support(mechanism, angle, b, -n)
        best = np.argmax((n * (apart - reach)).sum(-1), axis=1)
        middle = np.take_along_axis(angles, best[:, None], 1)
        width *= 3.0 / DIRECTIONS
    return np.concatenate([np.cos(middle), np.sin(middle)], axis=1)


def _of_wholes(
    mechanism: Mechanism, centre: np.ndarray, angle: np.ndarray, a: Part, b: Part, normal: np.ndarray
) -> np.ndarray:
    """Normals (T, 2) of two rectangles, of one of which a corner counts: where they overlap (M62)."""
    block, corner, sign = (a, b, 1.0) if b[1] else (b, a, -1.0)

    def reach(part: Part) -> Reach:
        return lambda n: np.asarray((_support(mechanism, angle, part, n) * n).sum(-1))

    found = leaving(
        (angle[:, block[0]], angle[:, corner[0]]), centre[:, corner[0]] - centre[:, block[0]],
        reach(block), reach((corner[0], 0)), reach(corner), block[0] < corner[0], sign * normal,
    )  # fmt: skip
    return sign * found


def _support(mechanism: Mechanism, angle: np.ndarray, part: Part, n: np.ndarray) -> np.ndarray:
    """grad h(n): the point of a shape furthest along n (T, ..., 2), or of the disc at its end, from its
    centre.
    """
    s, end = part
    kind, size = mechanism.scene.structure.shapes[s].kind, mechanism.size(s)
    turned = np.broadcast_to(angle[:, s].reshape(-1, *(1,) * (n.ndim - 2)), n.shape[:-1])
    local = turn(-turned, n)
    if kind in SIDED:
        core = size[:2] - size[2] if kind == "rectangle" else np.array([size[1], 0.0])
        sign = np.array(CORNERS[end] if end in CORNERS else (end, end)) if end else np.sign(local)
        point = (size[2] if kind == "rectangle" else size[0]) * local + sign * core
    else:
        scaled = size * local
        length = np.linalg.norm(scaled, axis=-1, keepdims=True)
        point = size * scaled / np.where(length > 0.0, length, 1.0)
    return turn(turned, point)


def forces(normals: np.ndarray, impulse: np.ndarray, step_size: float) -> np.ndarray:
    """(k, 2) forces on shape_b [N], of impulses (k, 2) along normal and tangent [N s]."""
    return (impulse[:, :1] * normals + impulse[:, 1:] * across(normals)) / step_size


def contact_table(motion: Motion, impulse: np.ndarray, least: float) -> dict[str, np.ndarray]:
    """Columns with a row for every contact that presses in a step of a motion; see `Trajectory.contacts`."""
    mechanism, names = Mechanism.of(motion), np.array(motion.scene.pair_names, dtype=object)
    steps, pairs = np.nonzero(impulse[..., 0] > least)
    x, y, normal_x, normal_y = np.zeros((4, len(steps)))
    for pair in np.unique(pairs).tolist():
        own = pairs == pair
        _, points, normals, end = contact_ends(mechanism, motion.states[steps[own], : motion.scene.nv], pair)
        x[own], y[own], normal_x[own], normal_y[own] = *points[:, end].T, *normals.T
    spans = np.diff(motion.time)[steps]
    out = {"step": steps, "time": motion.time[steps], "pair": names[pairs], "x": x, "y": y}
    out |= {"normal_x": normal_x, "normal_y": normal_y}
    pushes = impulse[steps, pairs]
    return out | {"normal_force": pushes[:, 0] / spans, "tangential_force": pushes[:, 1] / spans}


def slips(motion: Motion, impulse: np.ndarray) -> np.ndarray:
    """(N, pairs) how fast pairs slide that push in a step, of their normal impulses (N, pairs); else 0.

    As `measures.slip`: the velocities after the step of both shapes' own points, where these are before it.
    """
    mechanism, scene = Mechanism.of(motion), motion.scene
    out = np.zeros(impulse.shape)
    for pair in np.flatnonzero((impulse > TOUCH).any(axis=0)).tolist():
        steps = np.flatnonzero(impulse[:, pair] > TOUCH)
        q, v = motion.states[steps, : scene.nv], motion.states[steps + 1, scene.nv :]
        _, points, normals, _ = contact_ends(mechanism, q, pair)
        bodies, ends = MovingBodies(scene.structure, motion.numbers, q, v), scene.structure.pairs[pair]
        a, b = (
            bodies.velocity(scene.structure.shapes[shape].body, points[:, i])
            for i, shape in enumerate((ends.shape_a, ends.shape_b))
        )
        run = sum(
            motion.numbers["surface_ratio"][..., i] * v[:, scene.structure.shapes[i].driver]
            for i in (ends.shape_a, ends.shape_b)
            if scene.structure.shapes[i].driver >= 0
        )
        out[steps, pair] = ((b - a) * across(normals)).sum(-1) - run
    return out
