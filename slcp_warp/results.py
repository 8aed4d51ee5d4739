"""What a simulator gives back: a step, a trajectory, a linearisation."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .description.scene import Scene
from .options import Options


@dataclass(frozen=True)
class Step:
    """Outcome of a step; arrays are of the caller's kind, batch first.

    Attributes:
        state: (B, nx) = (q', v').
        impulse: (B, nr) lambda [N s, N m s].
        gap: (B, nr) signed distance of every row before the step [m, rad].
        multiplier: (B, nr + 2 pairs) for `warm_start`.
        status: (B,) see `Status`.
    """

    state: Any
    impulse: Any
    gap: Any
    multiplier: Any
    status: Any
    _by_pair: Callable[[], Any]

    @property
    def contact_impulse(self) -> Any:
        """Normal and tangential impulse on shape_b along (n, t), (B, pairs, 2) [N s].

        Computed when it is asked for.
        """
        return self._by_pair()


@dataclass(frozen=True)
class Trajectory:
    """Outcome of a rollout; arrays are of the caller's kind, batch first.

    Attributes:
        states: (B, N+1, nx), the start first.
        status: (B,) see `Status`.
        controls: (B, N, nu) if recorded, else None.
        impulse: (B, N, nr) of the rows [N s, N m s] if recorded, else None.
        gap: (B, N, nr) of the rows before every step [m, rad] if recorded, else None.
    """

    states: Any
    status: Any
    controls: Any = None
    impulse: Any = None
    gap: Any = None


@dataclass(frozen=True)
class Linearization:
    """Derivatives of a step x' = f(x, u).

    Attributes:
        A: df/dx (B, nx, nx).
        B: df/du (B, nx, nu).
        second: second derivatives by z = (x, u), (B, nw, nz, nz), of v' (nw = nv), or of v* and v' (nw =
            2 nv) with the trapezoidal integrator, where q' = q + h v*; None where they were not asked for.
        status: (B,) see `Status`.
    """

    A: Any
    B: Any
    second: Any
    status: Any


def contact_impulse(scene: Scene, impulse: np.ndarray, friction: np.ndarray, options: Options) -> np.ndarray:
    """Normal and tangential impulse of every pair, (..., pairs, 2), from row impulses (..., nr)."""
    s = scene.structure
    out = np.zeros((*impulse.shape[:-1], len(s.pairs), 2))
    mu = np.broadcast_to(friction, (*impulse.shape[:1], len(s.pairs)))
    for i, row in enumerate(s.rows):
        if row.kind == "contact" and options.method.coulomb:
            out[..., row.index, int(row.sign < 0)] = impulse[..., i]
        elif row.kind == "contact":
            out[..., row.index, 0] += impulse[..., i]
            coefficient = mu[:, row.index].reshape(-1, *([1] * (impulse.ndim - 2)))
            out[..., row.index, 1] += row.sign * coefficient * impulse[..., i]
    return out
