"""Names of a MuJoCo model's elements, and of what becomes of them here, for `reader.py`."""

import functools
from typing import Any

from ..names import UNITS


def named(m: Any, kind: str, i: int) -> str:
    """The name of a MuJoCo body, geom, joint, tendon, actuator or equality constraint; without one its kind
    and number, as no other is called.
    """
    import mujoco

    kinds = mujoco.mjtObj
    objects = {
        "body": kinds.mjOBJ_BODY, "geom": kinds.mjOBJ_GEOM, "joint": kinds.mjOBJ_JOINT,
        "tendon": kinds.mjOBJ_TENDON, "equality": kinds.mjOBJ_EQUALITY, "actuator": kinds.mjOBJ_ACTUATOR,
    }  # fmt: skip
    if name := getattr(m, kind)(i).name:
        return str(name)
    out = f"{kind}{i}"
    while mujoco.mj_name2id(m, int(objects[kind]), out) >= 0:
        out += "_"
    return out


class Names:
    """Names that parts get here, where bodies, coordinates and tendons may not be called alike: what would be
    called as another part has its kind behind its name, `tip_tendon`.
    """

    def __init__(self, m: Any) -> None:
        self.m = m
        self.bodies = {named(m, "body", b) for b in range(m.nbody)}
        self.tendons: set[str] = set()

    def body_of(self, joint: int) -> str:
        """The name of a body here that a joint has for itself: the joint's."""
        name = named(self.m, "joint", joint)
        while name in self.bodies or name in self._others:
            name += "_joint"
        self.bodies.add(name)
        return name

    @functools.cached_property
    def _others(self) -> set[str]:
        """Names of geoms and tendons."""
        counts = (("geom", self.m.ngeom), ("tendon", self.m.ntendon))
        return {named(self.m, kind, i) for kind, count in counts for i in range(count)}

    def tendon(self, kind: str, i: int) -> str:
        """The name of what becomes a tendon here, a "tendon" or an "equality"."""
        name = named(self.m, kind, i).replace("#", "_")
        while name in self.bodies or name in self.tendons or self._is_coordinate(name):
            name += f"_{kind}"
        self.tendons.add(name)
        return name

    def shape(self, kind: str, i: int) -> str:
        """The name of a shape that stands for a tendon."""
        name = named(self.m, kind, i)
        while name in self._geoms or name in self.bodies:
            name += f"_{kind}"
        return name

    @functools.cached_property
    def _geoms(self) -> set[str]:
        return {named(self.m, "geom", i) for i in range(self.m.ngeom)}

    def _is_coordinate(self, name: str) -> bool:
        body, _, word = name.rpartition(".")
        return body in self.bodies and word in UNITS
