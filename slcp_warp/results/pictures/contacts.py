"""Where pairs touch: the direction of their distance, for arrows and tables of the contact forces."""

from collections.abc import Sequence

import numpy as np

from slcp_warp.kernels.structure import CORNERS, HALFPLANE, SIDED, WALLS

from ...description.kinematics import across, turn
from .mechanism import Mechanism
from .motion import Motion

Part = tuple[int, int]  # a shape, and which end of it: 0, the whole shape

DIRECTIONS = 72
REFINED = 6  # times the grid is narrowed


def contact_points(
    mechanism: Mechanism, q: np.ndarray, pairs: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Where some pairs touch, (k, 2) [m], and normals from shape_a to shape_b, (k, 2), at q (nv,).

    The direction n that maximises n.(c_B - c_A) - h_A(n) - h_B(-n), by a grid that narrows; h is the support
    function. The point is that of shape B, or of shape A where B is a wall, or a side on which A has a corner
    or a round part.
    """
    centre, angle = mechanism.shapes(q[None])
    structure = mechanism.scene.structure
    points, normals = np.zeros((len(pairs), 2)), np.zeros((len(pairs), 2))
    for i, pair in enumerate(structure.pairs[k] for k in pairs):
        a, b = (pair.shape_a, pair.end_a), (pair.shape_b, pair.end_b)
        wall = [part for part in (a, b) if structure.shapes[part[0]].kind in WALLS]
        if wall:
            facing = _facing(mechanism, centre[0], angle[0], wall[0], b if wall[0] == a else a)
            normal = facing if wall[0] == a else -facing
        else:
            normal = _normal(mechanism, centre[0], angle[0], a, b)
        touching = a if b in wall or (_is_point(mechanism, a) and not _is_point(mechanism, b)) else b
        along = normal if touching == a else -normal
        points[i] = centre[0, touching[0]] + _support(mechanism, angle[0], touching, along[None])[0]
        normals[i] = normal
    return points, normals


def _is_point(mechanism: Mechanism, part: Part) -> bool:
    """Whether one point of a part alone lies farthest along every normal: it has no sides."""
    return part[1] != 0 or mechanism.scene.structure.shapes[part[0]].kind not in SIDED


def _facing(
    mechanism: Mechanism, centre: np.ndarray, angle: np.ndarray, wall: Part, other: Part
) -> np.ndarray:
    """Where a half-plane looks to, or a ring at the centre of what is in it."""
    ahead = np.array([1.0, 0.0])
    if mechanism.scene.structure.shapes[wall[0]].kind == HALFPLANE:
        return np.asarray(turn(angle[wall[0]], ahead))
    both = _support(mechanism, angle, other, np.stack([ahead, -ahead]))
    inwards = centre[wall[0]] - centre[other[0]] - both.mean(axis=0)
    length = float(np.linalg.norm(inwards))
    return inwards / length if length > 0.0 else -ahead


def _normal(mechanism: Mechanism, centre: np.ndarray, angle: np.ndarray, a: Part, b: Part) -> np.ndarray:
    """The unit vector of the largest signed distance."""
    middle, width = 0.0, np.pi
    for _ in range(REFINED):
        angles = middle + width * np.linspace(-1.0, 1.0, DIRECTIONS)
        n = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        reach = (n * _support(mechanism, angle, a, n)).sum(1) - (n * _support(mechanism, angle, b, -n)).sum(1)
        middle = angles[np.argmax(n @ (centre[b[0]] - centre[a[0]]) - reach)]
        width *= 3.0 / DIRECTIONS
    return np.array([np.cos(middle), np.sin(middle)])


def _support(mechanism: Mechanism, angle: np.ndarray, part: Part, n: np.ndarray) -> np.ndarray:
    """grad h(n): the point of a shape furthest along n (k, 2), or of the disc at its end, from its centre."""
    s, end = part
    kind, size = mechanism.scene.structure.shapes[s].kind, mechanism.size(s)
    local = turn(np.full(len(n), -angle[s]), n)
    if kind in SIDED:
        core = size[:2] - size[2] if kind == "rectangle" else np.array([size[1], 0.0])
        sign = np.array(CORNERS[end] if end in CORNERS else (end, end)) if end else np.sign(local)
        point = (size[2] if kind == "rectangle" else size[0]) * local + sign * core
    else:
        scaled = size * local
        length = np.linalg.norm(scaled, axis=1, keepdims=True)
        point = size * scaled / np.where(length > 0.0, length, 1.0)
    return turn(np.full(len(n), angle[s]), point)


def forces(normals: np.ndarray, impulse: np.ndarray, step_size: float) -> np.ndarray:
    """(k, 2) forces on shape_b [N], of impulses (k, 2) along normal and tangent [N s]."""
    return (impulse[:, :1] * normals + impulse[:, 1:] * across(normals)) / step_size


def contact_table(motion: Motion, impulse: np.ndarray, least: float) -> dict[str, np.ndarray]:
    """Columns with a row for every contact that presses in a step of a motion; see `Trajectory.contacts`."""
    mechanism, names = Mechanism.of(motion), np.array(motion.scene.pair_names, dtype=object)
    steps, pairs = np.nonzero(impulse[..., 0] > least)
    places = [np.zeros((0, 4))]
    for step in np.unique(steps):
        own = pairs[steps == step].tolist()
        found = contact_points(mechanism, motion.states[step, : motion.scene.nv], own)
        places.append(np.concatenate(found, axis=1))
    x, y, normal_x, normal_y = np.concatenate(places).T
    spans = np.diff(motion.time)[steps]
    out = {"step": steps, "time": motion.time[steps], "pair": names[pairs], "x": x, "y": y}
    out |= {"normal_x": normal_x, "normal_y": normal_y}
    pushes = impulse[steps, pairs]
    return out | {"normal_force": pushes[:, 0] / spans, "tangential_force": pushes[:, 1] / spans}
