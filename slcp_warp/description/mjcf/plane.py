"""The plane of motion of a MuJoCo model: coordinates in it, and errors for what leaves it."""

import math
from dataclasses import dataclass
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

    def frame(self, quaternion: Any, label: str) -> np.ndarray:
        """A rotation as it is seen along the normal, (2, 2): a turn, or where it takes the normal to its
        opposite a mirror image, of determinant -1.
        """
        matrix = self.matrix(quaternion)
        if not np.allclose(np.abs(matrix @ self.normal), np.abs(self.normal), atol=FLAT):
            raise MjcfError(f"{label}: it is turned out of the plane {self.name}")
        return matrix[np.ix_(self.axes, self.axes)]


@dataclass(frozen=True)
class Place:
    """Where a MuJoCo body is: in the frame of which body of ours (None: the world), and how it lies there, by
    its axes (2, 2), which may be mirrored, and its origin (2,).
    """

    holder: str | None
    axes: np.ndarray
    origin: np.ndarray

    def point(self, x: np.ndarray) -> np.ndarray:
        """A point of the MuJoCo body in our body's frame."""
        return self.origin + self.axes @ x

    @property
    def side(self) -> float:
        """-1 where the body is mirrored, else 1."""
        return side_of(self.axes)


def side_of(axes: np.ndarray) -> float:
    """-1 for axes (2, 2) that are mirrored, else 1."""
    return math.copysign(1.0, float(np.linalg.det(axes)))


def angle_of(axes: np.ndarray) -> float:
    """The direction of the first of two axes [rad]."""
    return math.atan2(float(axes[1, 0]), float(axes[0, 0]))
