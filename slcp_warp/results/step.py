"""What a step gives back."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..description.scene import Scene
from ..inputs.arrays import Array, to_numpy
from ..options import Options
from ..storage.printed import Printed, Table, counted
from .overlaps import failed_table
from .statuses import statuses


@dataclass(frozen=True, repr=False)
class Step(Printed):
    """Outcome of a step; arrays are of the caller's kind, batch first.

    Attributes:
        state: (B, nx) = (q', v').
        impulse: (B, nr) lambda [N s, N m s]; 0 in worlds that are not SOLVED, whose state is the one before.
        gap: (B, nr) signed distance of every row before the step [m, rad].
        multiplier: (B, nr + 2 pairs) for `warm_start`.
        status: (B,) see `Status`.
        scene: whose step it is.
    """

    state: Array
    impulse: Array
    gap: Array
    multiplier: Array
    status: Array
    _by_pair: Callable[[], Array]
    scene: Scene | None = None

    @property
    def contact_impulse(self) -> Array:
        """Normal and tangential impulse on shape_b along (n, t), (B, pairs, 2) [N s].

        Computed when it is asked for.
        """
        return self._by_pair()

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_by_pair": partial(_same, self.contact_impulse)}

    def _line(self) -> str:
        worlds = self.state.shape[0] if len(self.state.shape) == 2 else 1
        of = "" if self.scene is None else f" of {self.scene.name!r}"
        return f"{of} in {counted(worlds, 'world')}: {statuses(self.status)}".strip()

    def _tables(self) -> list[Table]:
        if self.scene is None or not self.state.shape[0]:
            return []
        first, *both = (
            a if a.ndim == 1 else a[0] for a in map(to_numpy, (self.state, self.impulse, self.gap))
        )
        states = zip(self.scene.state_names, self.scene.state_units, map(float, first))
        rows = [(name, *map(float, numbers)) for name, *numbers in zip(self.scene.row_names, *both)]
        return [
            Table("the first world", ("state", "unit", "next"), list(states), left=2),
            Table("its rows", ("row", "impulse", "gap before"), rows),
            failed_table(self.scene, self.status, lambda worlds: np.atleast_2d(to_numpy(self.gap))[worlds]),
        ]


def contact_impulse(scene: Scene, impulse: np.ndarray, friction: np.ndarray, options: Options) -> np.ndarray:
    """Normal and tangential impulse of every pair, (..., pairs, 2), from row impulses (..., nr)."""
    s = scene.structure
    first = s.nr - sum(1 + pair.friction for pair in s.pairs)  # limits come before
    pair, sign = np.array([(row.index, row.sign) for row in s.rows[first:]], int).reshape(-1, 2).T
    plain, plus, minus = (np.flatnonzero(sign == which) for which in (0, 1, -1))
    rows = impulse[..., first:]
    out = np.zeros((*impulse.shape[:-1], len(s.pairs), 2))
    out[..., pair[plain], 0] = rows[..., plain]
    if options.method.coulomb:
        out[..., pair[plus], 0], out[..., pair[minus], 1] = rows[..., plus], rows[..., minus]
        return out
    mu = np.broadcast_to(friction, (*impulse.shape[:1], len(s.pairs)))[..., pair[plus]]
    mu = mu.reshape(*impulse.shape[:1], *([1] * (impulse.ndim - 2)), len(plus))
    out[..., pair[plus], 0] = rows[..., plus] + rows[..., minus]
    out[..., pair[plus], 1] = mu * (rows[..., plus] - rows[..., minus])
    return out


def _same(value: Array) -> Array:
    return value
