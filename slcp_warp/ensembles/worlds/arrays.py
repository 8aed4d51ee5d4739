"""The worlds of a sweep as arrays: what each of them is and goes through."""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.structure import STEP_SIZE

from ...inputs.checks import array
from ...inputs.errors import ArgumentError
from ...parameters import Parameters
from ...storage.printed import Arrays

AXES = {"x0": 2, "params": 2, "kicks": 3, "pushes": 3, "dropouts": 3, "timing": 3, "numbers": 1}


@dataclass(frozen=True, repr=False)
class Worlds(Arrays):
    """Numbers of B worlds, in place of drawn ones; what is None is as in a world without disturbance.

    Noise of single steps (of controls, of sensors, steps dropped at random) is not among them: it follows
    from the seed and the world's number.

    Attributes:
        x0: starts (B, nx).
        params: rows (B, P) of the table of parameters, as `Parameters.table` gives them; `from_table` of
            a scene's `Parameters` has them by name.
        kicks: what each of K kicks adds to the velocities (B, K, nv), at `Disturbances.kick_times`.
        pushes: (B, Q, 5) of `Disturbances.pushes`: start, duration [s], x, y of the force [N], torque [N m].
        dropouts: (B, D, 2) of `Disturbances.dropouts`: start, duration [s].
        timing: (B, 1, 2): delay and hold of the controls [s], where `Disturbances` draws them.
        numbers: (B,) of the worlds; None: 0, 1, ...
    """

    x0: Any
    params: Any = None
    kicks: Any = None
    pushes: Any = None
    dropouts: Any = None
    timing: Any = None
    numbers: Any = None

    def __post_init__(self) -> None:
        if all(isinstance(value, wp.array | None) for value in self._values()):
            return
        count: int | None = None
        for name, ndim in AXES.items():
            value = getattr(self, name)
            if value is None and name != "x0":
                continue
            if isinstance(value, Parameters):
                raise ArgumentError(f"Worlds.{name} is Parameters; their rows are needed, .table() of them")
            found = array(f"Worlds.{name}", value.numpy() if isinstance(value, wp.array) else value)
            if found.ndim != ndim or len(found) != (len(found) if count is None else count):
                need = "" if count is None else f" and {count} worlds"
                raise ArgumentError(f"Worlds.{name} has shape {found.shape}; {ndim} axes{need} are needed")
            count = len(found)
            if name == "numbers":
                bad = (found % 1.0 != 0.0) | (found < 0.0) | (found >= 2.0**31)
                if bad.any():
                    raise ArgumentError(
                        f"Worlds.numbers holds {found[bad][0]:g}; whole numbers from 0 to 2^31 - 1 are needed"
                    )
                found = found.astype(np.int32)
            object.__setattr__(self, name, found)

    def _values(self) -> list[Any]:
        return [getattr(self, each.name) for each in fields(self)]

    def __len__(self) -> int:
        return len(self.x0)

    def __getitem__(self, index: Any) -> "Worlds":
        """Some of them, by a slice or an array of places; they keep their numbers."""
        numbers = np.arange(len(self)) if self.numbers is None else self.numbers
        values: list[Any] = [
            None if value is None else np.asarray(value)[index] for value in self._values()[:-1]
        ]
        values.append(np.asarray(numbers)[index])
        return Worlds(*values)

    def step_sizes(self, otherwise: float) -> tuple[float, ...]:
        """The step sizes [s] that worlds on the host have, each once; `otherwise` where none are said, and
        where one number's rounding is all that differs.
        """
        if self.params is None or not self.params.size:
            return (otherwise,)
        own = np.unique(self.params[:, STEP_SIZE])
        if not own[0] > 0.0:  # who takes them will say so
            return (otherwise,)
        single = own.astype(np.float32)  # as worlds drawn in single precision have it
        return tuple(
            otherwise if h == otherwise or s == h == np.float32(otherwise)
            else float(str(s)) if h == s else float(h)
            for h, s in zip(own, single)
        )  # fmt: skip

    def at_step_size(self, step_size: float) -> "Worlds":
        """The same with steps of a size [s]; unchanged where worlds have several, or none that can be."""
        if self.params is None or not self.params.size or np.ptp(self.params[:, STEP_SIZE]) > 0.0:
            return self
        if not self.params[0, STEP_SIZE] > 0.0:
            return self
        params = self.params.copy()
        params[:, STEP_SIZE] = step_size
        return replace(self, params=params)

    def numpy(self) -> "Worlds":
        """The same in NumPy arrays."""
        return Worlds(*(v.numpy().copy() if isinstance(v, wp.array) else v for v in self._values()))
