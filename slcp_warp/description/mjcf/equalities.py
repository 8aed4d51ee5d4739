"""Equality constraints of a MuJoCo model, for `reader.py`: a spring and damper here that yields next to
nothing, of coordinates a tendon, of points a pin.

MuJoCo's own are soft, by solref and solimp, which are not read. Here a force F moves what is held by F/k.
"""

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..assemblies.pins import pin
from ..parts import Spring, Tendon
from .at_rest import AtRest, start_of
from .connections import Connection
from .motors import Coordinate
from .names import Names, named
from .plane import MjcfError, Place, Plane
from .refused import HINT, is_disabled
from .tendons import joints_of

# Stiffness k of what holds is this times m/h^2, m the mass that is felt along it at qpos0, h the time step,
# its damping 2 k h: less than half of what is off is left after a step, and a force yields 1/RIGID of what it
# moves in one. At three times as much a float32 step under Coulomb's law fails once in a million, at ten once
# in ten thousand; stiffer pins give and take energy as they turn (`pin`).
RIGID = 100.0
MISSED = 1e-3  # at the start: less than this nobody has to know [m, rad]


def active(m: Any) -> list[int]:
    """The equality constraints that act from the start."""
    if is_disabled(m, "EQUALITY") or is_disabled(m, "CONSTRAINT"):
        return []
    return [i for i in range(m.neq) if m.eq_active0[i]]


def joints_held(m: Any) -> set[int]:
    """The joints that equality constraints of joints tie to a number or to each other."""
    of_joints = [i for i in active(m) if kind_of(m, i) == "joint"]
    return {int(j) for i in of_joints for j in (m.eq_obj1id[i], m.eq_obj2id[i]) if j >= 0}


class Equalities:
    """What stands here for a model's equality constraints.

    Args:
        place: of every MuJoCo body.
        coordinates: ours of every joint.
        with_tendons: whether the model's tendons are read.

    Attributes:
        tendons, springs: stiff ones.
        missed: by how much those are at the start that do not hold there, by their names in the model.

    Raises:
        MjcfError: one that has no counterpart, or that holds nothing.
    """

    def __init__(
        self,
        m: Any,
        plane: Plane,
        at_rest: AtRest,
        place: Mapping[int, Place],
        coordinates: Mapping[int, Coordinate],
        names: Names,
        with_tendons: bool,
    ) -> None:
        self.m, self.plane, self.at_rest, self.place = m, plane, at_rest, place
        self.coordinates, self.names, self.with_tendons = coordinates, names, with_tendons
        self.moved = start_of(m)[0] - m.qpos0
        self.tendons: list[Tendon] = []
        self.springs: list[Spring] = []
        self.missed: dict[str, float] = {}
        for i in active(m):
            self._read(i, f"equality constraint {named(m, 'equality', i)!r}")

    def _read(self, i: int, label: str) -> None:
        kind = kind_of(self.m, i)
        if kind in ("connect", "weld"):
            self._connect(i, Connection(self.m, i, self.plane, self.at_rest, label), label)
        elif kind == "tendon" and not self.with_tendons:
            raise MjcfError(f"{label}: it holds a tendon, and tendons are left out{HINT}")
        elif kind in ("joint", "tendon"):
            row, length = self._line(i, kind, label)
            if not np.any(row):
                raise MjcfError(f"{label}: it holds no coordinate; one that acts on some is needed{HINT}")
            self._tie(i, row, length)
        else:
            raise MjcfError(f"{label}: it is one of kind {kind}; joint, tendon, connect and weld are "
                            f"supported{HINT}")  # fmt: skip

    def _line(self, i: int, kind: str, label: str) -> tuple[np.ndarray, float]:
        """The row (nv,) and the length of y - y0 = a0 + a1 (x - x0), of two joints' or tendons' positions."""
        first, second = int(self.m.eq_obj1id[i]), int(self.m.eq_obj2id[i])
        factors = [float(a) for a in self.m.eq_data[i, :5]]
        if not np.isfinite(factors).all():
            raise MjcfError(f"{label}: polycoef is {factors}; finite numbers are needed{HINT}")
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

    def _tie(self, i: int, row: np.ndarray, length: float) -> None:
        """Add the tendon that holds row (q - qpos0) at a length, with 1 for its largest coefficient."""
        largest = float(np.abs(row).max())
        row, length = row / largest, length / largest
        joints = [int(self.m.dof_jntid[dof]) for dof in np.flatnonzero(row)]
        factors = [float(row[self.m.jnt_dofadr[j]]) for j in joints]
        self._note(i, abs(self._along(row) - length), largest)
        ours = [self.coordinates[j] for j in joints]
        self.tendons.append(
            Tendon(
                self.names.tendon("equality", i),
                tuple(at.name for at in ours),
                tuple(c * at.sense for c, at in zip(factors, ours)),
                *self._stiff(1.0 / float(self.at_rest.mobility([row])[0, 0])),
                length,
            )
        )

    def _connect(self, i: int, at: Connection, label: str) -> None:
        """The pin of two points, and of a weld the tendon of what turns their bodies against each other."""
        holders = [self.place[end.body] for end in at.ends]
        points = [place.point(self.plane.point(end.point)) for place, end in zip(holders, at.ends)]
        if at.mass is None:
            raise MjcfError(f"{label}: no joint moves its points against each other; some is needed{HINT}")
        a, b = at.order
        springs = pin(
            holders[a].holder,
            holders[b].holder,
            (float(points[a][0]), float(points[a][1])),
            (float(points[b][0]), float(points[b][1])),
            *self._stiff(at.mass),
            at.arm,
        )
        self.springs += springs
        self._note(i, at.apart)
        if at.turn is None:
            return
        row, off = at.turn
        if np.any(row):
            self._tie(i, row, self._along(row) - off)
        elif abs(off) > MISSED:
            raise MjcfError(f"{label}: no joint turns its bodies against each other, which its relpose wants "
                            f"{off:g} rad from how they are; leave it as they are{HINT}")  # fmt: skip

    def _along(self, row: np.ndarray) -> float:
        """row (q - qpos0) at the start."""
        joints = [int(self.m.dof_jntid[dof]) for dof in np.flatnonzero(row)]
        return float(sum(row[self.m.jnt_dofadr[j]] * self.moved[self.m.jnt_qposadr[j]] for j in joints))

    def _note(self, i: int, off: float, unit: float = 1.0) -> None:
        """Remember that a constraint is missed at the start."""
        if off > MISSED:
            self.missed[named(self.m, "equality", i)] = off * unit

    def _stiff(self, mass: float) -> tuple[float, float]:
        """Stiffness and damping of what holds a mass."""
        h = float(self.m.opt.timestep)
        return RIGID * mass / h / h, 2.0 * RIGID * mass / h


def kind_of(m: Any, i: int) -> str:
    """The kind of equality constraint i, "joint" .."""
    import mujoco

    return str(mujoco.mjtEq(int(m.eq_type[i])).name).removeprefix("mjEQ_").lower()


def warn_of_start(missed: Mapping[str, float], file: str) -> None:
    """A RuntimeWarning for each of `Equalities.missed`: what is stiff starts with a jerk then."""
    for name, off in missed.items():
        warnings.warn(
            f"{file}: equality constraint {name!r} is missed by {off:.3g} at the start, and a jerk pulls it "
            "together within a few steps; a first keyframe in which it holds has none",
            RuntimeWarning,
            stacklevel=3,
        )
