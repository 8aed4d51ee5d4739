"""Kinematics, mass matrix and signed distances of a scene, in plain NumPy.

They are written apart from the kernels on purpose: benchmarks choose their states by them, and they are the
numbers that a peer's model is compared with. Signed distance: d = max over unit n of
n.(c_B - c_A) - h_A(n) - h_B(-n), h the support function, as in `kernels.shapes`.
"""

import math
from dataclasses import dataclass

import numpy as np

from slcp_warp import Scene, SceneError, Shape

Radii = tuple[float, float]
DIRECTIONS = 128  # normals tried by the distance search; the best is refined by Newton's method


def frames(scene: Scene, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angle (B, nb) and joint position (B, nb, 2) of every body at q (B, nv)."""
    bodies = scene.structure.bodies
    angle = np.zeros((len(q), len(bodies)))
    origin = np.zeros((len(q), len(bodies), 2))
    for b, (body, tree) in enumerate(zip(scene.bodies, bodies)):
        shift = np.broadcast_to(np.array(body.anchor, float), (len(q), 2))
        angle[:, b] = body.angle
        if tree.joint == "prismatic":
            shift = shift + q[:, tree.dofs[0], None] * np.array(body.axis, float)
        else:
            angle[:, b] += q[:, tree.dofs[-1]]
        if tree.joint == "free":
            shift = shift + q[:, list(tree.dofs[:2])]
        origin[:, b] = shift
        if tree.parent >= 0:
            angle[:, b] += angle[:, tree.parent]
            origin[:, b] = origin[:, tree.parent] + turned(shift, angle[:, tree.parent])
    return angle, origin


def turned(vector: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """A vector (2,), or one for each angle (B, 2), turned by the angles (B,): (B, 2)."""
    c, s, x, y = np.cos(angle), np.sin(angle), vector[..., 0], vector[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)


def mass_matrix(scene: Scene, q: np.ndarray) -> np.ndarray:
    """M = sum over bodies of m J_c' J_c + I J_w' J_w, (B, nv, nv)."""
    angle, origin = frames(scene, q)
    bodies = scene.structure.bodies
    total = np.zeros((len(q), scene.nv, scene.nv))
    for b, body in enumerate(scene.bodies):
        centre = origin[:, b] + turned(np.array(body.com), angle[:, b])
        jac = np.zeros((len(q), 3, scene.nv))  # rows: x, y, angle
        j = b
        while j >= 0:
            parent = bodies[j].parent
            base = angle[:, parent] if parent >= 0 else np.zeros(len(q))
            if bodies[j].joint == "prismatic":
                jac[:, :2, bodies[j].dofs[0]] = turned(np.array(scene.bodies[j].axis), base)
            else:
                arm, last = centre - origin[:, j], bodies[j].dofs[-1]
                jac[:, 0, last], jac[:, 1, last], jac[:, 2, last] = -arm[:, 1], arm[:, 0], 1.0
            if bodies[j].joint == "free":
                for k, axis in enumerate(np.eye(2)):
                    jac[:, :2, bodies[j].dofs[k]] = turned(axis, base)
            j = parent
        weight = np.array([body.mass, body.mass, body.inertia])
        total += np.einsum("bki,k,bkj->bij", jac, weight, jac)
    return total


@dataclass(frozen=True)
class Placed:
    """A shape at B configurations: its kind, centre (B, 2), angle (B,) and radii."""

    kind: str
    centre: np.ndarray
    angle: np.ndarray
    radii: Radii

    def support(self, alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """h at the direction's angle (B,), dh/dalpha, and the radius of curvature there."""
        a, b = self.radii
        if a == b:
            return np.full_like(alpha, a), np.zeros_like(alpha), np.full_like(alpha, a)
        c, s = np.cos(alpha - self.angle), np.sin(alpha - self.angle)
        h = np.sqrt((a * c) ** 2 + (b * s) ** 2)
        return h, (b**2 - a**2) * c * s / h, (a * b) ** 2 / h**3


def placed(scene: Scene, shape: Shape, q: np.ndarray) -> Placed:
    """A half-plane, disc or ellipse of the scene at q (B, nv)."""
    if shape.kind not in ("halfplane", "disc", "ellipse"):
        raise SceneError(f"shape {shape.name!r}: benchmarks take half-planes, discs, ellipses")
    radius = shape.radius if isinstance(shape.radius, tuple) else (shape.radius,)
    offset, turn = np.array(shape.offset, float), np.full(len(q), shape.angle)
    if shape.body is None:
        centre = np.broadcast_to(offset, (len(q), 2))
    else:
        b = [body.name for body in scene.bodies].index(shape.body)
        angle, origin = frames(scene, q)
        centre, turn = origin[:, b] + turned(offset, angle[:, b]), turn + angle[:, b]
    return Placed(shape.kind, centre, turn, (radius[0], radius[-1]))


def contact(
    scene: Scene, q: np.ndarray, pair: int = 0, directions: int = DIRECTIONS
) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance (B,) of a pair and the angle (B,) of its normal, which points from A to B."""
    shapes = {shape.name: shape for shape in scene.shapes}
    a, b = (placed(scene, shapes[name], q) for name in
            (scene.contacts[pair].shape_a, scene.contacts[pair].shape_b))  # fmt: skip
    if a.kind == "halfplane":
        return _above(a, b), a.angle
    if b.kind == "halfplane":
        return _above(b, a), b.angle + math.pi
    return _apart(a, b, directions)


def distance(scene: Scene, q: np.ndarray, pair: int = 0) -> np.ndarray:
    """Signed distance (B,) of a pair."""
    return contact(scene, q, pair)[0]


def _above(plane: Placed, other: Placed) -> np.ndarray:
    """Distance (B,) of a round shape from a half-plane, along its normal."""
    delta = other.centre - plane.centre
    along = np.cos(plane.angle) * delta[:, 0] + np.sin(plane.angle) * delta[:, 1]
    return along - other.support(plane.angle + math.pi)[0]


def _apart(a: Placed, b: Placed, directions: int) -> tuple[np.ndarray, np.ndarray]:
    """Distance and normal of two round shapes: the best of some normals, then Newton steps on its angle."""
    delta = b.centre - a.centre

    def objective(alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """d at the normal's angle, its slope, and minus its curvature d + rho_A + rho_B."""
        c, s = np.cos(alpha), np.sin(alpha)
        ha, ga, rho_a = a.support(alpha)
        hb, gb, rho_b = b.support(alpha + math.pi)
        d = c * delta[:, 0] + s * delta[:, 1] - ha - hb
        return d, c * delta[:, 1] - s * delta[:, 0] - ga - gb, d + rho_a + rho_b

    best, alpha = np.full(len(delta), -np.inf), np.zeros(len(delta))
    for k in range(directions):
        trial = np.full(len(delta), 2.0 * math.pi * k / directions)
        d = objective(trial)[0]
        alpha, best = np.where(d > best, trial, alpha), np.maximum(d, best)
    for _ in range(8):
        _, slope, curvature = objective(alpha)
        step = np.where(curvature > 0.0, slope / np.where(curvature > 0.0, curvature, 1.0), 0.0)
        alpha = alpha + np.clip(step, -math.pi / directions, math.pi / directions)
    return np.maximum(best, objective(alpha)[0]), alpha
