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
        mujoco.mj_factorM(self.m, data)
        return data

    def mobility(self, rows: Sequence[np.ndarray]) -> np.ndarray:
        """J M^-1 J' of the rows of J, each (nv,)."""
        import mujoco

        jacobian = np.ascontiguousarray(rows, float)
        moved = np.zeros_like(jacobian)
        mujoco.mj_solveM(self.m, self.data, moved, jacobian)
        return jacobian @ moved.T


def start_of(m: Any) -> tuple[np.ndarray, np.ndarray]:
    """Positions (nq,) and velocities (nv,) of the first keyframe, or qpos0 at rest."""
    if m.nkey:
        return np.array(m.key_qpos[0]), np.array(m.key_qvel[0])
    return np.array(m.qpos0), np.zeros(m.nv)
