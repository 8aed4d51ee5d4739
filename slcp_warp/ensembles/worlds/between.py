"""What a task puts between a policy and its world: what it sees, and `policies.Around` by the task."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.device.launch import Prepared
from slcp_warp.kernels.policies.around import OF_TASK, make_sensor_kernel
from slcp_warp.kernels.policies.contract import PolicyKernel

from ...inputs.checks import attribute
from ...inputs.errors import ArgumentError
from ...policies.around import LONGEST, Around
from ...policies.observed import Observation, Observed
from ...simulator import Simulator
from ...stepping.host import acts_on_host, senses_of
from ...tasks.disturbances import Disturbances, Uniform
from ...tasks.task import Task


class Between:
    """A policy behind a task's noisy sensor, hold and delay; `quiet`: without what is drawn of them.

    A delay or a hold that is a number belongs to what is controlled, and acts in undisturbed worlds, too. The
    code is the same both ways, so that these need no kernel of their own.
    """

    def __init__(self, policy: Any, d: Disturbances, step_size: float, seed: int, quiet: bool) -> None:
        (delay, hold), self._timed = steps_of(d, step_size), d.timed
        before = d.before if delay else None
        self._around = Around(policy, delay=delay, hold=hold, noise=d.sensor, seed=seed, before=before)
        self._fixed = steps_of(d.fixed(), step_size)
        self._quiet, self.step_size, self.worlds = quiet, self._around.step_size, self._around.worlds

    def kernel(self, sim: Simulator) -> tuple[PolicyKernel, Any]:
        """Kernel and struct for a simulator."""
        kernel, struct = self._around.kernel(sim, self._timed)
        struct.stream = OF_TASK
        if self._quiet:
            struct.delay, struct.hold = self._fixed
            struct.noise = wp.zeros(sim.nx, dtype=sim.dtype, device=sim.device)
        return kernel, struct


def between(policy: Any, task: Task, seed: int, step_size: float, quiet: bool) -> Any:
    """A policy as a task's worlds have it, undisturbed ones `quiet`; itself where nothing lies between."""
    d, host, policy = task.disturbances, acts_on_host(policy), observed(policy, task)
    noise = d.sensor.values() if isinstance(d.sensor, Mapping) else (d.sensor,)
    if not any(noise) and not d.delay and not d.hold:
        return policy
    if host:
        return HostBetween(policy, d, step_size, seed, quiet)
    return Between(policy, d, step_size, seed, quiet)


def observed(policy: Any, task: Task) -> Any:
    """A policy that is given what a task's policies see of the states; itself where that is all of them."""
    if task.observation is None or attribute(policy, "sees_states"):
        return policy
    return HostObserved(policy, task) if acts_on_host(policy) else Observed(policy, task.observation)


class OfHost:
    """A policy on the host with something around it."""

    def __init__(self, policy: Any) -> None:
        self._policy = policy
        self.period = attribute(policy, "period")
        begin = attribute(policy, "begin")
        if begin is not None:
            self.begin = begin
        self.senses = senses_of(policy)
        if self.senses:
            self.feel = policy.feel

    def act(self, x: np.ndarray, time: float, worlds: np.ndarray) -> Any:
        """Controls of the states x (B, nx)."""
        return self._policy.act(x, time, worlds)


class HostObserved(OfHost):
    """A policy on the host that sees a task's observation."""

    def __init__(self, policy: Any, task: Task) -> None:
        super().__init__(policy)
        self._of = task.observation
        if not isinstance(self._of, Observation):
            self._places = [task.scene.state_index(name) for name in task.observation]

    def act(self, x: np.ndarray, time: float, worlds: np.ndarray) -> Any:
        """Controls of the states x (B, nx)."""
        seen = self._of.of(x) if isinstance(self._of, Observation) else x[:, self._places]
        return self._policy.act(seen, time, worlds)


class HostBetween(OfHost):
    """A policy on the host behind a task's sensor, hold and delay; the last two are in the kernel.

    Attributes:
        hold: steps that a control is held; 1 where worlds differ.
    """

    def __init__(self, policy: Any, d: Disturbances, step_size: float, seed: int, quiet: bool) -> None:
        super().__init__(policy)
        self._given = d, step_size, seed, quiet
        self.hold = 1 if d.timed and not quiet else steps_of(d.fixed(), step_size)[1]

    def around(self, held: Any) -> Between:
        """What holds the policy's controls, behind hold and delay."""
        d, step_size, seed, quiet = self._given
        return Between(held, replace(d, sensor=0.0), step_size, seed, quiet)

    def sensor(
        self, sim: Simulator, next: wp.array, numbers: wp.array, state: wp.array
    ) -> tuple[Prepared | None, wp.array]:
        """A launch that shows states (B, nx) through the sensor, in the step that is each world's next, and
        where; None: the states themselves.
        """
        d, _, seed, quiet = self._given
        if quiet:
            return None, state
        out = wp.empty_like(state)
        noise: wp.array = wp.array(
            Around(None, noise=d.sensor).deviations(sim), dtype=sim.dtype, device=sim.device
        )
        inputs = [next, seed, OF_TASK, numbers, noise, state, out]
        return Prepared(make_sensor_kernel(sim.dtype), len(state), inputs, sim.device), out


def counted_in_steps(d: Disturbances) -> list[str]:
    """What disturbances have between policy and world that is rounded to steps of one size, by its name."""
    return [f"Disturbances.{name}" for name in ("delay", "hold") if getattr(d, name)]


def steps_of(d: Disturbances, step_size: float) -> tuple[int, int]:
    """Steps of the delay and of the hold, the nearest; of drawn ones the most.

    Raises:
        ArgumentError: a delay or a hold of less than half a step, or a delay of more than can be.
    """
    spans = [span.high if isinstance(span, Uniform) else span for span in (d.delay, d.hold)]
    steps = [math.floor(span / step_size + 0.5) for span in spans]
    for name, span, count in zip(("delay", "hold"), spans, steps):
        if span and not count:
            raise ArgumentError(
                f"Disturbances.{name} is {span} s, less than half a step of {step_size} s; more is needed"
            )
    if steps[0] > LONGEST:
        raise ArgumentError(
            f"Disturbances.delay is {spans[0]} s, {steps[0]} steps of {step_size} s; at most {LONGEST} steps "
            f"({LONGEST * step_size:g} s) can be"
        )
    return steps[0], max(1, steps[1])
