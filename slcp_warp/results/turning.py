"""What turns further within a step than its method follows."""

import numpy as np

from slcp_warp.kernels.structure import REVOLUTE

from ..description.scene import Scene

FAST = 1.0  # rad a step: beyond, velocities of the step's start and end have nothing to do with each other


def turned(scene: Scene, states: np.ndarray, step_size: np.ndarray) -> str:
    """The joint of states (B, N+1, nx) that turns by most in a step, where that is too much; or "".

    Args:
        step_size: shared, or (B,) [s].
    """
    angles = [scene.nv + j for j, kind in enumerate(scene.structure.dof_kind) if kind == REVOLUTE]
    if not angles or not states.size:
        return ""
    rates = states[..., angles]
    most = np.maximum(rates.max(axis=1), -rates.min(axis=1)) * np.reshape(step_size, (-1, 1))
    fastest = float(most.max())
    if not fastest > FAST:
        return ""
    name = scene.state_names[angles[int(most.max(axis=0).argmax())] - scene.nv]
    return (
        f"{name} turns by up to {fastest:.3g} rad a step: beyond {FAST:g} steps give or take energy, and "
        "smaller ones, or smaller forces, are needed"
    )
