"""The plane of motion of a MuJoCo model: coordinates in it, and errors for what leaves it."""

import math
from typing import Any

import numpy as np

from ...inputs.checks import choice
from ...inputs.errors import SceneError

FLAT = 1e-6  # what counts as in the plane


class MjcfError(SceneError):
    """A model that is not planar or not supported; the message names the element and the reason."""


def plane_of(m: Any) -> str:
    """The plane that a MuJoCo model moves in: "xy" where all of its hinges turn about z, or all of its slides
    keep z, else "xz".
    """
    import mujoco

    data = mujoco.MjData(m)
    mujoco.mj_kinematics(m, data)
    hinges = np.asarray(m.jnt_type) == int(mujoco.mjtJoint.mjJNT_HINGE)
    axes = np.asarray(data.xaxis).reshape(m.njnt, 3)
    if hinges.any():
        return "xy" if (np.abs(np.abs(axes[hinges, 2]) - 1.0) < FLAT).all() else "xz"
    flat = len(axes) > 0 and (np.abs(axes[:, 2]) < FLAT).all() and (np.abs(axes[:, 1]) > FLAT).any()
    return "xy" if flat else "xz"


def named(m: Any, kind: str, i: int) -> str:
    """The name of a MuJoCo body, geom or tendon; without one its kind and number, as no other is called."""
    import mujoco

    kinds = mujoco.mjtObj
    objects = {"body": kinds.mjOBJ_BODY, "geom": kinds.mjOBJ_GEOM, "tendon": kinds.mjOBJ_TENDON}
    if name := getattr(m, kind)(i).name:
        return str(name)
    out = f"{kind}{i}"
    while mujoco.mj_name2id(m, int(objects[kind]), out) >= 0:
        out += "_"
    return out


class Plane:
    """The plane "xz" or "xy"; `normal` completes its axes to a right-handed frame."""

    def __init__(self, name: str) -> None:
        planes = {"xz": (0, 2, (0.0, -1.0, 0.0)), "xy": (0, 1, (0.0, 0.0, 1.0))}
        choice("plane", name, planes)
        first, second, normal = planes[name]
        self.name, self.axes, self.normal = name, [first, second], np.array(normal)

    def point(self, x: Any) -> np.ndarray:
        """A place as it is seen along the normal."""
        return np.asarray(x, float)[self.axes]

    def depth(self, x: Any) -> float:
        """How far a place is along the normal."""
        return float(self.normal @ np.asarray(x, float))

    def vector(self, x: Any, label: str) -> tuple[float, float]:
        """A direction or force in the plane."""
        if abs(float(self.normal @ x)) > FLAT:
            raise MjcfError(f"{label}: {np.round(x, 6).tolist()} points out of the plane {self.name}")
        first, second = np.asarray(x, float)[self.axes]
        return float(first), float(second)

    def normal_sign(self, axis: Any, label: str) -> float:
        """+1 or -1 for a hinge about the normal or against it."""
        along = float(self.normal @ axis)
        if abs(abs(along) - 1.0) > FLAT:
            raise MjcfError(
                f"{label}: its axis {np.round(axis, 6).tolist()} is not normal to the plane {self.name}"
            )
        return math.copysign(1.0, along)

    def matrix(self, quaternion: Any) -> np.ndarray:
        """Rotation matrix of a unit quaternion (w, x, y, z)."""
        w, x, y, z = (float(c) for c in quaternion)
        return np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ])  # fmt: skip

    def turn(self, quaternion: Any, label: str) -> float:
        """Angle of a rotation about the normal, counter-clockwise in the plane."""
        matrix = self.matrix(quaternion)
        if not np.allclose(matrix @ self.normal, self.normal, atol=FLAT):
            raise MjcfError(f"{label}: it is turned out of the plane {self.name}")
        first, second = matrix[self.axes, self.axes[0]]
        return math.atan2(second, first)
