"""The worlds of a sweep as arrays: what each of them is and goes through."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import warp as wp

from ...inputs.checks import array
from ...inputs.errors import ArgumentError
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

    def numpy(self) -> "Worlds":
        """The same in NumPy arrays."""
        return Worlds(*(v.numpy().copy() if isinstance(v, wp.array) else v for v in self._values()))
