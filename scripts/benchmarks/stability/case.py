"""A case of the stability battery as data: scene, numbers of every world, and a criterion in SI units.

A case is run over its own variants (masses, speeds, slopes ...) times noise levels at every step size; all
worlds of one step size are one launch of one kernel. `measure` turns a run into one number per world, which
passes up to `limit`. See docs/understand/stability.md for what each case tests and what a miss means.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slcp_warp import Scene
from slcp_warp.kernels.method import Method
from slcp_warp.options import Status

Array = np.ndarray
G = 9.81
SIGMAS = (0.1, 0.01, 1e-3, 1e-4)
STEP_SIZES = (1e-3, 0.01, 0.05, 0.1)
UP = math.pi / 2


@dataclass(frozen=True)
class Grid:
    """Worlds of one launch: step size h [s], noise level (B,) (nan: hard) and the case's variant (B,)."""

    h: float
    sigma: Array
    variant: Array
    method: Method

    @property
    def size(self) -> int:
        """Worlds."""
        return len(self.sigma)

    @property
    def layer(self) -> Array:
        """Thickness h sigma of the smoothing layer (B,), 0 in hard mode [m]."""
        return self.h * np.nan_to_num(self.sigma)


@dataclass(frozen=True)
class Start:
    """Initial states (B, nx), parameters by name and controls (B, N, nu) or None."""

    x0: Array
    numbers: dict[str, Any] = field(default_factory=dict)
    controls: Array | None = None


@dataclass(frozen=True)
class Run:
    """What a launch did: states (B, N + 1, nx), impulses (B, N, nr), and of the n checked steps the smallest
    gaps (B, n) and the energies (B, n + 1).
    """

    grid: Grid
    states: Array
    impulse: Array
    gap: Array
    energy: Array

    @property
    def nv(self) -> int:
        """Degrees of freedom."""
        return self.states.shape[-1] // 2


@dataclass(frozen=True)
class Case:
    """One scene and its criterion.

    Attributes:
        name, what: for tables.
        scene: maker.
        start: Grid, steps -> Start.
        measure: Run -> (B,).
        limit: largest number that passes, per world or for all.
        unit: of the number.
        single: added to the limit in float32, where positions have seven digits.
        duration: [s], or `steps`: the same number at every h.
        variants: of the case's own number, `label` names it.
        expect: the status that passes.
        only: methods that the case applies to.
        generic: the generic kernels step it, whatever its size.
    """

    name: str
    what: str
    scene: Callable[[], Scene]
    start: Callable[[Grid, int], Start]
    measure: Callable[[Run], Array]
    limit: Callable[[Grid], Any] | float
    unit: str = "m"
    single: float = 0.0
    duration: float = 1.0
    steps: int | None = None
    label: str = ""
    variants: tuple[float, ...] = (1.0,)
    sigmas: tuple[float, ...] = SIGMAS
    step_sizes: tuple[float, ...] = STEP_SIZES
    expect: Status = Status.SOLVED
    only: Callable[[Method], bool] = lambda method: True
    generic: bool = False
    quick: bool = False

    def bound(self, grid: Grid, dtype: str) -> Array:
        """The limit of every world (B,)."""
        limit = self.limit(grid) if callable(self.limit) else self.limit
        limit = limit + (self.single if dtype == "float32" else 0.0)
        return np.broadcast_to(np.asarray(limit, float), (grid.size,))

    def count(self, h: float) -> int:
        """Steps of a run."""
        return self.steps or max(1, round(self.duration / h))


def states(grid: Grid, nv: int, **values: Any) -> Array:
    """(B, 2 nv) zeros with components set by place: q0=..., v2=..."""
    x = np.zeros((grid.size, 2 * nv))
    for key, value in values.items():
        x[:, int(key[1:]) + (nv if key[0] == "v" else 0)] = value
    return x


def friction(grid: Grid, pairs: int, mu: Any) -> Array:
    """(B, pairs) with one coefficient per world."""
    return np.repeat(np.broadcast_to(np.asarray(mu, float), (grid.size,))[:, None], pairs, 1)


def ground_angle(grid: Grid, shapes: int, slope: Any) -> Array:
    """Shape angles (B, shapes): zero but the last one's, a half-plane tilted by `slope`."""
    out = np.zeros((grid.size, shapes))
    out[:, -1] = UP + slope
    return out
