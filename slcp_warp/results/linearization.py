"""What a linearisation gives back."""

from dataclasses import dataclass

import numpy as np

from ..description.scene import Scene
from ..inputs.arrays import Array, to_numpy
from ..storage.printed import Printed, Table, counted
from .statuses import statuses


@dataclass(frozen=True, repr=False)
class Linearization(Printed):
    """Derivatives of a step x' = f(x, u); arrays are of the caller's kind.

    Attributes:
        A: df/dx (B, nx, nx).
        B: df/du (B, nx, nu).
        second: second derivatives by z = (x, u), (B, nw, nz, nz), of v' (nw = nv), or of v* and v' (nw =
            2 nv) with the trapezoidal integrator, where q' = q + h v*; None where they were not asked for.
        status: (B,) see `Status`.
        scene: whose step it is.
    """

    A: Array
    B: Array
    second: Array
    status: Array
    scene: Scene | None = None

    def _line(self) -> str:
        worlds = self.A.shape[0] if len(self.A.shape) == 3 else 1
        sizes = f"A {tuple(self.A.shape[-2:])}, B {tuple(self.B.shape[-2:])}"
        more = "" if self.second is None else ", with second derivatives"
        return f"of {counted(worlds, 'world')}: {sizes}{more}; {statuses(self.status)}"

    def _tables(self) -> list[Table]:
        if self.scene is None or not self.A.shape[0]:
            return []
        both = [a if a.ndim == 2 else a[0] for a in map(to_numpy, (self.A, self.B))]
        numbers, names = np.concatenate(both, axis=1), self.scene.state_names
        head = ("d next / d", *names, *(f"control {name}" for name in self.scene.control_names))
        rows = [(name, *map(float, row)) for name, row in zip(names, numbers)]
        return [Table("the first world", head, rows)]
