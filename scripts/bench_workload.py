"""What the benchmarks run: random legal states and torques of a scene of revolute bodies, in plain NumPy.

The kinematics here are written apart from the kernels on purpose: they choose the states, and they are the
numbers that a peer's model is compared with. Signed distance: d = max over unit n of
n.(c_B - c_A) - h_A(n) - h_B(-n), h the support function, as in `kernels.shapes`.
"""

import math
from dataclasses import dataclass

import numpy as np

from slcp_warp.scene import Scene, SceneError

DIRECTIONS = 128  # normals tried by the distance search; the best is refined by Newton's method
Radii = tuple[float, float]


@dataclass(frozen=True)
class Workload:
    """Worlds to roll out: x0 (B, nx) [rad, rad/s] and controls (B, N, nu) [N m]."""

    x0: np.ndarray
    controls: np.ndarray

    @property
    def steps(self) -> int:
        """World steps in one rollout, B N."""
        return self.controls.shape[0] * self.controls.shape[1]


def frames(scene: Scene, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angle (B, nb) and joint position (B, nb, 2) of every body at q (B, nv)."""
    names = [body.name for body in scene.bodies]
    angle = np.zeros((len(q), len(names)))
    origin = np.zeros((len(q), len(names), 2))
    for b, body in enumerate(scene.bodies):
        if body.joint != "revolute":
            raise SceneError(f"body {body.name!r}: benchmarks take revolute joints, not {body.joint!r}")
        angle[:, b] = body.angle + q[:, b]
        origin[:, b] = body.anchor
        if body.parent is not None:
            p = names.index(body.parent)
            angle[:, b] += angle[:, p]
            origin[:, b] = origin[:, p] + turned(np.array(body.anchor), angle[:, p])
    return angle, origin


def turned(vector: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """A vector (2,) turned by each angle (B,): (B, 2)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]], axis=-1)


def mass_matrix(scene: Scene, q: np.ndarray) -> np.ndarray:
    """M = sum over bodies of m J_c' J_c + I J_w' J_w, (B, nv, nv)."""
    angle, origin = frames(scene, q)
    names = [body.name for body in scene.bodies]
    total = np.zeros((len(q), scene.nv, scene.nv))
    for b, body in enumerate(scene.bodies):
        centre = origin[:, b] + turned(np.array(body.com), angle[:, b])
        jac = np.zeros((len(q), 3, scene.nv))  # rows: x, y, angle
        j: int | None = b
        while j is not None:
            arm = centre - origin[:, j]
            jac[:, 0, j], jac[:, 1, j], jac[:, 2, j] = -arm[:, 1], arm[:, 0], 1.0
            parent = scene.bodies[j].parent
            j = None if parent is None else names.index(parent)
        weight = np.array([body.mass, body.mass, body.inertia])
        total += np.einsum("bki,k,bkj->bij", jac, weight, jac)
    return total


def _ellipses(scene: Scene, pair: int, q: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, Radii]]:
    """Centre (B, 2), angle (B,) and radii of the two shapes of a contact pair."""
    angle, origin = frames(scene, q)
    names = [body.name for body in scene.bodies]
    shapes = {shape.name: shape for shape in scene.shapes}
    contact = scene.contacts[pair]
    out = []
    for shape in (shapes[contact.shape_a], shapes[contact.shape_b]):
        if shape.kind == "halfplane" or shape.body is None:
            raise SceneError(f"shape {shape.name!r}: benchmarks take ellipses and discs on bodies")
        b = names.index(shape.body)
        radius = shape.radius if isinstance(shape.radius, tuple) else (shape.radius,)
        centre = origin[:, b] + turned(np.array(shape.offset), angle[:, b])
        out.append((centre, angle[:, b] + shape.angle, (radius[0], radius[-1])))
    return out


def distance(scene: Scene, q: np.ndarray, pair: int = 0) -> np.ndarray:
    """Signed distance (B,) of a pair: the best of DIRECTIONS normals, then Newton steps on its angle."""
    (ca, pa, ra), (cb, pb, rb) = _ellipses(scene, pair, q)
    delta = cb - ca

    def support(alpha: np.ndarray, angle: np.ndarray, radii: Radii) -> tuple[np.ndarray, ...]:
        c, s = np.cos(alpha - angle), np.sin(alpha - angle)
        h = np.sqrt((radii[0] * c) ** 2 + (radii[1] * s) ** 2)
        return h, (radii[1] ** 2 - radii[0] ** 2) * c * s / h, (radii[0] * radii[1]) ** 2 / h**3

    def objective(alpha: np.ndarray, rows: slice | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """d at the normal's angle, its slope, and minus its curvature d + rho_A + rho_B."""
        c, s, dx, dy = np.cos(alpha), np.sin(alpha), delta[rows, 0], delta[rows, 1]
        ha, ga, rho_a = support(alpha, pa[rows], ra)
        hb, gb, rho_b = support(alpha, pb[rows], rb)
        d = c * dx + s * dy - ha - hb
        return d, c * dy - s * dx - ga - gb, d + rho_a + rho_b

    best, alpha = np.full(len(q), -np.inf), np.zeros(len(q))
    everything = slice(None)
    for k in range(DIRECTIONS):
        trial = np.full(len(q), 2.0 * math.pi * k / DIRECTIONS)
        d = objective(trial, everything)[0]
        alpha, best = np.where(d > best, trial, alpha), np.maximum(d, best)
    for _ in range(8):
        _, slope, curvature = objective(alpha, everything)
        step = np.where(curvature > 0.0, slope / np.where(curvature > 0.0, curvature, 1.0), 0.0)
        alpha = alpha + np.clip(step, -math.pi / DIRECTIONS, math.pi / DIRECTIONS)
    return np.maximum(best, objective(alpha, everything)[0])


def legal_states(scene: Scene, count: int, rng: np.random.Generator, speed: float = 1.0) -> np.ndarray:
    """Random states (count, nx) with every pair apart.

    q is uniform inside the limits, or over a turn where there are none; v is normal with standard deviation
    `speed` [rad/s].
    """
    low = np.array([-math.pi if body.lower is None else body.lower for body in scene.bodies], float)
    high = np.array([math.pi if body.upper is None else body.upper for body in scene.bodies], float)
    found: list[np.ndarray] = []
    missing = count
    while missing > 0:
        q = rng.uniform(low, high, size=(2 * missing + 16, scene.nv))
        apart = np.all([distance(scene, q, k) > 0.0 for k in range(len(scene.contacts))], axis=0)
        found.append(q[apart][:missing])
        missing -= len(found[-1])
    q = np.concatenate(found)
    return np.concatenate([q, speed * rng.standard_normal(q.shape)], axis=1)


def make_workload(scene: Scene, worlds: int, steps: int, seed: int) -> Workload:
    """Random legal states, each with unit-normal torques at every step."""
    rng = np.random.default_rng(seed)
    return Workload(legal_states(scene, worlds, rng), rng.standard_normal((worlds, steps, scene.nu)))


def windows(states: np.ndarray, controls: np.ndarray, chosen: np.ndarray, length: int) -> Workload:
    """The stretches of `length` steps, at multiples of it, whose steps are all chosen.

    Args:
        states: (B, N or N+1, nx) before every step. controls: (B, N, nu). chosen: (B, N) bool.

    Raises:
        ValueError: there is no such stretch.
    """
    count = chosen.shape[1] // length
    cut = chosen[:, : count * length].reshape(len(chosen), count, length)
    world, window = np.nonzero(cut.all(axis=2))
    if not len(world):
        raise ValueError(
            f"no stretch of {length} chosen steps in {chosen.shape[0]} worlds of {chosen.shape[1]} steps; "
            f"more worlds or steps are needed"
        )
    steps = window[:, None] * length + np.arange(length)
    return Workload(states[world, window * length], controls[world[:, None], steps])
