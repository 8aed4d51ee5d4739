"""Gains that turn the noise of a task's sensors into controls as large as their limits."""

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from ...inputs.checks import attribute
from ...inputs.limits import limit_rows
from ...tasks.task import Task

LOUD = 0.25  # of what a control may go to either side: noise by more shakes rather than corrects


def noise_of_controls(policy: Any, sensor: np.ndarray) -> np.ndarray | None:
    """Standard deviations (nu,) of what white noise on the states (nx,) makes of the controls, over the steps
    and plans of a policy that has gains `K` (..., nu, nx); None of one that has not.
    """
    gain = attribute(policy, "K")
    gain = gain.numpy() if isinstance(gain, wp.array) else gain
    if not isinstance(gain, np.ndarray) or gain.ndim < 2 or not gain.size or gain.shape[-1] != len(sensor):
        return None
    square = np.sum((gain * sensor) ** 2, axis=-1)
    return np.sqrt(square.reshape(-1, square.shape[-1]).mean(axis=0))


def warn_of_noise(name: str, policy: Any, task: Task) -> None:
    """Say of a policy, called `name`, that the noise of a task's sensors shakes its controls by much of what
    the task's limits leave them. Without limits nothing is said.
    """
    scene, given = task.scene, task.disturbances.sensor
    sensor = np.zeros(2 * scene.nv)
    for state, deviation in given.items() if isinstance(given, Mapping) else ():
        sensor[scene.state_index(state)] = deviation
    found = noise_of_controls(policy, sensor if isinstance(given, Mapping) else sensor + given)
    if found is None:
        return
    lower, upper = limit_rows(task.control_limits, scene.nu)
    reach = 0.5 * (upper - lower).min(axis=0)
    share = np.where(reach > 0.0, found / np.where(reach > 0.0, reach, 1.0), 0.0)
    worst = int(share.argmax())
    if share[worst] > LOUD:
        warnings.warn(
            f"policy {name!r}: through its gains the sensors' noise shakes control "
            f"{scene.control_names[worst]!r} by {found[worst]:.3g} (standard deviation), {share[worst]:.0%} "
            "of what it may go to either side. Gains of a plan know of no noise: smaller ones, as of "
            "ddp.TrackingPolicy(plan, gain=0.2), may do better",
            RuntimeWarning,
            stacklevel=4,
        )
