"""Equality constraints of a MuJoCo model, for `reader.py`: what holds coordinates together is a spring and
damper here that yields next to nothing.

MuJoCo's own are soft, by solref and solimp, which are not read. Here a force F moves what is held by F/k.
"""

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..parts import Tendon
from .at_rest import AtRest, start_of
from .motors import Coordinate
from .names import Names, named
from .plane import MjcfError
from .refused import HINT, is_disabled
from .tendons import joints_of

# Stiffness k of what holds is this times m/h^2, m the mass that is felt along it at qpos0, h the time step,
# its damping 2 k h: what is off halves in every step, and a force yields 1/RIGID of what it moves in one.
RIGID = 300.0

MISSED = 1e-3  # at the start: less than this nobody has to know [m, rad]


def active(m: Any) -> list[int]:
    """The equality constraints that act from the start."""
    if is_disabled(m, "EQUALITY") or is_disabled(m, "CONSTRAINT"):
        return []
    return [i for i in range(m.neq) if m.eq_active0[i]]


def joints_held(m: Any) -> set[int]:
    """The joints that equality constraints of joints tie to a number or to each other."""
    import mujoco

    of_joints = [i for i in active(m) if m.eq_type[i] == mujoco.mjtEq.mjEQ_JOINT]
    return {int(j) for i in of_joints for j in (m.eq_obj1id[i], m.eq_obj2id[i]) if j >= 0}


class Equalities:
    """What stands here for a model's equality constraints.

    Args:
        coordinates: ours of every joint.
        with_tendons: whether the model's tendons are read.

    Attributes:
        tendons: stiff ones.
        missed: by how much those are at the start that do not hold there, by their names in the model.

    Raises:
        MjcfError: one that has no counterpart, or that holds nothing.
    """

    def __init__(
        self, m: Any, at_rest: AtRest, coordinates: Mapping[int, Coordinate], names: Names, with_tendons: bool
    ) -> None:
        self.m, self.at_rest, self.coordinates, self.names = m, at_rest, coordinates, names
        self.with_tendons = with_tendons
        self.moved = start_of(m)[0] - m.qpos0
        self.tendons: list[Tendon] = []
        self.missed: dict[str, float] = {}
        for i in active(m):
            self._read(i, named(m, "equality", i))

    def _read(self, i: int, name: str) -> None:
        import mujoco

        kinds = {int(mujoco.mjtEq.mjEQ_JOINT): "joint", int(mujoco.mjtEq.mjEQ_TENDON): "tendon"}
        label, kind = f"equality constraint {name!r}", kinds.get(int(self.m.eq_type[i]))
        if kind is None:
            raise MjcfError(f"{label}: only those of joints and of fixed tendons are supported{HINT}")
        if kind == "tendon" and not self.with_tendons:
            raise MjcfError(f"{label}: it holds a tendon, and tendons are left out{HINT}")
        row, length = self._line(i, kind, label)
        self._tie(i, row, length, label)

    def _line(self, i: int, kind: str, label: str) -> tuple[np.ndarray, float]:
        """The row (nv,) and the length of y - y0 = a0 + a1 (x - x0), of two joints' or tendons' positions."""
        first, second = int(self.m.eq_obj1id[i]), int(self.m.eq_obj2id[i])
        factors = [float(a) for a in self.m.eq_data[i, :5]]
        if second >= 0 and any(a != 0.0 for a in factors[2:]):
            raise MjcfError(f"{label}: polycoef is {factors}; a line is supported, a0 and a1{HINT}")
        row = self._row(kind, first)
        if second >= 0:
            row -= factors[1] * self._row(kind, second)
        return row, factors[0]

    def _row(self, kind: str, which: int) -> np.ndarray:
        """The slope (nv,) of a joint's or tendon's position."""
        row = np.zeros(self.m.nv)
        for joint, coefficient in ({which: 1.0} if kind == "joint" else joints_of(self.m, which)).items():
            row[self.m.jnt_dofadr[joint]] += coefficient
        return row

    def _tie(self, i: int, row: np.ndarray, length: float, label: str) -> None:
        """Add the tendon that holds row (q - qpos0) at a length, with 1 for its largest coefficient."""
        largest = float(np.abs(row).max(initial=0.0))
        if not np.isfinite(largest) or not np.isfinite(length):
            raise MjcfError(f"{label}: its polycoef are not finite; they must be{HINT}")
        if largest == 0.0:
            raise MjcfError(f"{label}: it holds no coordinate; one that acts on some is needed{HINT}")
        row, length = row / largest, length / largest
        joints = [int(self.m.dof_jntid[dof]) for dof in np.flatnonzero(row)]
        factors = [float(row[self.m.jnt_dofadr[j]]) for j in joints]
        moved = sum(c * float(self.moved[self.m.jnt_qposadr[j]]) for j, c in zip(joints, factors))
        if abs(moved - length) > MISSED:
            self.missed[named(self.m, "equality", i)] = abs(moved - length) * largest
        ours = [self.coordinates[j] for j in joints]
        self.tendons.append(
            Tendon(
                self.names.tendon("equality", i),
                tuple(at.name for at in ours),
                tuple(c * at.sense for c, at in zip(factors, ours)),
                *rigid(self.m, self.at_rest.mobility([row])),
                length,
            )
        )


def rigid(m: Any, mobility: np.ndarray) -> tuple[float, float]:
    """Stiffness and damping of what holds rows of this mobility, (rows, rows), by the lightest mass."""
    h = float(m.opt.timestep)
    stiffness = RIGID / (float(np.linalg.eigvalsh(mobility)[-1]) * h**2)
    return stiffness, 2.0 * stiffness * h


def warn_of_start(missed: Mapping[str, float], file: str) -> None:
    """A RuntimeWarning for each of `Equalities.missed`: what is stiff starts with a jerk then."""
    for name, off in missed.items():
        warnings.warn(
            f"{file}: equality constraint {name!r} is missed by {off:.3g} at the start, and a jerk pulls it "
            "together within a few steps; a first keyframe in which it holds has none",
            RuntimeWarning,
            stacklevel=3,
        )
