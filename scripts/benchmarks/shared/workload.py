"""What the benchmarks run: random legal states and torques of a scene of revolute bodies, in plain NumPy."""

import math
from dataclasses import dataclass

import numpy as np

from slcp_warp import Scene, SceneError

from ..mechanics.scene import distance


@dataclass(frozen=True)
class Workload:
    """Worlds to roll out: x0 (B, nx) [rad, rad/s] and controls (B, N, nu) [N m]."""

    x0: np.ndarray
    controls: np.ndarray

    @property
    def steps(self) -> int:
        """World steps in one rollout, B N."""
        return self.controls.shape[0] * self.controls.shape[1]


def legal_states(scene: Scene, count: int, rng: np.random.Generator, speed: float = 1.0) -> np.ndarray:
    """Random states (count, nx) with every pair apart.

    q is uniform inside the limits, or over a turn where there are none; v is normal with standard deviation
    `speed` [rad/s].
    """
    for body in scene.bodies:
        if body.joint != "revolute":
            raise SceneError(f"body {body.name!r}: benchmarks draw revolute joints, not {body.joint!r}")
    low = np.array([-math.pi if body.lower is None else body.lower for body in scene.bodies], float)
    high = np.array([math.pi if body.upper is None else body.upper for body in scene.bodies], float)
    found: list[np.ndarray] = []
    missing = count
    while missing > 0:
        q = rng.uniform(low, high, size=(2 * missing + 16, scene.nv))
        apart = np.all([distance(scene, q, k) > 0.0 for k in range(len(scene.all_contacts))], axis=0)
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
        states: (B, N or N+1, nx) before every step.
        controls: (B, N, nu).
        chosen: (B, N) bool.

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
