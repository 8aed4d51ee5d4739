"""What a task puts between a policy and its world: `policies.Around` with the disturbances' numbers."""

import math
from collections.abc import Mapping
from typing import Any

import warp as wp

from slcp_warp.kernels.policies.around import OF_TASK
from slcp_warp.kernels.policies.contract import PolicyKernel

from ...inputs.errors import ArgumentError
from ...policies.around import Around
from ...simulator import Simulator
from ...tasks.disturbances import Disturbances


class Between:
    """A policy behind a task's noisy sensor, hold and delay; `quiet`: as if they were not there.

    The code is the same both ways, so that undisturbed worlds need no kernel of their own.
    """

    def __init__(self, policy: Any, d: Disturbances, step_size: float, seed: int, quiet: bool) -> None:
        delay, hold = steps_of(d, step_size)
        self._around = Around(policy, delay=delay, hold=hold, noise=d.sensor, seed=seed)
        self._quiet, self.step_size = quiet, self._around.step_size

    def kernel(self, sim: Simulator) -> tuple[PolicyKernel, Any]:
        """Kernel and struct for a simulator."""
        kernel, struct = self._around.kernel(sim)
        struct.stream = OF_TASK
        if self._quiet:
            struct.delay, struct.hold = 0, 1
            struct.noise = wp.zeros(sim.nx, dtype=sim.dtype, device=sim.device)
        return kernel, struct


def between(policy: Any, task: Disturbances, seed: int, step_size: float, quiet: bool) -> Any:
    """A policy as a task's worlds have it, undisturbed ones `quiet`; itself where nothing lies between."""
    noise = task.sensor.values() if isinstance(task.sensor, Mapping) else (task.sensor,)
    if not any(noise) and not task.delay and not task.hold:
        return policy
    return Between(policy, task, step_size, seed, quiet)


def steps_of(d: Disturbances, step_size: float) -> tuple[int, int]:
    """Steps of the delay and of the hold, the nearest.

    Raises:
        ArgumentError: a delay or a hold of less than half a step.
    """
    steps = [math.floor(span / step_size + 0.5) for span in (d.delay, d.hold)]
    for name, span, count in zip(("delay", "hold"), (d.delay, d.hold), steps):
        if span and not count:
            raise ArgumentError(
                f"Disturbances.{name} is {span} s, less than half a step of {step_size} s; more is needed"
            )
    return steps[0], max(1, steps[1])
