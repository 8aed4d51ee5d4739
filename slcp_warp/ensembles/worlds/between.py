"""What a task puts between a policy and its world: what it sees, and `policies.Around` by the task."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.policies.around import OF_TASK
from slcp_warp.kernels.policies.contract import PolicyKernel

from ...inputs.checks import attribute
from ...inputs.errors import ArgumentError
from ...policies.around import Around
from ...policies.observed import Observed
from ...simulator import Simulator
from ...stepping.host import acts_on_host
from ...tasks.disturbances import Disturbances
from ...tasks.task import Task


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


def between(policy: Any, task: Task, seed: int, step_size: float, quiet: bool) -> Any:
    """A policy as a task's worlds have it, undisturbed ones `quiet`; itself where nothing lies between.

    Raises:
        ArgumentError: a sensor, a delay or a hold around a policy that acts on the host.
    """
    d, host = task.disturbances, acts_on_host(policy)
    if task.observation is not None and not attribute(policy, "sees_states"):
        policy = HostObserved(policy, task) if host else Observed(policy, task.observation)
    noise = d.sensor.values() if isinstance(d.sensor, Mapping) else (d.sensor,)
    if not any(noise) and not d.delay and not d.hold:
        return policy
    if host:
        raise ArgumentError(
            "policy acts on the host; the sensor, delay and hold of Task.disturbances lie around policies "
            "that kernels evaluate"
        )
    return Between(policy, d, step_size, seed, quiet)


class HostObserved:
    """A policy on the host that sees some states."""

    def __init__(self, policy: Any, task: Task) -> None:
        if not isinstance(task.observation, tuple):
            raise ArgumentError("policy acts on the host; Task.observation must be names of states for it")
        self._policy = policy
        self._places = [task.scene.state_index(name) for name in task.observation]
        self.period = attribute(policy, "period")
        begin = attribute(policy, "begin")
        if begin is not None:
            self.begin = begin

    def act(self, x: np.ndarray, time: float, worlds: np.ndarray) -> Any:
        """Controls of the states x (B, nx)."""
        return self._policy.act(x[:, self._places], time, worlds)


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
