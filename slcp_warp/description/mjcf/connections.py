"""Points of bodies that a MuJoCo model connects or welds, for `equalities.py`."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .at_rest import AtRest, place_of, start_of
from .plane import FLAT, MjcfError, Plane
from .refused import HINT

LEAST_ARM = 1e-3  # of a pin [m]
SHORT = 0.2  # an arm by the square root of an inertia over a mass (`pin`)
ROUNDING = 1e-12  # of what moves bodies: less moves no point of one against another


@dataclass(frozen=True)
class End:
    """A point of a MuJoCo body, in its frame (3,), and how what is held there lies in it, (3, 3)."""

    body: int
    point: np.ndarray
    axes: np.ndarray


class Connection:
    """An equality constraint of two points, which holds their bodies' turning, too, where it is a weld.

    Attributes:
        ends: the two.
        mass: that is felt between the points at qpos0, the lighter way [kg]; None: no joint moves them.
        order: of the two ends, first the one whose body is heavier to turn.
        arm: of a pin there [m].
        apart: of the two points at the start [m].
        turn: None, or what a weld holds: its slope (nv,), and by how much it is off at the start [rad].

    Raises:
        MjcfError: points that are not above each other along the normal, or a weld that is turned out of the
            plane.
    """

    def __init__(self, m: Any, i: int, plane: Plane, at_rest: AtRest, label: str) -> None:
        self.m, self.plane = m, plane
        weld = bool(m.eq_type[i] == _weld())
        self.ends = _ends(m, i, plane, weld)
        moving, turning = zip(*(at_rest.slopes(end.body, end.point) for end in self.ends))
        turns = [plane.normal @ slope for slope in turning]
        places = [slope[plane.axes] for slope in moving]
        mobility = at_rest.mobility([*(places[1] - places[0]), *turns, *places[0], *places[1]])
        lightest, each = float(np.linalg.eigvalsh(mobility[:2, :2])[-1]), np.diag(mobility)
        freely = each[4:].sum() + each[2:4].sum() * float(m.stat.extent) ** 2
        self.mass = 1.0 / lightest if lightest > ROUNDING * freely else None
        self.order, self.arm = self._lever(each[2:4])
        self.apart, off = self._start(label, weld)
        self.turn = (np.round(turns[1] - turns[0], 9), off) if weld and m.eq_data[i, 10] != 0.0 else None

    def _lever(self, turned: np.ndarray) -> tuple[tuple[int, int], float]:
        """Which end comes first, by what a moment turns the bodies, and a pin's arm, by the inertia of the
        first one over the mass, or of the other one's, where the first does not turn.
        """
        first = int(turned[1] < turned[0])
        least = turned[first] or turned[1 - first]
        arm = 1.0 if self.mass is None or least == 0.0 else float(SHORT / np.sqrt(least * self.mass))
        return (first, 1 - first), max(arm, LEAST_ARM)

    def _start(self, label: str, weld: bool) -> tuple[float, float]:
        """How far the points are apart at the start, and how far their bodies are turned against a weld."""
        import mujoco

        data = mujoco.MjData(self.m)
        data.qpos[:] = start_of(self.m)[0]
        mujoco.mj_kinematics(self.m, data)
        a, b = (place_of(data, end.body, end.point) for end in self.ends)
        if abs(beside := self.plane.depth(b - a)) > FLAT:
            raise MjcfError(f"{label}: its points are {abs(beside):g} m apart along the normal of the plane "
                            f"{self.plane.name}, where no joint moves them{HINT}")  # fmt: skip
        if not weld:
            return float(np.linalg.norm(b - a)), 0.0
        held, there = (data.xmat[end.body].reshape(3, 3) @ end.axes for end in self.ends)
        left = there @ held.T  # the turn that is left between them
        if not np.allclose(left @ self.plane.normal, self.plane.normal, atol=FLAT):
            raise MjcfError(f"{label}: it holds its bodies turned out of the plane {self.plane.name}{HINT}")
        first, second = left[np.ix_(self.plane.axes, self.plane.axes)][:, 0]
        return float(np.linalg.norm(b - a)), float(np.arctan2(second, first))


def _weld() -> Any:
    import mujoco

    return mujoco.mjtEq.mjEQ_WELD


def _ends(m: Any, i: int, plane: Plane, weld: bool) -> tuple[End, End]:
    """The points that a constraint names by sites, or by bodies and anchors."""
    import mujoco

    objects, data = (int(m.eq_obj1id[i]), int(m.eq_obj2id[i])), np.array(m.eq_data[i])
    if m.eq_objtype[i] == mujoco.mjtObj.mjOBJ_SITE:
        first, second = (
            End(int(m.site_bodyid[s]), np.array(m.site_pos[s]), plane.matrix(m.site_quat[s])) for s in objects
        )
        return first, second
    points = (data[3:6], data[:3]) if weld else (data[:3], data[3:6])
    held = plane.matrix(data[6:10]) if weld else np.eye(3)  # of the second body in the first
    return End(objects[0], points[0], held), End(objects[1], points[1], np.eye(3))
