"""A MuJoCo model at its reference positions, what masses are felt there, and its start, for `reader.py`."""

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np


class AtRest:
    """A model at qpos0, with its degrees of freedom as MuJoCo has them."""

    def __init__(self, m: Any) -> None:
        self.m = m

    @functools.cached_property
    def data(self) -> Any:
        """Its places and mass matrix."""
        import mujoco

        data = mujoco.MjData(self.m)
        mujoco.mj_kinematics(self.m, data)
        mujoco.mj_comPos(self.m, data)
        getattr(mujoco, "mj_makeM", mujoco.mj_crb)(self.m, data)
        return data

    @functools.cached_property
    def factored(self) -> Any:
        """The same, with its mass matrix factored."""
        import mujoco

        mujoco.mj_factorM(self.m, self.data)
        return self.data

    def mobility(self, rows: Sequence[np.ndarray]) -> np.ndarray:
        """J M^-1 J' of the rows of J, each (nv,)."""
        import mujoco

        jacobian = np.ascontiguousarray(rows, float)
        moved = np.zeros_like(jacobian)
        mujoco.mj_solveM(self.m, self.factored, moved, jacobian)
        return jacobian @ moved.T

    def slopes(self, body: int, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Slopes (3, nv) of the place of a point of a body, given in its frame (3,), and of its turning."""
        import mujoco

        moving, turning = np.zeros((3, self.m.nv)), np.zeros((3, self.m.nv))
        at = place_of(self.data, body, point)
        mujoco.mj_jac(self.m, self.data, moving, turning, at, body)
        return moving, turning

    def independence(self, body: int) -> float:
        """How far the joints of a body are from moving it alike: the least eigenvalue of their masses, with
        ones on the diagonal. 1: in ways of their own, 0: one of them in the way of others.
        """
        import mujoco

        first, count = int(self.m.body_dofadr[body]), int(self.m.body_dofnum[body])
        columns = np.zeros((count, self.m.nv))
        for place, column in enumerate(columns):
            unit = np.zeros(self.m.nv)
            unit[first + place] = 1.0
            mujoco.mj_mulM(self.m, self.data, column, unit)
        masses = columns[:, first : first + count]
        scale = np.sqrt(np.diag(masses))
        return float(np.linalg.eigvalsh(masses / np.outer(scale, scale))[0])


def place_of(data: Any, body: int, point: np.ndarray) -> np.ndarray:
    """Where a point of a body is, given in its frame, (3,)."""
    return np.asarray(data.xpos[body] + data.xmat[body].reshape(3, 3) @ point)


def start_of(m: Any) -> tuple[np.ndarray, np.ndarray]:
    """Positions (nq,) and velocities (nv,) of the first keyframe, or qpos0 at rest."""
    if m.nkey:
        return np.array(m.key_qpos[0]), np.array(m.key_qvel[0])
    return np.array(m.qpos0), np.zeros(m.nv)
