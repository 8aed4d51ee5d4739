"""What a peer simulator offers to the work-precision diagrams: runs of a scene, and a check of its model."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from slcp_warp import Scene

from ..mechanics.scene import contact, every_contact, mass_matrix

DRAWS = 50  # configurations drawn for each that is kept
NEAR = 0.1  # distance up to which pairs are compared [m]
SPREAD = 0.5  # half width of the configurations about the starts at which models are compared [m, rad]
SAME = 1e-4  # largest deviation, relative to M's largest entry or in m, of a model that counts as the same
TURNED = 1e-2  # the same of a normal [rad]: an iterated distance in float32 has it to a root of its rounding


@dataclass(frozen=True)
class Run:
    """A scene ready to run with one peer, one step size and one set of options.

    Attributes:
        rollout: gives all states (B, N+1, nx), the starts first.
        simulate: the same motion of `worlds` worlds, to be timed; nothing is compiled in it.
        seconds: simulated by `simulate`.
        compile_seconds: spent on compiling.
        facts: columns of the rows.
    """

    rollout: Callable[[], np.ndarray]
    simulate: Callable[[], Any]
    worlds: int
    seconds: float
    compile_seconds: float
    facts: dict[str, Any]


@dataclass(frozen=True)
class Deviation:
    """Largest differences of a peer's model from the scene's own numbers over some configurations.

    mass_matrix: relative to the largest entry of M. distance: [m]. normal: angle between normals [rad].
    """

    mass_matrix: float
    distance: float
    normal: float

    @property
    def note(self) -> str:
        """One line, beginning with MODEL DIFFERS where the deviation is not just rounding."""
        off = f"M off {self.mass_matrix:.0e}, distance {self.distance:.0e} m, normal {self.normal:.0e} rad"
        same = max(self.mass_matrix, self.distance) <= SAME and self.normal <= TURNED
        return off if same else f"MODEL DIFFERS: {off}"


@dataclass(frozen=True)
class Linearization:
    """A peer's step as a function of rows z = (x, u), (B, nx + nu), and its Jacobians by name.

    step: next states (B, nx), each world without a warm start. jacobians: dx'/dz (B, nx, nx + nu).
    """

    step: Callable[[np.ndarray], np.ndarray]
    jacobians: dict[str, Callable[[np.ndarray], np.ndarray]]


class Peer(Protocol):
    """A simulator beside ours.

    name: as charts have it. version: of what is installed. settings: names of its sets of options for a
    scene with or without contacts, the best for accuracy among them.
    """

    name: str
    version: str

    def settings(self, contacts: bool) -> tuple[str, ...]:
        """Names of the sets of options worth a curve."""

    def prepare(self, scene: Scene, starts: np.ndarray, duration: float, h: float, setting: str) -> Run:
        """A run of `duration` [s] from starts (B, nx) in steps of h [s], compiled."""

    def deviation(self, scene: Scene, q: np.ndarray) -> Deviation:
        """How far its model is from the scene at configurations (K, nv)."""


def installed(makers: Iterable[Callable[[], Any]], say: Callable[[str], None]) -> list[Any]:
    """The peers whose packages are there; a line for each that is not."""
    found = []
    for make in makers:
        try:
            found.append(make())
        except ModuleNotFoundError as error:
            say(f"left out: {error}")
    return found


def step_count(duration: float, h: float) -> int:
    """Steps of h in `duration`. Raises ValueError where it is no whole number of them."""
    count = round(duration / h)
    if abs(count * h - duration) > 1e-9 * duration:
        raise ValueError(f"h is {h}; {duration} s must be a whole number of steps")
    return count


def places(states: np.ndarray, count: int) -> np.ndarray:
    """`count` random states (count, nx) of trajectories (B, N+1, nx).

    Their ends and what is not finite are left out.
    """
    flat = states[:, :-1].reshape(-1, states.shape[2])
    return np.random.default_rng(0).choice(flat[np.isfinite(flat).all(axis=1)], count)


def configurations(scene: Scene, starts: np.ndarray, count: int = 40) -> np.ndarray:
    """Random configurations (count, nv) about the starts: of many, those whose pairs are nearest to touching,
    apart or overlapping a little.
    """
    rng = np.random.default_rng(0)
    q = starts[rng.integers(len(starts), size=DRAWS * count), : scene.nv]
    q = q + SPREAD * rng.uniform(-1.0, 1.0, q.shape)
    gaps = [gap for gap, _ in every_contact(scene, q)]
    return q[np.argsort(np.abs(np.min(gaps, axis=0)) if gaps else np.zeros(len(q)))[:count]]


def deviation_of(
    scene: Scene, q: np.ndarray, masses: np.ndarray, gaps: np.ndarray, normals: np.ndarray
) -> Deviation:
    """Deviation of a peer's M (K, nv, nv), signed distances (K, pairs) and unit normals (K, pairs, 2).

    Normals point from the first shape of a pair to the second. Pairs closer than NEAR are compared.
    """
    own = mass_matrix(scene, q)
    worst = np.abs(masses - own).max(initial=0.0) / np.abs(own).max(initial=1e-300)
    gap = turn = 0.0
    for k in range(len(scene.all_contacts)):
        d, angle = contact(scene, q, k)
        near = d < NEAR
        gap = max(gap, float(np.abs(gaps[near, k] - d[near]).max(initial=0.0)))
        other = np.arctan2(normals[near, k, 1], normals[near, k, 0])
        turn = max(turn, float(np.abs(np.angle(np.exp(1j * (other - angle[near])))).max(initial=0.0)))
    return Deviation(float(worst), gap, turn)
